"""Rays between images and points, and what is known of both."""

import copy
from collections.abc import Callable

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.camera import undistort, without_distortion
from corridor.core.effects import stated_lever_arms
from corridor.core.geometry import Rays, rotation_from_quaternion

CENTRE = ["x", "y", "z"]

# Reprojection that still counts as seen, px: for a known camera, then for stranger ones.
GATES_PX = (4.0, 15.0, 60.0)
# Share of the rays that must be seen so.
LEAST_INLIER_SHARE = 0.6


class Network:
    """The measurements of a block as rays, and the places found for images and points so far.

    image, point, ray (u, v): one observation a row, ordered by image, then by point name, so that
    the order of rows in the files does not count; image_start, point_start with by_point: where
    the rows of an image and of a point begin.
    posed, known: images and points that have a place so far; pose_given, point_given: those whose
    place is not ours to change. antenna: GNSS positions, NaN where none, arm: their stated lever
    arms. held: images whose centre GNSS gives; trusted: those whose antenna agrees with the rest.
    ground: points with ground coordinates; spare: measured ground points that are set aside.
    adjusted: a part of the block adjusted, None where it cannot be.
    gate: reprojection (px) that counts as seen by now. pixel: size of one in each image, as a ray.
    """

    def __init__(self, block: Block, adjusted: Callable[[Block], Block | None]):
        self.block, self.adjusted = block, adjusted
        self.images = block.images["image"].to_numpy(dtype=object)
        self._observe()
        self._take_poses()
        self._take_points()
        self._begin()

    def _observe(self) -> None:
        block = self.block
        tables = [table for table in (block.tie_points, block.marks) if len(table)]
        names = [table["point"].dtype.categories for table in tables]
        ranked = names[0].append(names[1:]).unique().sort_values()
        image = np.concatenate([block.image_rows(name) for name in ("tie_points", "marks")])
        point = np.concatenate(
            [
                ranked.get_indexer(name)[table["point"].array.codes]
                for name, table in zip(names, tables, strict=True)
            ]
        )
        pixels = np.concatenate([table[["x", "y"]].to_numpy(dtype=float) for table in tables])
        order = np.lexsort((point, image))
        self.points = ranked.to_numpy(dtype=object)
        self.image = image[order].astype(np.int32)
        self.point = point[order].astype(np.int32)
        self.measured = pixels[order]
        self.camera = block.image_camera
        self.look_through(np.array([camera.interior for camera in block.cameras.values()]))

    def _take_poses(self) -> None:
        block = self.block
        pose = block.poses
        self.posed = np.isfinite(pose).all(1)
        self.pose_given = self.posed.copy()
        self.centre = pose[:, :3].copy()
        self.rotation = np.full((len(pose), 3, 3), np.nan)
        self.rotation[self.posed] = rotation_from_quaternion(pose[self.posed, 3:])
        self.antenna = np.full((len(pose), 3), np.nan)
        if len(block.gnss):
            self.antenna[block.image_rows("gnss")] = block.gnss[CENTRE].to_numpy(dtype=float)
        self.arm = stated_lever_arms(block)[block.image_flight]

    def _take_points(self) -> None:
        block, names = self.block, pd.Index(self.points)
        self.place = np.full((len(names), 3), np.nan)
        for frame in (block.points, block.ground):
            row = names.get_indexer(frame["point"])
            self.place[row[row >= 0]] = frame[CENTRE].to_numpy(dtype=float)[row >= 0]
        # A ground point set aside orients nothing, though its coordinates are there.
        unused = block.ground["role"] == "unused"
        self.spare = np.isin(self.points, block.ground["point"][unused].to_numpy(dtype=object))
        self.ground = np.isin(self.points, block.ground["point"][~unused].to_numpy(dtype=object))
        unseen = np.bincount(self.point, minlength=len(names)) == 0
        self.point_given = np.isfinite(self.place).all(1) | unseen
        self.known = self.point_given & ~self.spare

    def _begin(self) -> None:
        self.by_point = np.argsort(self.point, kind="stable")
        self.point_start = _starts(self.point, len(self.points))
        self.image_start = _starts(self.image, len(self.images))
        self.gate = GATES_PX[0]
        self.held = np.zeros(len(self.images), dtype=bool)
        self.trusted = self.held.copy()

    def look_through(self, interior: np.ndarray) -> None:
        """Rays of all measurements through cameras with these interior vectors (m, 16)."""
        self.interior = interior
        self.pixel = 1.0 / interior[self.camera, 0]
        row = self.camera[self.image]
        self.ray = undistort(self.measured, interior, row)
        lost = np.isnan(self.ray[:, 0])  # beyond the fold of the stated distortion
        self.ray[lost] = without_distortion(self.measured[lost], interior, row[lost])

    def submodel(self, members: np.ndarray) -> "Network":
        """The same network seen from some images only, with nothing known of it yet."""
        submodel = copy.copy(self)
        rows = members[self.image]
        for name in ("image", "point", "measured", "ray"):
            setattr(submodel, name, getattr(self, name)[rows])
        for name in ("posed", "pose_given", "known", "point_given", "ground", "spare"):
            setattr(submodel, name, np.zeros_like(getattr(self, name)))
        for name in ("centre", "rotation", "place", "antenna"):
            setattr(submodel, name, np.full_like(getattr(self, name), np.nan))
        submodel._begin()
        return submodel

    @property
    def rays(self) -> Rays:
        """All of them, with the poses as they stand, to be moved in place."""
        return Rays(self.image, self.ray, self.rotation, self.centre, self.pixel)

    def rows(self, image: int) -> slice:
        """The observations of one image."""
        return slice(self.image_start[image], self.image_start[image + 1])

    def agreement(self, image: int, gate: float) -> float:
        """Share of the known points of an image that are seen within the gate (px)."""
        rows = self.rows(image)
        known = self.known[self.point[rows]]
        seen = self.place[self.point[rows][known]] - self.centre[image]
        seen = seen @ self.rotation[image].T
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - self.ray[rows][known], axis=1)
        fine = (seen[:, 2] > 0) & (off < gate * self.pixel[image])
        return float(fine.mean()) if len(fine) else 0.0


def _starts(codes: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.bincount(codes, minlength=count))])
