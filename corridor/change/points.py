"""Displacements of the points that carry the same name in both epochs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from corridor.brief import brief
from corridor.change.clouds import Functions, displacements
from corridor.change.common import common_control
from corridor.change.joint import Joint
from corridor.change.significance import Congruency, congruency, discoveries, spatial
from corridor.change.stable import MOTIONS, motions_at, s_transformation, stable_weights
from corridor.report import with_units


@brief
@dataclass(frozen=True, eq=False)
class PointChanges:
    """Displacements of named points, after minus before.

    names (k,), xyz (k, 3) before, shift (k, 3), m; covariance (3k, 3k), of both epochs together.
    held (k,): control with the same coordinates in both, which cannot show a motion. probability
    (k,) of so large a displacement, were there none; moved, stable (k,). overall: the global test
    of all that are not held. datum: `stated`, or the motion taken out on the stable points.
    motion (m,): that one, metres, radians, share. functions: the displacements (3k,).
    beside (k,): the probability once every effect of camera and flight is estimated in each epoch,
    within what its prior allows; None where that was not asked for. undecided (k,): moved by its
    own covariance, but not beside the effects, or while all that was compared does not change.
    """

    names: np.ndarray
    xyz: np.ndarray
    shift: np.ndarray
    covariance: np.ndarray
    held: np.ndarray
    probability: np.ndarray
    moved: np.ndarray
    overall: Congruency
    functions: Functions = field(repr=False)
    datum: str = "stated"
    motion: np.ndarray = field(default_factory=lambda: np.zeros(0))
    beside: np.ndarray | None = None
    undecided: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.names)

    @property
    def stable(self) -> np.ndarray:
        """Points that do not move as far as can be seen (k,)."""
        unmoved = ~self.moved & ~self.held
        return unmoved if self.undecided is None else unmoved & ~self.undecided

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (k, 3), m, of the displacements."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(-1, 3)

    @property
    def frame(self) -> pd.DataFrame:
        """point, x, y, z; dx, dy, dz, sx, sy, sz (m), probability, beside_effects, verdict."""
        words = np.where(self.held, "held", np.where(self.moved, "moved", "stable"))
        if self.undecided is not None:
            words = np.where(self.undecided, "undecided", words)
        table = pd.DataFrame({"point": self.names})
        table[["x", "y", "z"]] = self.xyz
        table[["dx", "dy", "dz"]] = self.shift
        table[["sx", "sy", "sz"]] = self.sigma
        table["probability"] = self.probability
        if self.beside is not None:
            table["beside_effects"] = self.beside
        return with_units(table.assign(verdict=words), {"m": "x y z dx dy dz sx sy sz"})

    def beside_effects(
        self, shift: np.ndarray, covariance: np.ndarray, level: float, changed: bool
    ) -> PointChanges:
        """The same points with what is left beside effects of camera and flight.

        shift (3f,), m, covariance (3f, 3f) of the f points that are not held, with every effect
        estimated. level: false discovery rate. changed: whether points and surface together show
        a change; without one, none is localised (Pelzer 1971: first the global test).
        """
        beside, free = np.full(len(self), np.nan), np.flatnonzero(~self.held)
        for row, k in enumerate(free):
            at = slice(3 * row, 3 * row + 3)
            beside[k] = congruency(shift[at], covariance[at, at]).probability
        undecided = self.moved & ~(discoveries(beside, level) & changed)
        return replace(self, beside=beside, undecided=undecided, moved=self.moved & ~undecided)


def point_changes(joint: Joint, level: float, datum: str, kind: str) -> PointChanges | None:
    """Displacements of the points that both clouds name; None where there is none.

    level: false discovery rate of the single tests, level of the global one. datum: `stated`, or
    `stable`: laid together on the stable points by a motion of the kind of `stable.MOTIONS`.
    """
    names = [name for name in joint.before.named if name in joint.after.named]
    if not names:
        return None
    functions = displacements(joint.before, joint.after, names)
    first, second = (
        cloud.epoch.xyz[[cloud.named[name] for name in names]]
        for cloud in (joint.before, joint.after)
    )
    xyz, shift = first, (second - first).ravel()
    covariance = joint.covariance(functions)
    names = np.array(names, dtype=object)
    held = np.zeros(len(names), dtype=bool)
    if not joint.together:
        held = np.isin(names, common_control([joint.before.epoch, joint.after.epoch]))
    redundancy = sum(e.adjustment.redundancy for e in {joint.before.epoch, joint.after.epoch})
    found = _Tested(names, xyz, held, redundancy, level, functions)
    if datum == "stable" and 3 * np.sum(~held) > MOTIONS[kind]:
        return _laid_on_stable(found, shift, covariance, kind)
    return found.changes(shift, covariance)


@dataclass(frozen=True)
class _Tested:
    """What is tested, and how."""

    names: np.ndarray
    xyz: np.ndarray
    held: np.ndarray
    redundancy: float
    level: float
    functions: Functions

    def changes(self, shift, covariance, datum="stated", finder=None, motion=None):
        by_point = covariance.reshape(len(self.names), 3, len(self.names), 3)
        own = np.einsum("kikj->kij", by_point)
        d = shift.reshape(-1, 3)
        square, freedom = np.zeros(len(d)), np.zeros(len(d), dtype=int)
        for k, (one, matrix) in enumerate(zip(d, own, strict=True)):
            test = congruency(one, matrix)
            square[k], freedom[k] = test.statistic, max(test.freedom, 1)
        probability = np.where(self.held, np.nan, spatial(square, freedom))
        free = np.flatnonzero(~self.held)
        at = (3 * free[:, None] + np.arange(3)).ravel()
        overall = congruency(shift[at], covariance[np.ix_(at, at)], self.redundancy)
        return PointChanges(
            self.names, self.xyz, d, covariance, self.held, probability,
            discoveries(probability, self.level), overall, self._laid(finder), datum,
            np.zeros(0) if motion is None else motion,
        )  # fmt: skip

    def _laid(self, away: np.ndarray | None) -> Functions:
        return self.functions if away is None else self.functions.combined(away)


def _laid_on_stable(found: _Tested, shift, covariance, kind: str) -> PointChanges:
    """The displacements that are left when both epochs are laid together on what stands still."""
    motions = motions_at(found.xyz, kind).reshape(len(shift), -1)
    sigma = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    weight = stable_weights(shift, motions, _inner_sigma(covariance, motions, sigma))
    result = None
    for _ in range(10):
        finder = s_transformation(motions, weight)
        part = finder @ shift
        away = np.eye(len(shift)) - motions @ finder
        result = found.changes(away @ shift, away @ covariance @ away.T, "stable", away, part)
        # From now on those that stand still carry the datum, one as much as the other.
        new = np.repeat(result.stable, 3).astype(float)
        if new.sum() <= motions.shape[1] or np.array_equal(new, weight):
            break
        weight = new
    return result


def _inner_sigma(covariance, motions, sigma) -> np.ndarray:
    """Standard deviations (n,) within the block: a weak datum must not hide who moves."""
    away = np.eye(len(sigma)) - motions @ s_transformation(motions, np.ones(len(sigma)))
    inner = np.sqrt(np.maximum(np.diag(away @ covariance @ away.T), 0.0))
    return np.maximum(inner, 1e-3 * np.median(inner))
