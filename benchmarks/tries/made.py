"""The files that the tries name: a flight of 29 images as a surveyor has it, in many forms.

Everything is made up and small. The flight lies in UTM zone 32 (EPSG:25832), near 49.01 N, 8.55 E,
14 May 2024, GPS week 2314; heights are above the ellipsoid, the geoid lies 47.9 m above it.
"""

from __future__ import annotations

import json
import re
import shutil
import unicodedata
from datetime import datetime, timedelta
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from PIL import Image

import corridor
from benchmarks.tries import brought, forms, strangers
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import (
    Local,
    convert,
)
from corridor.core.simulation import read_plan
from corridor.tools.formats import export_project
from corridor.tools.formats.frames import local_table, moved
from corridor.tools.formats.rows import rows_of
from corridor.tools.readout import render

PLACE = Local(49.01, 8.55, 0.0)
CRS = "EPSG:25832"
GEOID_M = 47.9
WEEK, FIRST_S = 2314, 202_800.0  # 08:20:00 GPS time of 14 May 2024
LEAP_S = 18.0
SIGMA = np.array([0.008, 0.007, 0.015])
PLAN = """\
name = "newcomer"
axis_m = [[0, 0], [120, 30]]

[camera.M3E]
width = 1056
height = 792
f = 976

[terrain]
relief_m = 3
level_m = 160

[tie_points]
per_image = 80

[ground]
control = 4
check = 2

[noise]
tie_px = 0.4
mark_px = 0.4
gnss_m = [0.01, 0.01, 0.02]
control_m = 0.005

[[flight]]
name = "F1"
camera = "M3E"
height_m = 50
strips = 3
offsets_m = [-20, 0, 20]
images = 29
forward = 0.8
"""
XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-'
    'syntax-ns#"><rdf:Description xmlns:a="http://made/1.0/" a:GpsLatitude="%.9f" '
    'a:GpsLongitude="%.9f"/></rdf:RDF></x:xmpmeta>'
)
Q = ("qw", "qx", "qy", "qz")
CROSS = """\
name = "cross"
axis_m = [[60, -60], [60, 80]]

[[flight]]
name = "F2"
height_m = 60
strips = 1
"""


def make(home: Path, short: bool = False) -> None:
    """All files below a folder; short: without the photographs of stars and wheels."""
    home.mkdir(parents=True, exist_ok=True)
    (home / "my.toml").write_text(PLAN, encoding="utf-8")
    (home / "cross.toml").write_text(CROSS, encoding="utf-8")
    _plans(home)
    block = flight(home / "my.toml")
    grid = moved(block, CRS)
    for name, made in (("own", block), ("utm", grid)):
        made.write(home / name)
    _blocks(home, block, grid)
    _projects(home, block)
    _metashape(home)
    _pix4d(grid, home / "pix4d")
    _ground(home, block, grid)
    _tracks(home, block, grid)
    _photographs(home, block)
    _readouts(home, short)
    _series(home / "thermal")
    _strange(home, grid)
    strangers.make(home)
    forms.make(home)
    brought.make(home)


def flight(plan: Path) -> Block:
    """The flight: images of `DJI_0001.JPG`, exact by its own poses but for 0.4 px of noise."""
    block = corridor.simulate(read_plan(str(plan)), seed=29)
    names = {old: f"DJI_{k + 1:04d}.JPG" for k, old in enumerate(block.images["image"])}
    for table in ("images", "tie_points", "marks", "gnss"):
        frame = getattr(block, table)
        setattr(block, table, frame.assign(image=frame["image"].astype(str).map(names)))
    block.images = block.images.assign(time_s=FIRST_S + 2.0 * np.arange(len(block.images)))
    block.images = block.images.drop(
        columns=[c for c in ("vx", "vy", "vz", "wx", "wy", "wz") if c in block.images]
    )
    block = Block(
        **{
            name: getattr(block, name)
            for name in ("name cameras images tie_points marks points ground gnss sigma".split())
        }
    )
    block.extra["local_frame"] = local_table(PLACE)
    rows, rng = rows_of(block), np.random.default_rng(29)
    pixels = rows.pixels - rows.residuals() + 0.4 * rng.standard_normal(rows.pixels.shape)
    first = len(block.tie_points)
    for table, mine in (("tie_points", pixels[:first]), ("marks", pixels[first:])):
        frame = getattr(block, table)
        setattr(block, table, frame.assign(x=mine[:, 0], y=mine[:, 1]))
    camera = next(iter(block.cameras.values()))
    for table in ("tie_points", "marks"):
        frame = getattr(block, table)
        inside = frame["x"].between(0, camera.width - 1) & frame["y"].between(0, camera.height - 1)
        setattr(block, table, frame[inside].reset_index(drop=True))
    pose = block.poses
    at = block.image_rows("gnss")
    places = pose[at, :3] + [0.01, 0.01, 0.02] * rng.standard_normal((len(at), 3))
    block.gnss = block.gnss.assign(**dict(zip("xyz", places.T, strict=True)))
    return block


def _text(path: Path, *lines: str, **more) -> None:
    path.write_text("\n".join(lines) + "\n", encoding=more.pop("encoding", "utf-8"), **more)


