"""One image straight above five points: what an effect moves can be worked out by hand."""

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.effects import Context, Images, predict

# Camera above the origin, looking straight down, x of the picture to the east, y to the south.
HEIGHT, F, WIDTH, LINES = 50.0, 5000.0, 4001, 3001
NADIR = {"qw": 0.0, "qx": 1.0, "qy": 0.0, "qz": 0.0}
# Pixels at the middle and on the four edges: rays (x - 2000) / f, (y - 1500) / f.
MIDDLE, TOP, BOTTOM, LEFT, RIGHT = (0, 0), (0, -1500), (0, 1500), (-2000, 0), (2000, 0)
SPOTS = (MIDDLE, TOP, BOTTOM, LEFT, RIGHT)


def hovering(velocity=(0, 0, 0), rate=(0, 0, 0), row_direction="down", **columns):
    """One nadir image over five ground points that show at the middle and the edges."""
    lens = Camera.from_table(
        "c", {"width": WIDTH, "height": LINES, "f": F, "row_direction": row_direction}
    )
    image = {"image": "a", "camera": "c", "time_s": 0.0, "x": 0.0, "y": 0.0, "z": HEIGHT} | NADIR
    image |= dict(zip(("vx", "vy", "vz"), velocity, strict=True))
    image |= dict(zip(("wx", "wy", "wz"), rate, strict=True))
    names = ["middle", "top", "bottom", "left", "right"]
    ground = np.array([(dx, -dy) for dx, dy in SPOTS]) * HEIGHT / F
    return Block(
        name="one",
        cameras={"c": lens},
        images=pd.DataFrame([image | columns]),
        tie_points=pd.DataFrame({"point": names, "image": "a", "x": 0.0, "y": 0.0}),
        points=pd.DataFrame({"point": names, "x": ground[:, 0], "y": ground[:, 1], "z": 0.0}),
        gnss=pd.DataFrame({"image": ["a"], "x": 0.0, "y": 0.0, "z": HEIGHT}),
    )


def seen(block, **values):
    """Predicted points, from the principal point."""
    return predict(block, values).tie - [(WIDTH - 1) / 2, (LINES - 1) / 2]


def context(block):
    images = Images.of(block)
    return Context(images, np.arange(len(block.images)))
