"""A ring of pictures around a pylon: convergent, every second one turned by 90 degrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import Camera, project
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation
from corridor.core.simulation import CAMLIGHT

# Steepest angle between a ray and the surface's normal: a matcher gives up before a target does.
_TIE, _TARGET = np.cos(np.radians(40)), np.cos(np.radians(65))
_BORDER = 10.0  # px


def ring_block(
    stations: int = 14,
    distance_m: float = 5.5,
    radius_m: float = 1.5,
    height_m: float = 4.0,
    points: int = 1500,
    control: int = 13,
    temperature_c: tuple[float, float] = (23.0, 31.0),
    minutes: float = 14.0,
    camera: Camera = CAMLIGHT,
    closed: bool = True,
    seed: int = 0,
) -> Block:
    """Error-free block around a pylon: start values are the truth.

    stations: from the first to the last, which stands where the first stood; two pictures each,
        the second turned by 90 degrees. distance_m: from the pylon's axis. radius_m, height_m: of
        the pylon, on which all points lie.
    temperature_c: of the first and the last picture, with a time constant of half the `minutes`.
    closed: pictures at either end share tie points; else those of the second half of the ring
        have names of their own (`T00012+`), which are the same places.
    Source: thesis, section 6.5.1 (28 pictures, 13 control points, 23 to 31 C in 14 min).
    """
    if stations < 6 or not distance_m > 2 * radius_m > 0:
        raise InputError(
            f"{stations} stations at {distance_m:g} m cannot stand around a pylon of radius "
            f"{radius_m:g} m: take six or more, at twice the radius at least"
        )
    draw = np.random.default_rng([seed, 5])
    angle = np.repeat(np.linspace(0, 2 * np.pi, stations), 2)
    turned = np.tile([False, True], stations)
    count = len(angle)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    wobble = 0.15 * draw.standard_normal((count, 3))
    centre = distance_m * out + wobble + [0, 0, 1.6]
    aim = 0.1 * draw.standard_normal((count, 3)) + [0, 0, height_m / 2]
    rotation = np.stack([_looking(c, a, t) for c, a, t in zip(centre, aim, turned, strict=True)])
    around, up = draw.uniform(0, [[2 * np.pi], [height_m]], (2, points))
    place, normal = _on_pylon(around, up, radius_m)
    # Targets are put where pictures show them: evenly around, away from top and foot.
    around = 2 * np.pi * (np.arange(control) + draw.uniform(0.3, 0.7, control)) / control
    marked, face = _on_pylon(around, draw.uniform(0.25, 0.75, control) * height_m, radius_m)
    time = np.linspace(0, 60 * minutes, count)
    first, last = temperature_c
    follow = (1 - np.exp(-time / (30 * minutes))) / (1 - np.exp(-2.0))
    image = [f"P{n + 1:02d}" for n in range(count)]
    name = camera.name
    images = pd.DataFrame(
        {
            "image": image, "camera": name, "flight": "ring", "time_s": time,
            "temperature_c": first + (last - first) * follow, **_xyz(centre),
        }
    )  # fmt: skip
    images[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(rotation)
    late = np.arange(count) >= count // 2
    ties = _seen(place, normal, centre, rotation, camera, _TIE)
    label = np.array([f"T{n:05d}" for n in range(points)], dtype=object)
    # The ring is cut where it begins: on its far side both halves go on sharing points.
    facing = np.cos(np.arctan2(place[:, 1], place[:, 0])) > 0
    tie_label = [
        label[p] + "+" if not closed and late[i] and facing[p] else label[p]
        for p, i in zip(*ties[:2], strict=True)
    ]
    tie = pd.DataFrame({"point": tie_label, "image": np.array(image)[ties[1]], **_xy(ties[2])})
    where = pd.DataFrame({"point": tie_label, **_xyz(place[ties[0]])})
    rays = tie.groupby("point")["image"].transform("size")
    tie, where = tie[rays >= 2].reset_index(drop=True), where[rays >= 2]
    marks = _seen(marked, face, centre, rotation, camera, _TARGET)
    ground = [f"G{n + 1:02d}" for n in range(control)]
    return Block(
        name="ring",
        cameras={name: replace(camera, calibrated=False)},
        images=images,
        tie_points=tie,
        points=where.drop_duplicates("point").reset_index(drop=True),
        marks=pd.DataFrame(
            {
                "point": np.array(ground)[marks[0]], "image": np.array(image)[marks[1]],
                **_xy(marks[2]),
            }
        ),
        ground=pd.DataFrame(
            {"point": ground, **_xyz(marked), "role": ["control"] * control}
        ),
        sigma={"tie_px": 0.5, "mark_px": 0.5},
        description=f"{count} pictures around a pylon, free of error",
    )  # fmt: skip


def _looking(centre, aim, turned):
    """Rotation, world to camera, that looks at `aim`: y down, or turned by 90 degrees."""
    ahead = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    return np.stack([down, -right, ahead] if turned else [right, down, ahead])


def _on_pylon(angle, height, radius):
    """Places and normals (n, 3)."""
    normal = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    place = radius * normal
    place[:, 2] = height
    return place, normal


def _seen(place, normal, centre, rotation, camera, steepest):
    """Points, images and pixels (n, 2) of what the pictures show."""
    last = np.array([camera.width, camera.height]) - 1 - _BORDER
    found = []
    for n in range(len(centre)):
        ray = centre[n] - place
        steep = np.sum(ray * normal, axis=1) / np.linalg.norm(ray, axis=1)
        pixel = project(place, centre[n], rotation[n], camera.interior)
        rows = np.flatnonzero(
            np.all((pixel >= _BORDER) & (pixel <= last), axis=1) & (steep > steepest)
        )
        found.append((rows, np.full(len(rows), n), pixel[rows]))
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


def _xyz(points):
    return dict(zip("xyz", points.T, strict=True))


def _xy(pixels):
    return {"x": pixels[:, 0], "y": pixels[:, 1]}