def _plans(home: Path) -> None:
    for name, old, new in (
        ("z_axis", "[[0, 0], [120, 30]]", "[[0, 0, 5], [120, 30, 5]]"),
        ("across", "strips = 3", 'direction = "across"\nstrips = 3'),
        ("f_mm", "f = 976", "f = 12.29"),
        ("high", "height_m = 50", "height_m = 60000"),
        ("forward", "forward = 0.8", "forward = 80"),
        ("three_of_two", "offsets_m = [-20, 0, 20]", "offsets_m = [-20, 20]"),
        ("true", "strips = 3", "strips = true"),
        ("degrees", "[[0, 0], [120, 30]]", "[[8.55, 49.01], [8.56, 49.012]]"),
        ("readout_ms", "f = 976", "f = 976\nreadout_s = 25"),
        ("pixel_mm", "f = 976", "f = 976\npixel_um = 0.0033"),
        ("noise", "mark_px = 0.4\ngnss_m = [0.01, 0.01, 0.02]\ncontrol_m = 0.005\n", ""),
    ):
        assert old in PLAN, name
        (home / f"plan_{name}.toml").write_text(PLAN.replace(old, new), encoding="utf-8")


def _blocks(home: Path, block: Block, grid: Block) -> None:
    """The block with one thing changed, as people change it."""
    full = grid.copy()
    middle = np.round(np.median(full.poses[:, :3], axis=0) / 100) * 100 * [1, 1, 0]
    full.offset = np.zeros(3)
    full.write(home / "full_offset")
    stated = f"offset = {middle.tolist()}"
    _edit(home / "full_offset" / "block.toml", "offset = [0.0, 0.0, 0.0]", stated)
    near = grid.copy()
    for table in ("images", "points", "ground", "gnss"):
        near.put(table, "xyz", near.numbers(table, *"xyz") - middle)
    near.offset = middle
    near.write(home / "near_offset")
    bare = block.copy()
    bare.images = bare.images.drop(columns=["x", "y", "z", "qw", "qx", "qy", "qz"])
    bare.write(home / "no_poses")
    for name, change in (
        ("folders", lambda b: _everywhere(b, lambda n: f"100MEDIA\\{n}")),
        ("slashes", lambda b: _everywhere(b, lambda n: f"100MEDIA/{n}")),
        ("geoid_gnss", lambda b: b.put("gnss", "z", b.numbers("gnss", "z") - GEOID_M)),
        ("feet", lambda b: b.put("ground", "xyz", b.numbers("ground", *"xyz") / 0.3048)),
        ("far_ground", lambda b: b.put("ground", "xyz", b.numbers("ground", *"xyz") + 5.4e6)),
        ("feet_gnss", lambda b: b.put("gnss", "xyz", b.numbers("gnss", *"xyz") / 0.3048)),
        ("back_gnss", lambda b: b.put("gnss", "xyz", b.numbers("gnss", *"xyz")[::-1])),
        ("qw_last", lambda b: b.put("images", Q, b.numbers("images", *Q)[:, [1, 2, 3, 0]])),
        (
            "middle_marks",
            lambda b: b.put("marks", "xy", b.numbers("marks", *"xy") - [527.5, 395.5]),
        ),
        ("arm_mm", lambda b: b.lever_arm.update(default=(10.0, 20.0, 120.0))),
    ):
        made = block.copy()
        change(made)
        made.write(home / name)
    wrong = grid.copy()
    wrong.crs = "EPSG:31467"
    wrong.write(home / "gk_label")
    for name, file, old, new in (
        ("lower_gnss", "gnss.csv", "DJI_", "dji_"),
        ("stem_gnss", "gnss.csv", ".JPG", ""),
        ("twice_ground", "ground.csv", None, None),
        ("role_case", "ground.csv", ",control", ",Control"),
        ("role_cp", "ground.csv", ",check", ",CP"),
        ("type_column", "ground.csv", ",role", ",type"),
        ("space_name", "marks.csv", None, None),
        ("nfd_marks", "marks.csv", None, None),
    ):
        shutil.copytree(home / "own", home / name, dirs_exist_ok=True)
        path = home / name / file
        text = path.read_text(encoding="utf-8")
        if old is not None:
            text = text.replace(old, new)
        elif name == "twice_ground":
            text += text.splitlines()[1] + "\n"
        elif name == "space_name":
            point = text.splitlines()[1].partition(",")[0]
            text = text.replace(f"\n{point},", f"\n{point} ,", 1)
        else:
            point = text.splitlines()[1].partition(",")[0]
            ground = home / name / "ground.csv"
            composed = ground.read_text(encoding="utf-8").replace(f"\n{point},", "\nSüd,")
            ground.write_text(unicodedata.normalize("NFC", composed), encoding="utf-8")
            text = text.replace(f"\n{point},", "\n" + unicodedata.normalize("NFD", "Süd") + ",")
        path.write_text(text, encoding="utf-8")
    shutil.copytree(home / "own", home / "crlf", dirs_exist_ok=True)
    for path in (home / "crlf").iterdir():
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))


def _edit(path: Path, old: str, new: str, count: int = 1) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text, (path, old)
    path.write_text(text.replace(old, new, count), encoding="utf-8")


def _names(block: Block, table: str, change) -> None:
    frame = getattr(block, table)
    setattr(block, table, frame.assign(image=frame["image"].astype(str).map(change)))


def _everywhere(block: Block, change) -> None:
    for table in ("images", "tie_points", "marks", "gnss"):
        _names(block, table, change)


