"""The second date brought near the first where the datum is weak.

GNSS of metres, or none, lets a block float by metres and degrees. Laying together by one linear
step then leaves the squares of the turns, and a cylinder looks for the surface where it is not. So
the second date is first moved as a whole until most of it lies on the first; that motion is a
choice of coordinates, not a measurement, and what is left is small enough for linear errors.
Source: Chen and Medioni 1992 (distances along the normals), with the weights of `stable_weights`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from corridor.change.clouds import Cloud
from corridor.change.cores import WANTED, fitted_normals, usual_radius
from corridor.change.epoch import Epoch
from corridor.change.stable import motions_at, s_transformation, stable_weights
from corridor.geometry import Similarity, rotation_from_vector

PASSES = 30
# So many points tell a motion of seven numbers.
ENOUGH = 700
# The last step moves no point by more (m).
NEAR_M = 1e-3


def brought(before: Cloud, after: Cloud, kind: str, same_ties: bool) -> Cloud:
    """The second cloud where it lies on the first; kind: of `stable.MOTIONS`.

    same_ties: the surfaces are the same points one for one; else the distances along the normals
    of the first to the points beside in plan count. Too few points stay where they are.
    """
    if min(len(before.surface), len(after.surface)) <= WANTED:
        return after
    few = slice(None, None, max(len(after.surface) // ENOUGH, 1))
    there = after.epoch.system.state.points[after.surface[few]]
    find = _Same(before.xyz[few]) if same_ties else _Beside(before.xyz, after.xyz)
    laid = after.epoch.laid or Similarity(1.0, np.eye(3), np.zeros(3))
    for _ in range(PASSES):
        here = laid.apply(there)
        away, towards, kept = find(here)
        motions = np.einsum("nax,nxm->nam", towards, motions_at(here, kind)[kept])
        motions = motions.reshape(-1, motions.shape[2])
        if len(away) <= motions.shape[1]:
            break
        weight = stable_weights(away, motions, np.ones(len(away)))
        step = s_transformation(motions, weight) @ away
        laid = _moved(laid, step, here.mean(axis=0))
        if np.abs(laid.apply(there) - here).max() < NEAR_M:
            break
    return replace(after, epoch=Epoch(after.epoch.adjustment, laid))


class _Same:
    """The same points of the first date: three axes each."""

    def __init__(self, xyz: np.ndarray):
        self.xyz = xyz

    def __call__(self, here: np.ndarray):
        """Away (n * 3,), m, along towards (n, 3, 3), of the points kept."""
        towards = np.broadcast_to(np.eye(3), (len(here), 3, 3))
        return (self.xyz - here).ravel(), towards, np.arange(len(here))


class _Beside:
    """The points of the first date that are nearest in plan, along their normals."""

    def __init__(self, before: np.ndarray, after: np.ndarray):
        self.radius = usual_radius(before, after)
        self.xyz, self.tree = before, cKDTree(before[:, :2])

    def __call__(self, here: np.ndarray):
        """Away (n,), m, along towards (n, 1, 3), of the points kept."""
        far, nearest = self.tree.query(here[:, :2])
        kept = np.flatnonzero(far < self.radius)
        beside = self.xyz[nearest[kept]]
        normal = fitted_normals(self.xyz, beside, 1.5 * self.radius)
        away = np.einsum("nk,nk->n", normal, beside - here[kept])
        return away, normal[:, None], kept


def _moved(laid: Similarity, step: np.ndarray, middle: np.ndarray) -> Similarity:
    """The similarity followed by a small motion about a middle: shift, turn, growth."""
    shift, turn, growth = np.split(np.concatenate([step, np.zeros(7 - len(step))]), [3, 6])
    scale, rotation = 1.0 + float(growth[0]), rotation_from_vector(turn)
    translation = scale * rotation @ (laid.translation - middle) + middle + shift
    return Similarity(scale * laid.scale, rotation @ laid.rotation, translation)
