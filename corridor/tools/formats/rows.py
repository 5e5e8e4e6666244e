"""A block as plain arrays, for whoever writes or proves a project."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from corridor.core.block import POSE, Block
from corridor.core.camera import image_to_ray, project, undistort
from corridor.core.effects import stated_lever_arms
from corridor.core.errors import InputError
from corridor.core.geometry import Rays, meeting_points, rotation_from_quaternion


@dataclass
class Rows:
    """Observations of tie points, then of marks; points alike.

    image, point (m,): codes. pixels (m, 2) px. ties: how many of the points are tie points.
    positions (p, 3), rotation (n, 3, 3), centre (n, 3): metres, world to camera. middle (n, 2): of
    each picture, px. backwards: the distortion goes from the image to the ray.
    """

    image_names: list[str]
    point_names: pd.Index
    ties: int
    image: np.ndarray
    point: np.ndarray
    pixels: np.ndarray
    interior: np.ndarray
    rotation: np.ndarray
    centre: np.ndarray
    positions: np.ndarray
    middle: np.ndarray
    backwards: bool = False

    @cached_property
    def translation(self) -> np.ndarray:
        """(n, 3): t = -R C."""
        return -np.einsum("nij,nj->ni", self.rotation, self.centre)

    def only(self, kept: np.ndarray) -> "Rows":
        """Those of the observations (m,) that are kept."""
        parts = {name: getattr(self, name)[kept] for name in ("image", "point", "pixels")}
        return self if kept.all() else replace(self, **parts)

    def posed(self) -> "Rows":
        """Those in images with a pose."""
        return self.only(np.isfinite(self.centre).all(axis=1)[self.image])

    def usable(self) -> "Rows":
        """Those in images with a pose, of points with coordinates."""
        posed = self.posed()
        return posed.only(np.isfinite(self.positions).all(axis=1)[posed.point])

    def rays(self) -> np.ndarray:
        """(m, 2) rays of the observations; NaN where a pixel has none."""
        if not self.backwards:
            return undistort(self.pixels, self.interior, self.image)
        rays = np.empty_like(self.pixels)
        different, which = np.unique(self.interior, axis=0, return_inverse=True)
        which = which.ravel()[self.image]
        for k, interior in enumerate(different):
            rays[which == k] = image_to_ray(self.pixels[which == k], interior)
        return rays

    def undistorted_residuals(self) -> np.ndarray:
        """(m, 2) px of an image free of distortion; NaN behind the camera."""
        ahead = self.positions[self.point] - self.centre[self.image]
        ahead = np.einsum("nij,nj->ni", self.rotation[self.image], ahead)
        seen = ahead[:, :2] / np.where(ahead[:, 2:] > 0, ahead[:, 2:], np.nan)
        return (self.rays() - seen) * self.interior[self.image, :1]

    def residuals(self) -> np.ndarray:
        """(m, 2) px, measured minus modelled; NaN behind the camera or without coordinates."""
        if self.backwards:
            return self.undistorted_residuals()
        out = np.empty_like(self.pixels)
        step = 500_000  # nothing of the whole project's size but the answer
        for first in range(0, len(self.image), step):
            part = slice(first, first + step)
            image = self.image[part]
            out[part] = self.pixels[part] - project(
                self.positions[self.point[part]], self.centre[image], self.rotation[image],
                self.interior, image,
            )  # fmt: skip
        return out

    def intersected(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (k, 3) of points (k,); NaN with fewer than two rays that meet."""
        place = np.full(len(self.positions), -1)
        place[points] = np.arange(len(points))
        seen = self.only(place[self.point] >= 0)
        ray = seen.rays()
        good = np.isfinite(ray).all(axis=1)
        pixel = 1.0 / self.interior[:, 0]
        rays = Rays(seen.image[good], ray[good], self.rotation, self.centre, pixel)
        return meeting_points(rays, place[seen.point][good], len(points))


def rows_of(block: Block, complete: bool = True) -> Rows:
    """The arrays of a block; ground points take measured coordinates (points.csv) if it has them.

    complete: points without coordinates are intersected, and what is still missing is an
    InputError; else it is NaN.
    """
    images, pose = block.images, block.poses
    if complete and np.isnan(pose).any():
        name = images["image"].iloc[int(np.argmax(np.isnan(pose).any(axis=1)))]
        raise InputError(
            f"image {name} has no pose; adjust the block first and export the adjusted one"
        )
    ties, marks = block.tie_points, block.marks
    names = [ties["point"].cat.categories, marks["point"].cat.categories]
    image = np.concatenate([block.image_rows("tie_points"), block.image_rows("marks")])
    point = np.concatenate([_codes(ties), _codes(marks) + len(names[0])])
    positions = np.concatenate([block.positions("tie_points"), _marked(block)])
    made = Rows(
        list(images["image"]),
        names[0].append(names[1]),
        len(names[0]),
        image,
        point,
        np.concatenate([ties[["x", "y"]].to_numpy(), marks[["x", "y"]].to_numpy()]),
        np.array([block.cameras[name].interior for name in images["camera"]]),
        rotation_from_quaternion(pose[:, 3:]),
        pose[:, :3],
        positions,
        np.array([(block.cameras[c].width, block.cameras[c].height) for c in images["camera"]]) / 2
        - 0.5,
    )
    unknown = np.isnan(positions).any(axis=1)
    if unknown.any() and len(image):
        found = made.intersected(np.flatnonzero(unknown))
        made.positions[unknown] = found
        if complete and np.isnan(found).any():
            name = made.point_names[np.isnan(made.positions).any(axis=1)][0]
            raise InputError(
                f"point {name} has no coordinates and no two rays to intersect; adjust the block "
                "first and export the adjusted one"
            )
    return made


def _codes(table):
    # pandas keeps few names in int8: adding to that overflows.
    return table["point"].array.codes.astype(np.int64)


def _marked(block):
    """Ground points as the adjustment found them, else as they were given."""
    names = block.marks["point"].cat.categories
    out = np.full((len(names), 3), np.nan)
    for table in (block.ground, block.points):
        at = names.get_indexer(table["point"])
        xyz = table[["x", "y", "z"]].to_numpy(float)
        known = (at >= 0) & np.isfinite(xyz).all(axis=1)
        out[at[known]] = xyz[known]
    return out


def camera_positions(block: Block) -> pd.DataFrame:
    """Camera centres that GNSS gives: antenna minus the flight's lever arm, P - R' a.

    image, x, y, z, sx, sy, sz; empty without GNSS. Images without pose keep the antenna.
    """
    table = block.gnss[["image", "x", "y", "z"]].copy()
    if not len(table):
        return table
    table[["sx", "sy", "sz"]] = block.gnss_sigma()
    image = block.image_rows("gnss")
    arm = stated_lever_arms(block)[block.image_flight[image]]
    if arm.any() and set(POSE) <= set(block.images.columns):
        rotation = rotation_from_quaternion(block.poses[image, 3:])
        shift = np.einsum("nji,nj->ni", rotation, arm)
        table[["x", "y", "z"]] = table[["x", "y", "z"]].to_numpy() - np.nan_to_num(shift)
    return table