def _projects(home: Path, block: Block) -> None:
    """Projects of other programs, and the same with one thing changed."""
    for form in ("metashape", "colmap-text", "opensfm", "bundler", "micmac"):
        export_project(block, form, home / form, corrected=True)
    shutil.copytree(home / "opensfm", home / "opensfm_no_place", dirs_exist_ok=True)
    (home / "opensfm_no_place" / "reference_lla.json").unlink()
    path = home / "opensfm_no_place" / "reconstruction.json"
    made = json.loads(path.read_text(encoding="utf-8"))
    made[0].pop("reference_lla", None)
    path.write_text(json.dumps(made), encoding="utf-8")
    shutil.copytree(home / "colmap-text", home / "colmap_free", dirs_exist_ok=True)
    (home / "colmap_free" / "ground_points.csv").unlink()
    export_project(block, "colmap-text", home / "colmap_utm", corrected=True, to_crs=CRS)
    colmap = home / "colmap-text"

    def renamed(name: str, change) -> None:
        made = block.copy()
        _everywhere(made, change)
        export_project(made, "colmap-text", home / name, corrected=True)

    def folder_of(image: str) -> str:
        return f"{100 + int(image[4:8]) // 15}MEDIA/{image}"

    renamed("colmap_media", folder_of)
    renamed("colmap_blank", lambda n: f"Flug 1 Süd/{n.replace('_', ' ')}")
    renamed("colmap_twins", lambda n: n if int(n[4:8]) % 2 else f"{n[:-3]}jpg")
    shutil.copytree(colmap, home / "colmap_twice", dirs_exist_ok=True)
    _edit(home / "colmap_twice" / "images.txt", "DJI_0002.JPG", "DJI_0001.JPG")
    for name, place in (("opensfm_gcp", "."), ("odm", "opensfm")):
        target = home / name / place
        shutil.copytree(home / "opensfm", target, dirs_exist_ok=True)
    _text(home / "x.psx", '<document version="1.2.0" path="{projectname}.files/project.zip"/>')
    _text(home / "x.p4d", "<pix4dmapper/>")
    (home / "x.xlsx").write_bytes(b"PK\3\4 not a workbook")
    (home / "tables").mkdir(exist_ok=True)
    _text(home / "tables" / "reference.csv", "#Label,X,Y,Z", "DJI_0001,8.55,49.01,160")
    _text(home / "tables" / "markers.csv", "#Label,X,Y,Z", "GCP1,8.55,49.01,160")


def _metashape(home: Path) -> None:
    """The XML with one thing changed."""
    cameras = home / "metashape" / "cameras.xml"
    text = cameras.read_text(encoding="utf-8")

    def other(name: str, change) -> None:
        folder = home / f"metashape_{name}"
        shutil.copytree(home / "metashape", folder, dirs_exist_ok=True)
        for file in ("cameras.xml", "markers.xml"):
            path = folder / file
            path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    start, end = text.index("<reference>"), text.index("</reference>")
    system = text[start:end]
    other("no_system", lambda t: t.replace(system + "</reference>", ""))
    other("fisheye", lambda t: t.replace('type="frame"', 'type="fisheye"'))
    other("unscaled", lambda t: t.replace("<scale>1</scale>", "<scale>1.0004</scale>"))
    shutter = '<rolling_shutter_mode value="true"/>'
    other("shutter", lambda t: t.replace("<calibration ", shutter + "<calibration ", 1))
    more = "<k4>0.001</k4><p3>0.01</p3><b1>0.4</b1><b2>-0.2</b2></calibration>"
    other("more_terms", lambda t: t.replace("</calibration>", more))
    other(
        "disabled", lambda t: t.replace('label="DJI_0003.JPG"', 'label="DJI_0003.JPG" enabled="0"')
    )
    other("labels", lambda t: t.replace('label="DJI_0002.JPG"', 'label="DJI_0001.JPG"'))
    empty = '<chunk label="empty"><sensors/><cameras/></chunk><chunk'
    other("two_chunks", lambda t: t.replace("<chunk", empty, 1))
    other("compound", lambda t: t.replace(system, "<reference>EPSG:25832+7837"))
    placed = re.search(r"<transform>\s*<rotation>.*?</transform>", text, re.DOTALL)
    other("no_transform", lambda t: t.replace(placed[0], ""))
    stated = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'

    def in_grid(match):
        place = convert([[float(word) for word in match.groups()]], "EPSG:4979", CRS)[0]
        return '<reference x="{}" y="{}" z="{}"'.format(*place.tolist())

    def gridded(text, system):
        text = re.sub('<reference x="([^"]+)" y="([^"]+)" z="([^"]+)"', in_grid, text)
        return re.sub("(?s)<reference>.*?</reference>", f"<reference>{system}</reference>", text)

    other("local_free", lambda t: gridded(t.replace(placed[0], ""), stated))
    other("two_systems", lambda t: gridded(t, CRS) if "<location" in t else t)
    flat = re.compile('(<marker [^>]*>\\s*<reference x="[^"]+" y="[^"]+") z="[^"]+"')
    other("no_heights", lambda t: flat.sub(r"\1", t))


