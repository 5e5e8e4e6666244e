"""A block folder that has a bit of everything, and a block made in memory."""

import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import Camera

TOML = """\
name = "two strips"
description = 'says "hello"'
licence = "CC0"
crs = "EPSG:32647"
offset = [717541.0, 1606017.0, 0.1]
processed_by = ["us", "them"]

[camera.P1]
width = 4000
height = 3000
f = 3600.0
k1 = -0.05
readout_s = 0.025
serial = "0017"

[camera."old camera"]
width = 1000
height = 800
f = 900.0
calibrated = true

[sigma]
tie_px = 0.7
gnss_m = 0.03

[lever_arm]
default = [0.1, 0.2, -0.3]
B = [0.0, 0.0, 0.5]
fixed = true

[pilot]
name = "Ada"
"""
# World 100 m below; the quaternion 0 1 0 0 looks straight down, so depth is the flying height.
FILES = {
    "block.toml": TOML,
    "images.csv": """\
image,camera,flight,strip,time_s,x,y,z,qw,qx,qy,qz,vx,vy,vz,note
007,P1,A,1,10.5,0,0,100,0,1,0,0,5,0,0,cloudy
i2,P1,A,1,12.5,20,0,100,0,1,0,0,5,0,0,
i3,old camera,B,2,,,,,,,,,,,,"a, b"
""",
    "tie_points.csv": """\
point,image,x,y,sigma
1,007,1999.5,1499.5,
01,007,2359.5,1499.5,0.4
1,i2,1279.5,1499.5,
01,i2,1639.5,1499.5,
1,i3,500,400,
once,i3,501,401,
""",
    "points.csv": "point,x,y,z\n1,0,0,0\n01,10,0,0\nonce,,,\n",
    "marks.csv": "point,image,x,y\nG1,007,100,200\nG1,i2,300,200\n",
    "ground.csv": ("point,x,y,z,sx,sy,sz,role\nG1,1,2,3,0.01,0.01,,control\nG2,4,5,6,,,,check\n"),
    "gnss.csv": "image,x,y,z,sx,sy,sz\n007,0.1,0.2,100.3,0.02,,\ni2,20,0,100,,,\n",
    "rates.csv": "time_s,wx,wy,wz,flight\n10,0,0,0.1,A\n11,0,0,0.2,A\n10,0,0,0,B\n",
    "track.csv": "time_s,x,y,z,flight,quality\n10,0,0,100,A,1\n11,5,0,100,A,2\n10,0,0,100,B,1\n",
}


def block_folder(parent):
    """The folder `two_strips` in a parent folder."""
    where = parent / "two_strips"
    where.mkdir()
    for name, text in FILES.items():
        (where / name).write_text(text, encoding="utf-8")
    return where


def small(**tables) -> Block:
    """A block made in memory."""
    given = {
        "images": pd.DataFrame({"image": ["a", "b"], "camera": "c"}),
        "tie_points": pd.DataFrame(
            {"point": [7, 7, 8], "image": ["b", "a", "a"], "x": [1, 2, 3], "y": [4.0, 5.0, 6.0]}
        ),
    }
    camera = Camera.from_table("c", {"width": 100, "height": 80, "f": 90.0})
    return Block(name="small", cameras={"c": camera}, **(given | tables))
