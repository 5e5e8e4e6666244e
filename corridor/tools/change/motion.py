"""Ground that moves, put into a measured block: image points as they would have been measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from corridor.core.block import Block
from corridor.core.effects import predict

Motion = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Settlement:
    """A bowl around a place (2,): so deep (m) in the middle, flat beyond `radius` (m).

    edge: share of the radius over which it goes to zero, as a cosine; 1: a bowl without a floor.
    """

    centre: tuple[float, float]
    radius: float
    depth: float
    edge: float = 1.0

    def __call__(self, xyz: np.ndarray) -> np.ndarray:
        """Motion (n, 3), m, of points (n, 3)."""
        away = np.linalg.norm(xyz[:, :2] - np.asarray(self.centre), axis=1) / self.radius
        inner = 1.0 - self.edge
        share = np.clip((away - inner) / max(self.edge, 1e-9), 0.0, 1.0)
        out = np.zeros_like(xyz)
        out[:, 2] = -self.depth * 0.5 * (1.0 + np.cos(np.pi * share))
        return out


@dataclass(frozen=True)
class Slide:
    """A patch around a place (2,) that moves as one by (x, y, z), m."""

    centre: tuple[float, float]
    radius: float
    by: tuple[float, float, float]

    def __call__(self, xyz: np.ndarray) -> np.ndarray:
        """Motion (n, 3), m, of points (n, 3)."""
        inside = np.linalg.norm(xyz[:, :2] - np.asarray(self.centre), axis=1) < self.radius
        return inside[:, None] * np.asarray(self.by, float)


@dataclass(frozen=True)
class Tilt:
    """A patch around a place (2,) that tilts: down by so much (m) at its edge towards `azimuth`
    (degrees from x to y), up as much at the other."""

    centre: tuple[float, float]
    radius: float
    edge: float
    azimuth: float = 0.0

    def __call__(self, xyz: np.ndarray) -> np.ndarray:
        """Motion (n, 3), m, of points (n, 3)."""
        away = xyz[:, :2] - np.asarray(self.centre)
        turn = np.radians(self.azimuth)
        along = away @ np.array([np.cos(turn), np.sin(turn)]) / self.radius
        inside = np.linalg.norm(away, axis=1) < self.radius
        out = np.zeros_like(xyz)
        out[:, 2] = -self.edge * along * inside
        return out


def moved_ground(block: Block, motion: Motion, survey: bool = True) -> Block:
    """The block as it would have been measured had its ground moved.

    block: with poses, points and cameras near the truth (as simulated, or `Adjustment.block`).
    motion: the motion (n, 3), m, of points (n, 3); `Settlement`, `Slide`, `Tilt`, or your own.
    survey: whether coordinates of ground points follow (a survey after the motion), or stay.
    Every image point moves by what the motion does to its projection; noise and all else stay.
    """
    there = block.copy()
    for table in ("points", "ground"):
        rows = getattr(there, table)
        xyz = rows[["x", "y", "z"]].to_numpy(float, copy=True)
        known = np.isfinite(xyz).all(axis=1)
        xyz[known] += motion(xyz[known])
        rows[["x", "y", "z"]] = xyz
    before, after = predict(block), predict(there)
    out = there if survey else block.copy()
    for table, kind in (("tie_points", "tie"), ("marks", "mark")):
        rows = getattr(out, table)
        if len(rows):
            step = np.nan_to_num(getattr(after, kind) - getattr(before, kind))
            rows[["x", "y"]] = getattr(block, table)[["x", "y"]].to_numpy(float) + step
    return out