def _pix4d(block: Block, folder: Path) -> None:
    """The text files of `params`, poses in a frame that lies an offset from UTM."""
    folder.mkdir(exist_ok=True)
    offset = np.round(np.median(block.poses[:, :3], axis=0) / 100) * 100 * [1, 1, 0]
    camera = next(iter(block.cameras.values()))
    rows = [
        "fileName imageWidth imageHeight ",
        "camera matrix K [3x3]", "radial distortion [3x1]", "tangential distortion [2x1]",
        "camera position t [3x1]", "camera rotation R [3x3]", "camera model m = K [R|-Rt] X", "",
    ]  # fmt: skip
    inner = [camera["cx"] + 0.5, camera["cy"] + 0.5]
    rotation = rotation_from_quaternion(block.poses[:, 3:])
    for name, pose, turn in zip(block.images["image"], block.poses, rotation, strict=True):
        rows += [
            f"{name} {camera.width} {camera.height}",
            f"{camera['f']} 0 {inner[0]}", f"0 {camera['f']} {inner[1]}", "0 0 1",
            f"{camera['k1']} {camera['k2']} {camera['k3']}", f"{camera['p2']} {camera['p1']}",
        ]  # fmt: skip
        rows.append(" ".join(f"{v:.6f}" for v in pose[:3] - offset))
        rows += [" ".join(f"{v:.12f}" for v in line) for line in turn]
    _text(folder / "s_calibrated_camera_parameters.txt", *rows)
    _text(folder / "s_offset.xyz", " ".join(map(str, offset)))
    rows, size = [], (camera.width * 0.0044, camera.height * 0.0044)
    for name in block.images["image"]:
        rows.append(f"{name.rpartition('.')[0]} H_{size[0]:.5f}_{size[1]:.5f}")
        mine = block.tie_points[block.tie_points["image"] == name]
        for point, x, y in mine[["point", "x", "y"]].itertuples(index=False):
            x, y = x - (camera.width - 1) / 2, (camera.height - 1) / 2 - y
            rows.append(f"{point} {x * 0.0044:.8f} {y * 0.0044:.8f}")
        rows.append("-99")
    _text(folder / "s_tp_bingo.txt", *rows)
    shutil.copytree(folder, folder.with_name("pix4d_bad"), dirs_exist_ok=True)
    rows[0] = rows[0].partition(" ")[0] + " 4.6"
    _text(folder.with_name("pix4d_bad") / "s_tp_bingo.txt", *rows)


