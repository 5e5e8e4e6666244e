"""Focal length and principal point of each picture of a static camera, from ground points.

The camera stands still, so its pose is that of its first pictures. Held, f, cx and cy of each
picture follow from its marks alone; let free with them, the pose takes up what they would show.
Source: Zhou 2019, section 6.4.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.brief import brief
from corridor.camera import INTERIOR, project, projection_derivatives
from corridor.errors import InputError
from corridor.geometry import rotation_from_quaternion, rotation_from_vector

PARAMETERS = ("f", "cx", "cy")
_LEAST = 4


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
