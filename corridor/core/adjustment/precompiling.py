"""Kernels that an adjustment needs late, compiled by a second process while it needs others.

Where nothing is compiled yet, half the time of a first adjustment goes by in this way.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pandas as pd

from corridor.core.adjustment.model import Loss
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.problem import make_problem
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.engine.compiled import meanwhile
from corridor.core.engine.interface import engine
from corridor.core.engine.scene import Asked, Inverse

# Three images in a row over nine points.
_HEIGHT, _BASE, _F = 100.0, 20.0, 1000.0


@contextmanager
def precompiled_aside() -> Iterator[None]:
    """Have late kernels compiled by a second process, for as long as the `with` lasts.

    Where they are compiled already, nothing is started.
    """
    if engine().ready():
        yield
        return
    with meanwhile(
        "from corridor.core.adjustment.precompiling import compile_late; compile_late()"
    ):
        yield


def compile_late() -> None:
    """Compile, in the order in which an adjustment needs them, the kernels that are `late`."""
    p = make_problem(_small_block())
    normal, state, count = Normal(p, Loss()), p.start, len(p.ptr) - 1
    normal.stand_at(state)
    assert normal.assembled is not None
    scene = normal.scene_of_exposures(normal.assembled, normal.modelled, 0, count)
    n, q = p.image_count * p.d, p.shared_count
    normal.substitute(state, 0.0, np.zeros((p.image_count, p.d)), np.zeros(q))
    known = Inverse(normal.blocks.storage, np.zeros(n * q), np.zeros(q * q), q)
    asked = Asked(
        np.full(count, -1), np.zeros(0, dtype=np.int64), np.zeros((count, 6)), np.zeros((0, 3, 0))
    )
    normal.of_exposures.point_covariance(scene, known, asked)


def _small_block() -> Block:
    """Images that look straight down; types of arrays are those of any block."""
    images, points = pd.Index(["1", "2", "3"]), [f"P{k}" for k in range(9)]
    x = _BASE * np.arange(3.0)
    down = {"z": _HEIGHT, "qw": 0.0, "qx": 1.0, "qy": 0.0, "qz": 0.0}
    ground = np.array([(a, b) for a in x for b in (-_BASE, 0.0, _BASE)])
    # Seen from the east-most image to the west-most, point by point.
    east = np.repeat(ground[:, 0], 3) - np.tile(x, 9)
    north = np.repeat(ground[:, 1], 3)
    scale = _F / _HEIGHT
    return Block(
        "small",
        {"C": Camera.from_table("C", {"width": 1000, "height": 1000, "f": _F})},
        pd.DataFrame({"image": images, "camera": "C", "x": x, "y": 0.0, **down}),
        tie_points=pd.DataFrame(
            {
                "point": np.repeat(points, 3),
                "image": np.tile(images, 9),
                "x": 499.5 + scale * east,
                "y": 499.5 - scale * north,
            }
        ),
        points=pd.DataFrame({"point": points, "x": ground[:, 0], "y": ground[:, 1], "z": 0.0}),
    )