def _ground(home: Path, block: Block, grid: Block) -> None:
    """Ground points as text files have them, in UTM unless their name says otherwise."""
    folder = home / "ground"
    folder.mkdir(exist_ok=True)
    names = [f"GCP{k + 1}" for k in range(len(grid.ground))]
    utm = grid.numbers("ground", *"xyz") + grid.offset
    degrees = PLACE.to_geographic(block.numbers("ground", *"xyz"))

    def table(name, head, row, places=utm, **more):
        lines = [row(n, *xyz) for n, xyz in zip(names, places, strict=True)]
        _text(folder / name, *([head] if head else []), *lines, **more)

    def comma(value):
        return f"{value:.3f}".replace(".", ",")

    table("blanks.txt", "", lambda n, x, y, z: f"{n} {x:.3f} {y:.3f} {z:.3f}")
    table("tabs.txt", "", lambda n, x, y, z: f"{n}\t{x:.3f}\t{y:.3f}\t{z:.3f}")
    table("pnez.csv", "", lambda n, x, y, z: f"{n},{y:.3f},{x:.3f},{z:.3f}")
    table("pnez_head.csv", "Point,Northing,Easting,Elevation",
          lambda n, x, y, z: f"{n},{y:.3f},{x:.3f},{z:.3f}")  # fmt: skip
    table("decimal_comma.csv", "", lambda n, x, y, z: f"{n};{comma(x)};{comma(y)};{comma(z)}")
    table(
        "latin1.csv",
        "",
        lambda n, x, y, z: f"Süd {n};{x:.3f};{y:.3f};{z:.3f}\r",
        encoding="latin-1",
    )
    table("tab_comma.txt", "", lambda n, x, y, z: f"{n}\t{comma(x)}\t{comma(y)}\t{comma(z)}")
    table("bom.csv", "", lambda n, x, y, z: f"Paßpunkt {n} Süd;{x:.3f};{y:.3f};{z:.3f}",
          encoding="utf-8-sig")  # fmt: skip
    table("blank_names.txt", "", lambda n, x, y, z: f"GCP {n[3:]} {x:.3f} {y:.3f} {z:.3f}")
    table(
        "duplicate.csv",
        "",
        lambda n, x, y, z: f"{n if n != 'GCP2' else 'GCP1'},{x:.3f},{y:.3f},{z:.3f}",
    )
    table("name_last_head.csv", "E,N,H,Name", lambda n, x, y, z: f"{x:.3f},{y:.3f},{z:.3f},{n}")
    table("name_last.csv", "", lambda n, x, y, z: f"{x:.3f},{y:.3f},{z:.3f},{n}")
    table("zone.csv", "", lambda n, x, y, z: f"{n},32{x:.3f},{y:.3f},{z:.3f}")
    table("no_height.csv", "", lambda n, x, y, z: f"{n},{x:.3f},{y:.3f}")
    table("numbers.csv", "", lambda n, x, y, z: f"{n[3:]},{x:.3f},{y:.3f},{z:.3f}")
    table("thousands.csv", "", lambda n, x, y, z: f'{n},"{x:,.3f}","{y:,.3f}",{z:.3f}')
    table("quoted.csv", "", lambda n, x, y, z: f'"{n}","{x:.3f}","{y:.3f}","{z:.3f}"')
    table("name_sigmas.csv", "name,x,y,z,sx,sy,sz",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f},0.011,0.012,0.023")  # fmt: skip
    table("roles.csv", "point,x,y,z,sx,sy,sz,role",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f},0.01,0.01,0.02,control")  # fmt: skip
    table("capitals.csv", "Point,X,Y,Z", lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}")
    table(
        "comments.csv",
        "# GNSS, May 2024\n#\nPoint,E,N,H",
        lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}",
    )
    table("emlid.csv", "Name,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height,"
          "Lateral RMS,Elevation RMS",
          lambda n, x, y, z: f"{n},{x + 4e5:.3f},{y + 5e6:.3f},{z - GEOID_M:.3f},{x:.9f},{y:.9f},"
          f"{z:.3f},0.01,0.02", degrees)  # fmt: skip
    table("dms.csv", "name;lat;lon;h",
          lambda n, x, y, z: f"{n};{_minutes(y)} N;E {_minutes(x)};{z:.3f}", degrees)  # fmt: skip
    table("west.csv", "name,lat,lon,h",
          lambda n, x, y, z: f"{n},{y:.9f},{-x:.9f},{z:.3f}", degrees)  # fmt: skip
    table("sigma_mm.csv", "name,E,N,H,sdx (mm),sdy (mm),sdz (mm)",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f},8,9,15")  # fmt: skip
    table("title.csv", "Project: Bridge 12\nSurveyor; J. Doe\nPoint,Easting,Northing,Height",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}")  # fmt: skip
    table("leica.txt", "Point ID\tPoint Role\tEasting\tNorthing\tEllip. Height\t3D CQ\t2D CQ\t1D CQ",
          lambda n, x, y, z: f"{n}\tMeasured\t{x:.3f}\t{y:.3f}\t{z:.3f}\t0.02\t0.01\t0.02")  # fmt: skip
    table("trimble.csv", "Point ID,Grid Northing,Grid Easting,Grid Elevation,Feature Code,"
          "Horizontal Precision (95%)",
          lambda n, x, y, z: f"{n},{y:.3f},{x:.3f},{z:.3f},GCP,0.022")  # fmt: skip
    table("topcon.txt", "Name,WGS84 Latitude,WGS84 Longitude,WGS84 Ell.Height (m),HRMS,VRMS",
          lambda n, x, y, z: f"{n},{y:.9f},{x:.9f},{z:.3f},0.011,0.023", degrees)  # fmt: skip
    table("klau.csv", "Filename,Latitude,Longitude,Ellipsoid Height,Sigma N,Sigma E,Sigma U",
          lambda n, x, y, z: f"{n},{y:.9f},{x:.9f},{z:.3f},0.01,0.01,0.02", degrees)  # fmt: skip
    table("aeropoints.csv", "AeroPoint ID,Lat,Lng,Ellipsoidal Height (m),Geoid Height (m)",
          lambda n, x, y, z: f"{n},{y:.9f},{x:.9f},{z:.3f},{z - GEOID_M:.3f}", degrees)  # fmt: skip
    table("japan.csv", "点名,X座標,Y座標,標高", lambda n, x, y, z: f"{n},{y:.3f},{x:.3f},{z:.3f}")
    table("swiss.csv", "Matricule;X;Y;Z",
          lambda n, x, y, z: f"{n};{x:_.3f};{y:_.3f};{z:.3f}".replace("_", "'"))  # fmt: skip
    table("stated.csv", f"# CoordinateSystem: {CRS}\n#Label,X/Easting,Y/Northing,Z/Altitude",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}")  # fmt: skip
    table("dashes.csv", "name,lat,lon,h",
          lambda n, x, y, z: f"{n},{_minutes(y, '-')}N,{_minutes(x, '-')}E,{z:.3f}", degrees)  # fmt: skip
    gk = convert(degrees, "EPSG:4979", "EPSG:31467")
    table("gk.csv", "Name,Rechtswert,Hochwert,Höhe",
          lambda n, x, y, z: f"{n},{x:.3f},{y:.3f},{z:.3f}", gk)  # fmt: skip
    table("points.gsi", "", lambda n, x, y, z: f"*110001+{n:0>16} 81..10+{x * 1000:016.0f}")
    _text(folder / "points.json", '{"type": "FeatureCollection", "features": []}')
    table("latlon.csv", "", lambda n, x, y, z: f"{n},{y:.8f},{x:.8f},{z:.3f}", degrees)
    table(
        "latlon_head.csv",
        "name,lat,lon,height",
        lambda n, x, y, z: f"{n},{y:.8f},{x:.8f},{z:.3f}",
        degrees,
    )
    _gcp_lists(home, grid, utm, degrees, names)


def _minutes(degrees: float, mark: str = "°'\"") -> str:
    minutes = 60 * (degrees % 1)
    first, second, last = mark if len(mark) == 3 else (mark, mark, "")
    return f"{int(degrees)}{first}{int(minutes):02d}{second}{60 * (minutes % 1):08.5f}{last}"


