"""A camera that stands still before surveyed points and warms: simulated, and resected.

The camera stands still, so its pose is that of its first pictures. Held, f, cx and cy of each
picture follow from its marks alone; let free with them, the pose takes up what they would show.
Source: Zhou 2019, section 6.4.3 and table 6.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.camera import INTERIOR, Camera, project, projection_derivatives, undistort
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion, rotation_from_vector
from corridor.core.simulation import CAMLIGHT

PARAMETERS = ("f", "cx", "cy")
_LEAST = 4


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


@brief
@dataclass(frozen=True, eq=False)
class Resection:
    """f, cx, cy of each picture, and how they follow temperature.

    pictures: image, temperature_c, points, f, cx, cy (px), sf, scx, scy, rms_px. slopes: one row a
    parameter: parameter, slope (px/C), sigma (from the marks' sigmas), empirical (from the
    scatter about the line), at_c and value: the line's middle. correlation: largest of each
    parameter with the pose (0 where the pose is held).
    """

    pictures: pd.DataFrame
    slopes: pd.DataFrame
    correlation: dict[str, float]


def resect(block: Block, pose: str = "held", first: int = 10) -> Resection:
    """f, cx and cy of each image of a static camera, from its marks on ground points.

    pose: `held` at that of the first images together, `stated` as images.csv has it, or `free`
    in each image. first: how many images the held pose is found from.
    Raises InputError where an image shows fewer than four points, or has no temperature.
    """
    if pose not in ("held", "stated", "free"):
        raise InputError(f"pose = {pose!r} is unknown: use held, stated or free")
    if len(block.cameras) != 1:
        raise InputError(f"block {block.name} has {len(block.cameras)} cameras: give one of them")
    (camera,) = block.cameras.values()
    place = block.positions("marks")[block.marks["point"].array.codes]
    seen = block.marks[["x", "y"]].to_numpy(float)
    sigma, image = block.mark_sigma(), block.image_rows("marks")
    known = np.isfinite(place).all(axis=1)
    warm = block.column("images", "temperature_c")
    centre, rotation = block.poses[:, :3], rotation_from_quaternion(block.poses[:, 3:])
    pictures = [np.flatnonzero(known & (image == n)) for n in range(len(block.images))]
    for n, rows in enumerate(pictures):
        name = block.images["image"].iloc[n]
        if len(rows) < _LEAST:
            raise InputError(
                f"marks.csv: image {name} shows {len(rows)} ground points: it needs {_LEAST}"
            )
        if not np.isfinite(warm[n]):
            raise InputError(f"{block.where('images', n)}: image {name} has no temperature_c")
    order = np.argsort(block.column("images", "time_s"), kind="stable")
    start = order[0]
    stand = centre[start], rotation[start]
    if pose == "held":
        rows = np.concatenate([pictures[n] for n in order[:first]])
        stand, _, _, _ = _resected(
            place[rows], seen[rows], sigma[rows], camera.interior, *stand, np.zeros(0, int), True
        )
    table, largest = [], np.zeros(3)
    free = np.array([INTERIOR.index(name) for name in PARAMETERS])
    for n, rows in enumerate(pictures):
        own = (centre[n], rotation[n]) if pose != "held" else stand
        _, interior, covariance, rms = _resected(
            place[rows], seen[rows], sigma[rows], camera.interior, *own, free, pose == "free"
        )
        spread = np.sqrt(np.diag(covariance))
        if pose == "free":
            # One parameter against the pose as a whole: the multiple correlation.
            inner = np.linalg.inv(covariance[3:, 3:])
            part = np.einsum("ia,ab,ib->i", covariance[:3, 3:], inner, covariance[:3, 3:])
            largest += np.sqrt(np.clip(part / spread[:3] ** 2, 0, 1)) / len(pictures)
        table.append([*interior[free], *spread[:3], rms])
    pictures_table = pd.DataFrame(
        {
            "image": block.images["image"].to_numpy(), "temperature_c": warm,
            "points": [len(rows) for rows in pictures],
        }
    )  # fmt: skip
    pictures_table[["f", "cx", "cy", "sf", "scx", "scy", "rms_px"]] = np.array(table)
    return Resection(
        pictures_table, _slopes(pictures_table), dict(zip(PARAMETERS, largest, strict=True))
    )


def _resected(place, seen, sigma, interior, centre, rotation, free, pose_free):
    """Gauss-Newton of one picture: pose (if free), interior, covariance and RMS px an axis."""
    interior, centre, rotation = interior.copy(), centre.copy(), rotation.copy()
    weight = np.repeat(1.0 / sigma, 2)
    for _ in range(30):
        left = (seen - project(place, centre, rotation, interior)).ravel()
        derivatives = projection_derivatives(place, centre, rotation, interior)
        design = derivatives.by_interior[:, :, free]
        if pose_free:
            design = np.concatenate([design, derivatives.by_pose], axis=2)
        design = design.reshape(2 * len(place), -1)
        scaled = design * weight[:, None]
        size = np.linalg.norm(scaled, axis=0)
        inverse = np.linalg.inv((scaled / size).T @ (scaled / size)) / np.outer(size, size)
        step = inverse @ (scaled.T @ (weight * left))
        interior[free] += step[: len(free)]
        if pose_free:
            centre += step[len(free) : len(free) + 3]
            rotation = rotation_from_vector(step[len(free) + 3 :]) @ rotation
        if np.max(np.abs(step * size), initial=0.0) < 1e-8:
            break
    rms = float(np.sqrt(np.mean(left**2)))
    return (centre, rotation), interior, inverse, rms


def _slopes(table):
    rows = []
    warm = table["temperature_c"].to_numpy()
    for name in PARAMETERS:
        value, sigma = table[name].to_numpy(), table[f"s{name}"].to_numpy()
        weight = 1.0 / sigma**2
        middle = np.average(warm, weights=weight)
        across = np.sum(weight * (warm - middle) ** 2)
        if not across > 0:
            raise InputError("all pictures have one temperature: a slope needs two")
        slope = float(np.sum(weight * (warm - middle) * value) / across)
        mean = float(np.average(value, weights=weight))
        left = value - mean - slope * (warm - middle)
        scatter = np.sqrt(np.sum(weight * left**2) / (len(value) - 2)) if len(value) > 2 else np.nan
        formal = float(across**-0.5)
        rows.append([name, slope, formal, formal * scatter, float(middle), mean])
    return pd.DataFrame(rows, columns=["parameter", "slope", "sigma", "empirical", "at_c", "value"])
