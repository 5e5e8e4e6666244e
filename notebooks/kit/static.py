"""A camera that stands still before surveyed points and warms."""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.camera import Camera, project, undistort
from corridor.errors import InputError
from corridor.simulation import CAMLIGHT


def static_block(
    images: int = 263,
    points: int = 21,
    depth_m: tuple[float, float] = (8.8, 22.0),
    temperature_c: tuple[float, float] = (30.6, 45.7),
    minutes: float = 26.0,
    camera: Camera = CAMLIGHT,
    seed: int = 0,
) -> Block:
    """Error-free block of a static camera: one pose, marks on surveyed points in every image.

    depth_m: of the nearest and the farthest point (22 m: 4 mm a pixel). temperature_c: of the
    first and the last image, with a time constant of half the `minutes`.
    Source: thesis, table 6.6.
    """
    if images < 1 or points < 4 or not 0 < depth_m[0] < depth_m[1]:
        raise InputError(
            f"{images} images of {points} points from {depth_m[0]:g} to {depth_m[1]:g} m make no "
            "resection: one image, four points and two depths at least"
        )
    draw = np.random.default_rng([seed, 6])
    size = np.array([camera.width, camera.height])
    pixel = draw.uniform(0.05, 0.95, (points, 2)) * (size - 1)
    depth = np.linspace(*depth_m, points)
    ray = np.column_stack([undistort(pixel, camera.interior), np.ones(points)])
    # The camera looks along y: x right, z up.
    rotation = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    centre = np.array([0.0, 0.0, 1.5])
    place = centre + (depth[:, None] * ray) @ rotation
    seen = project(place, centre, rotation, camera.interior)
    time = np.linspace(0, 60 * minutes, images)
    first, last = temperature_c
    follow = (1 - np.exp(-time / (30 * minutes))) / (1 - np.exp(-2.0))
    image = [f"S{n + 1:03d}" for n in range(images)]
    name = [f"G{n + 1:02d}" for n in range(points)]
    half = np.sqrt(0.5)
    table = pd.DataFrame(
        {
            "image": image, "camera": camera.name, "time_s": time,
            "temperature_c": first + (last - first) * follow, "x": centre[0], "y": centre[1],
            "z": centre[2], "qw": half, "qx": half, "qy": 0.0, "qz": 0.0,
        }
    )  # fmt: skip
    return Block(
        name="static",
        cameras={camera.name: camera},
        images=table,
        marks=pd.DataFrame(
            {
                "point": np.tile(name, images), "image": np.repeat(image, points),
                "x": np.tile(seen[:, 0], images), "y": np.tile(seen[:, 1], images),
            }
        ),
        ground=pd.DataFrame(
            {"point": name, **dict(zip("xyz", place.T, strict=True)), "role": "control"}
        ),
        sigma={"mark_px": 0.1},
        description=f"{images} images of a static camera, free of error",
    )  # fmt: skip