def _gcp_lists(home, grid, utm, degrees, names) -> None:
    """gcp_list.txt with its usual mistakes."""
    at = {old: k for k, old in enumerate(grid.ground["point"])}
    table = grid.marks[["point", "image", "x", "y"]].itertuples(index=False)
    marks = [(at[str(p)], str(i), x + 0.5, y + 0.5) for p, i, x, y in table]

    def listed(name, head, places, image=str, blank=" "):
        rows = [head]
        for k, picture, x, y in marks:
            e, n, h = places[k]
            words = [
                f"{e:.8f}",
                f"{n:.8f}",
                f"{h:.4f}",
                f"{x:.2f}",
                f"{y:.2f}",
                image(picture),
                names[k],
            ]
            rows.append(blank.join(words))
        _text(home / "ground" / name, *rows)

    listed("gcp_list.txt", CRS, utm)
    listed("gcp_tabs.txt", CRS, utm, blank="\t")
    listed("gcp_lower.txt", CRS, utm, str.lower)
    listed("gcp_geoid.txt", CRS, utm - [0, 0, GEOID_M])
    listed("gcp_degrees.txt", "EPSG:4326", degrees)
    listed("gcp_degrees_swapped.txt", "EPSG:4326", degrees[:, [1, 0, 2]])
    listed("gcp_gk.txt", "EPSG:31467", utm)
    listed("gcp_commas.txt", CRS, utm, blank=",")
    rows = (home / "ground" / "gcp_list.txt").read_text(encoding="utf-8").splitlines()
    words = [row.split() for row in rows[1:]]
    change = [[*w[:3], w[4], w[3], *w[5:]] for w in words]
    _text(home / "ground" / "gcp_rows_first.txt", CRS, *map(" ".join, change))
    change = [[*words[0][:3], "4000", "3000", *words[0][5:]], *words[1:]]
    _text(home / "ground" / "gcp_outside.txt", CRS, *map(" ".join, change))
    _text(home / "ground" / "seen_in.csv", *[f"{w[6]},{w[5]},{w[3]},{w[4]}" for w in words])
    listed("gcp_swapped.txt", CRS, utm[:, [1, 0, 2]])
    listed("gcp_compound.txt", "EPSG:25832+7837", utm)
    for name in ("opensfm_gcp", "odm/opensfm"):
        shutil.copy(home / "ground" / "gcp_list.txt", home / name / "gcp_list.txt")


def _stamp(seconds: float, digits: int = 3) -> str:
    """Date and time of a second of the GPS week."""
    when = datetime(1980, 1, 6) + timedelta(weeks=WEEK, seconds=round(seconds, 6))
    text = when.strftime("%Y/%m/%d %H:%M:%S.%f")
    return text[: len(text) - 6 + digits] if digits else text[:-7]


def _tracks(home: Path, block: Block, grid: Block) -> None:
    """The receiver's track in RTKLIB's form, DJI's time marks, and what people make of both."""
    folder = home / "gnss"
    folder.mkdir(exist_ok=True)
    at, rng = block.images["time_s"].to_numpy(float), np.random.default_rng(3)
    centre = block.poses[:, :3]
    time = np.arange(at[0] - 10, at[-1] + 10, 0.2)
    place = np.column_stack([np.interp(time, at, axis) for axis in centre.T])
    place += SIGMA * rng.standard_normal(place.shape)

    def pos(
        name, shift=0.0, system="GPST", quality=None, week=False, drop=None, head=True, by=0.0,
        digits=9, sigma="0.0080   0.0070   0.0150",
    ):  # fmt: skip
        there = PLACE.to_geographic(place + by)
        q = np.ones(len(time), int) if quality is None else quality
        lines = [
            "% program   : RTKPOST ver.demo5 b34k",
            "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,"
            "ns=# of satellites)",
            f"%  {system}                  latitude(deg) longitude(deg)  height(m)   Q  ns   "
            "sdn(m)   "
            "sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio",
        ]
        lines = lines if head else []
        for k, (t, (lon, lat, h)) in enumerate(zip(time + shift, there, strict=True)):
            if drop is not None and drop[k]:
                continue
            when = f"{WEEK} {t:.3f}" if week else _stamp(t)
            lines.append(
                f"{when}   {lat:.{digits}f}   {lon:.{digits}f}   {h:.4f}   {q[k]}  18   {sigma}"
                "   0.0010   0.0010  -0.0010   0.00   99.9"
            )
        _text(folder / name, *lines)

    third = np.where(np.arange(len(time)) % 600 < 200, 2, 1)
    few = np.where(rng.random(len(time)) < 0.07, 5, 1)
    pos("rover.pos")
    rover = (folder / "rover.pos").read_text(encoding="utf-8")
    _text(folder / "geodetic.pos", rover.replace("ellipsoidal,Q", "geodetic,Q").rstrip())
    pos("utc.pos", -LEAP_S, "UTC")
    pos("week.pos", week=True)
    pos("utc_as_gps.pos", -LEAP_S)
    pos("leap17.pos", -(LEAP_S - 1), "UTC")
    pos("float.pos", quality=third)
    pos("few_single.pos", quality=few)
    pos("all_single.pos", quality=np.full(len(time), 5))
    pos("no_head.pos", head=False)
    middle = (at[0] + at[-1]) / 2
    pos("gap.pos", drop=np.abs(time - middle) < 12)
    pos("week_early.pos", -7 * 86400.0)
    pos("next_day.pos", 86400.0)
    pos("bdt_as_gps.pos", -14.0)
    pos("glonass.pos", 3 * 3600.0 - LEAP_S, "GLONASST")
    pos("two.pos", by=np.outer(np.arange(len(time)) % 2, [0.5, 0.0, 0.0]))
    pos("jump.pos", by=np.outer(time > middle, [0.5, 0.4, 0.6]))
    pos("digits.pos", digits=5)
    pos("centimetres.pos", sigma="0.8000   0.7000   1.5000")
    west = rover.replace("   8.5", "   -8.5")
    assert west != rover
    _text(folder / "west.pos", west.rstrip())
    pos("jst.pos", 9 * 3600.0 - LEAP_S, "JST")
    lines = (folder / "rover.pos").read_text(encoding="utf-8").splitlines()
    events = [
        f"{_stamp(t)}   {lat:.9f}   {lon:.9f}   {h:.4f}   1  18   0.0080   0.0070   0.0150   0.0010"
        "   0.0010  -0.0010   0.00   99.9"
        for t, (lon, lat, h) in zip(at, PLACE.to_geographic(centre), strict=True)
    ]
    _text(folder / "rover_events.pos", *lines[:3], *events)
    _text(folder / "rover.24O", "     3.04           OBSERVATION DATA    M (MIXED)           "
          "RINEX VERSION / TYPE")  # fmt: skip
    shutil.copy(folder / "rover.24O", folder / "rinex.pos")
    _text(folder / "log.nmea", "$GPGGA,082000.00,4900.6,N,00833.0,E,4,18,0.7,160.1,M,47.9,M,,*5C")
    _text(folder / "pospac.txt", "POSPac MMS 8.4 Export", "TIME, EASTING, NORTHING")
    _text(
        folder / "comma.csv",
        "time_s;x;y;z",
        *[f"{t:.1f};1,0;2,0;3,0".replace(".", ",") for t in time[:9]],
    )
    table = ["time_s,x,y,z,quality"]
    table += [
        f"{t:.3f},{x:.4f},{y:.4f},{z:.4f},1" for t, (x, y, z) in zip(time, place, strict=True)
    ]
    _text(folder / "track.csv", *table)
    utm = grid.offset + np.column_stack([np.interp(time, at, axis) for axis in grid.poses[:, :3].T])
    table = ["time_s,x,y,z,quality"]
    table += [f"{t:.3f},{x:.4f},{y:.4f},{z:.4f},1" for t, (x, y, z) in zip(time, utm, strict=True)]
    _text(folder / "utm.csv", *table)
    block.images.to_csv(folder / "images.csv", index=False)
    thousand = block.images[["image"]].assign(time_s=1000.0 * (at % 86400.0))
    thousand.to_csv(folder / "milliseconds.csv", index=False)
    degrees = PLACE.to_geographic(place)
    table = [
        "time_s,x,y,z",
        *(f"{t:.3f},{x:.9f},{y:.9f},{z:.3f}" for t, (x, y, z) in zip(time, degrees, strict=True)),
    ]
    _text(folder / "degrees.csv", *table)

    def marks(name, week=WEEK, flag=50, skip=(), bom=False, shift=0.0):
        rows = []
        for k, (t, (lon, lat, h)) in enumerate(zip(at, PLACE.to_geographic(centre), strict=True)):
            if k + 1 in skip:
                continue
            rows.append(
                f"{k + 1}\t{t + np.broadcast_to(shift, len(at))[k]:.6f}\t[{week}]\t   0,N\t   0,E\t   0,V\t{lat:.9f},Lat"
                f"\t{lon:.9f},Lon"
                f"\t{h:.4f},Ellh\t0.012010, 0.011500, 0.025000\t{flag},Q"
            )
        _text(folder / name, *rows, encoding="utf-8-sig" if bom else "utf-8")

    marks("flight.MRK")
    marks("rollover.MRK", week=WEEK - 1024)
    marks("week_before.MRK", week=WEEK - 1)
    marks("no_fix.MRK", flag=16)
    marks("drift.MRK", shift=0.01 * (at - at.mean()))
    marks("jumped.MRK", shift=0.7 * (np.arange(len(at)) > 18))
    marks("bom.MRK", bom=True)
    marks("one_less.MRK", skip=(7,))
    shutil.copytree(home / "own", home / "own_gnss", dirs_exist_ok=True)


def _photographs(home: Path, block: Block) -> None:
    """Photographs of nothing, with times: the names, DJI's marks beside them, EXIF of each kind."""
    picture = np.full((792, 1056), 128, np.uint8)
    start = datetime(1980, 1, 6) + timedelta(weeks=WEEK)

    def folder_of(
        name, zone=None, decimals=True, skip=(), marks=True, media=False, local_s=-LEAP_S, xmp=None
    ):
        folder = home / name
        for k, (image, t) in enumerate(
            block.images[["image", "time_s"]].itertuples(index=False), start=1
        ):
            if k in skip:
                continue
            when = start + timedelta(seconds=float(t) + local_s)
            exif = Image.Exif()
            own = exif.get_ifd(0x8769)
            own[36867] = when.strftime("%Y:%m:%d %H:%M:%S")
            if decimals:
                own[37521] = f"{when.microsecond:06d}"
            if zone:
                own[36881] = zone
            place = folder / (f"{100 + k // 15}MEDIA" if media else ".")
            place.mkdir(parents=True, exist_ok=True)
            more = {}
            if xmp:
                lon, lat, height = PLACE.to_geographic(block.poses[k - 1 : k, :3])[0]
                gps = {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 6: height}
                exif.get_ifd(0x8825).update(gps)
                more = {"xmp": (XMP % xmp(lat, lon)).encode()}
            Image.fromarray(picture).save(place / image, exif=exif, quality=30, **more)
        if marks:
            shutil.copy(home / "gnss" / "flight.MRK", folder / "DJI_Timestamp.MRK")

    folder_of("photos")
    folder_of("photos_deleted", skip=(5,))
    folder_of("photos_media", media=True)
    folder_of("photos_zone", zone="+02:00", marks=False, local_s=2 * 3600 - LEAP_S)
    folder_of("photos_no_zone", marks=False, local_s=2 * 3600 - LEAP_S)
    folder_of("photos_zero", marks=False, xmp=lambda lat, lon: (0.0, 0.0))
    folder_of("photos_two", marks=False, xmp=lambda lat, lon: (lat + 1e-4, lon))
    folder_of("photos_seconds", decimals=False, marks=False, local_s=0.0)


def _readouts(home: Path, short: bool) -> None:
    """Photographs of a LED, a star and a wheel, whose readout is known: 25 ms, 30 ms."""
    folder = home / "readout"
    folder.mkdir(exist_ok=True)
    camera = Camera.from_table("small", {"width": 480, "height": 360, "f": 480.0})
    view = render.View(camera, 1.0)

    def saved(name, light, noise=0.01, **more):
        cv2.imwrite(str(folder / name), render.develop(light, noise=noise, seed=1, **more))

    for name, hertz, exposure in (
        ("led500.jpg", 500.0, 0.0003), ("led2k.jpg", 2000.0, 0.00005),
        ("led100.jpg", 100.0, 0.0003),
        ("led_period.jpg", 500.0, 0.002),
    ):  # fmt: skip
        saved(name, render.led(camera, render.Shutter(0.03, exposure), hertz))
    cv2.imwrite(str(folder / "grey.png"), np.full((360, 480), 120, np.uint8))
    drawn = {
        "star": (render.star, {"sectors": 16, "radius": 0.3}, 3.0),
        "wheel": (
            render.wheel, {"radius": 0.3, "spokes": 24, "crosses": 2, "spoke_width": 0.006}, 1.5,
        ),
    }  # fmt: skip
    for name, (draw, more, turns) in () if short else drawn.items():
        for word, speed, phase in (("still", 0.0, 10.0), ("turning", turns, 17.0)):
            light = draw(view, render.Shutter(0.03, 0.0003), speed, phase_deg=phase, **more)
            saved(f"{name}_{word}.png", light, 0.005, blur_px=0.5)
    if not short:
        light = render.star(view, render.Shutter(0.03, 0.0003), 0.0, phase_deg=50.0,
                            sectors=16, radius=0.3)  # fmt: skip
        saved("star_again.png", light, 0.005, blur_px=0.5)
        still = cv2.imread(str(folder / "star_still.png"))
        cv2.imwrite(str(folder / "star_turned.png"), np.rot90(still))


def _series(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    _text(folder / "series.csv", "image;temperature_c", "a.png;20")
    (folder / "none").mkdir(exist_ok=True)
    (folder / "none" / "about.json").write_text(json.dumps({}), encoding="utf-8")


def _changed_tables(home: Path) -> None:
    """Names and numbers as a spreadsheet or another program leaves them."""
    for name in ("spreadsheet_names", "shares", "milliseconds", "other_heights"):
        shutil.copytree(home / "own", home / name, dirs_exist_ok=True)

    def changed(block, table, **columns):
        path = home / block / f"{table}.csv"
        rows = pd.read_csv(path, dtype={"point": str})
        rows.assign(**columns).to_csv(path, index=False)

    changed("spreadsheet_names", "ground", point=lambda t: t["point"].str.replace("G", "0"))
    number = lambda t: t["point"].str.replace("G", "").astype(float).astype(str)  # noqa: E731
    changed("spreadsheet_names", "marks", point=number)
    changed("shares", "marks", x=lambda t: t["x"] / 1056, y=lambda t: t["y"] / 792)
    changed("milliseconds", "images", time_s=lambda t: 1000 * t["time_s"])
    for table in ("images", "points", "ground", "gnss"):
        changed("other_heights", table, z=lambda t: t["z"] - GEOID_M)


def _strange(home: Path, grid: Block) -> None:
    """What is no project, no track or no sound block, as people have it lying about."""
    folder = home / "strange"
    (folder / "heic").mkdir(parents=True, exist_ok=True)
    (folder / "half.files").mkdir(exist_ok=True)
    (folder / "heic" / "IMG_0001.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    (folder / "half.files" / "project.zip").write_bytes(b"PK")
    _text(folder / "river.rspj", "{}")
    _text(folder / "image.dat", "1 153.0", "1001 10.5 -3.2", "-99")
    rows = [
        ",".join([name, *(f"{v:.3f}" for v in pose[:3])])
        for name, pose in zip(grid.images["image"], grid.poses, strict=True)
    ]
    _text(folder / "external.csv", "#name,x,y,alt", *rows)
    head = ["Project: x", "Program: GrafNav Version 8.90", "", "Week GPSTime Latitude"]
    _text(home / "gnss" / "units.txt", *head, "(weeks) (sec) (deg) (m) (m)", f"{WEEK} 1 49.0")
    _text(home / "gnss" / "other.csv", "Timestamp,Lat,Lon,Alt,Quality", "1.5,49.0,8.5,160,Fixed")
    _changed_tables(home)
    for name in ("attitude_zero", "rig_alone", "cx_middle"):
        shutil.copytree(home / "own", home / name, dirs_exist_ok=True)
    image = grid.images["image"].iloc[0]
    _text(home / "attitude_zero" / "attitudes.csv", "image,qw,qx,qy,qz", f"{image},0,0,0,0")
    with (home / "rig_alone" / "block.toml").open("a", encoding="utf-8") as file:
        file.write("[camera.side]\nwidth = 1056\nheight = 792\nf = 976.0\n")
        file.write('[rig.head]\nbase = "M3E"\n[rig.head.member.side]\n')
    path = home / "cx_middle" / "block.toml"
    path.write_text(re.sub(r"cx = .*", "cx = 1.5", path.read_text(encoding="utf-8")))
