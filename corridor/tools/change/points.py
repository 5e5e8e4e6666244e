"""Displacements of the points that carry the same name in both epochs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.stats import chi2

from corridor.core.brief import brief
from corridor.core.output import with_units
from corridor.tools.change.joint import Joint, common_control, displacements
from corridor.tools.change.registration import MOTIONS, motions_at, s_transformation, stable_weights
from corridor.tools.change.significance import Congruency, congruency, discoveries
from corridor.tools.change.surface import PatchChange, SurfaceChange


@brief
@dataclass(frozen=True, eq=False)
class PointChanges:
    """Displacements of named points, after minus before.

    names (k,), xyz (k, 3) before, shift (k, 3), m; covariance (3k, 3k), of both epochs together.
    held (k,): control with the same coordinates in both, which cannot show a motion. apart (k,):
    points that the surface around them contradicts; they show none either. probability
    (k,) of so large a displacement, were there none; moved, stable (k,). overall: the global test
    of all that are not held. functions: the displacements (3k,), see `Joint`.
    beside (k,): the probability once every effect of camera and flight is estimated in each epoch,
    within what its prior allows; None where that was not asked for. undecided (k,): moved by its
    own covariance, but not beside the effects, or while all that was compared does not change, or
    alone (k,): nothing else says so, see `within`.
    """

    names: np.ndarray
    xyz: np.ndarray
    shift: np.ndarray
    covariance: np.ndarray
    held: np.ndarray
    probability: np.ndarray
    moved: np.ndarray
    overall: Congruency
    functions: csr_array = field(repr=False)
    apart: np.ndarray | None = None
    beside: np.ndarray | None = None
    undecided: np.ndarray | None = None
    alone: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.names)

    @property
    def free(self) -> np.ndarray:
        """Points that can show a motion (k,)."""
        return ~self.held if self.apart is None else ~(self.held | self.apart)

    @property
    def stable(self) -> np.ndarray:
        """Points that do not move as far as can be seen (k,)."""
        unmoved = ~self.moved & self.free
        return unmoved if self.undecided is None else unmoved & ~self.undecided

    @property
    def leading(self) -> np.ndarray:
        """Numbers of the points that moved, the most significant first: beside effects if known."""
        size = -np.sum((self.shift / self.sigma) ** 2, axis=1)
        first = size if self.beside is None else self.beside
        return np.flatnonzero(self.moved)[np.lexsort((size[self.moved], first[self.moved]))]

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
        if self.apart is not None:
            words = np.where(self.apart, "contradicted", words)
        table = pd.DataFrame({"point": self.names})
        table[["x", "y", "z"]] = self.xyz
        table[["dx", "dy", "dz"]] = self.shift
        table[["sx", "sy", "sz"]] = self.sigma
        table["probability"] = self.probability
        if self.beside is not None:
            table["beside_effects"] = self.beside
        return with_units(table.assign(verdict=words), {"m": "x y z dx dy dz sx sy sz"})

    def within(
        self,
        patches: Iterable[PatchChange],
        surface: SurfaceChange | None,
        surveyed: Mapping[str, np.ndarray] = MappingProxyType({}),
    ) -> PointChanges:
        """The same points beside other witnesses.

        Those that are undecided moved where a patch of the surface did, whatever effects there are,
        and they are nearer to its change than to none. One that moved is undecided where nothing
        else says so: no such patch, no second survey (displacements by name, m), no other point
        that went within 60 degrees of the same way, in standard deviations. A mark on another
        target, moved or with another's name is displaced in all pictures alike.
        """
        sure = np.zeros(len(self), dtype=bool)
        for one in patches:
            places = surface.cores.xyz[one.rows, :2]
            inside = cKDTree(places).query(self.xyz[:, :2])[0] < surface.cores.radius
            sure |= inside & (self.shift[:, 2] / one.change > 0.5)
        moved = self.moved | (sure & self.undecided)
        way = self.shift / self.sigma
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
        alike = way @ way[moved | self.undecided].T > 0.5
        other = self.shift - np.array([surveyed.get(name, np.zeros(3)) for name in self.names])
        surveyed_so = np.linalg.norm(other, axis=1) < 0.5 * np.linalg.norm(self.shift, axis=1)
        sure |= (alike.sum(axis=1) > 1) | surveyed_so
        alone = moved & ~sure
        undecided = (self.undecided & ~moved) | alone
        return replace(self, moved=moved & sure, undecided=undecided, alone=alone)

    def beside_effects(
        self, shift: np.ndarray, covariance: np.ndarray, level: float, changed: bool
    ) -> PointChanges:
        """The same points with what is left beside effects of camera and flight.

        shift (3f,), m, covariance (3f, 3f) of the f points that are free, with every effect
        estimated. level: false discovery rate. changed: whether points and surface together show
        a change; without one, none is localised (Pelzer 1971: first the global test). What no
        single point shows, all of them together may: see `localised`.
        """
        beside, free = np.full(len(self), np.nan), np.flatnonzero(self.free)
        for row, k in enumerate(free):
            at = slice(3 * row, 3 * row + 3)
            beside[k] = congruency(shift[at], covariance[at, at]).probability
        moved = self.moved & discoveries(beside, level)
        moved[free] |= localised(shift, covariance, level, self.probability[free] < level)
        moved &= changed
        return replace(self, beside=beside, undecided=self.moved & ~moved, moved=moved)


def localised(
    shift: np.ndarray, covariance: np.ndarray, level: float, alone: np.ndarray
) -> np.ndarray:
    """Which of points (f,) the global tests of their heights, and horizontally, say moved.

    shift (3f,), m; covariance (3f, 3f). level: of both tests together. alone (f,): points that show
    a motion by themselves. Ground that sinks moves several points by a little each. While those
    that are left are not congruent, the one goes that leaves the most congruent ones: of those
    that moved alone, or, in a weak datum, of those that stand out from the others.
    Source: Pelzer 1971, Caspary 2000 (localisation backwards).
    """
    moved = np.zeros(len(alone), dtype=bool)
    for axes in ([2], [0, 1]):
        left, n = np.arange(len(moved)), len(axes)
        while len(left) > 1:  # One point is tested by itself.
            at = (3 * left[:, None] + axes).ravel()
            inside = covariance[np.ix_(at, at)]
            if congruency(shift[at], inside).probability >= 0.5 * level:
                break
            weight = np.linalg.pinv(inside, hermitian=True)
            pull = (weight @ shift[at]).reshape(-1, n)
            own = [weight[k : k + n, k : k + n] for k in range(0, len(at), n)]
            gain = np.einsum("ki,kij,kj->k", pull, np.linalg.pinv(own, hermitian=True), pull)
            choice = alone[left]
            if not choice.any():
                choice = chi2.sf(gain, n) < 0.5 * level / len(left)
            if not choice.any():
                break
            worst = np.argmax(np.where(choice, gain, -1.0))
            moved[left[worst]] = True
            left = np.delete(left, worst)
    return moved


def point_changes(joint: Joint, level: float, datum: str, kind: str) -> PointChanges | None:
    """Displacements of the points that both clouds name; None where there is none.

    level: false discovery rate of the single tests, level of the global one. datum: `stated`, or
    `stable`: laid together on the stable points by a motion of the kind of `registration.MOTIONS`.
    """
    names = [name for name in joint.before.named if name in joint.after.named]
    if not names:
        return None
    clouds = joint.before, joint.after
    functions = displacements(*clouds, names)
    xyz, second = (cloud.epoch.xyz[[cloud.named[name] for name in names]] for cloud in clouds)
    shift, covariance = (second - xyz).ravel(), joint.covariance(functions)
    held = np.zeros(len(names), dtype=bool)
    if not joint.together:
        held = np.isin(names, common_control(joint.epochs))
    redundancy = sum(epoch.adjustment.redundancy for epoch in joint.epochs)
    tested = partial(_tested, np.array(names, dtype=object), xyz, held, level, redundancy)
    if datum != "stable" or 3 * np.sum(~held) <= MOTIONS[kind]:
        return tested(shift, covariance, functions)
    motions = motions_at(xyz, kind).reshape(len(shift), -1)
    weight = stable_weights(shift, motions, _inner_sigma(covariance, motions))
    for _ in range(10):
        away = _without_motion(motions, weight)
        left = away @ covariance @ away.T
        found = tested(away @ shift, left, csr_array(csr_array(away) @ functions))
        # From now on those that stand still carry the datum, one as much as the other.
        new = np.repeat(found.stable, 3).astype(float)
        if new.sum() <= motions.shape[1] or np.array_equal(new, weight):
            break
        weight = new
    return found


def _tested(names, xyz, held, level, redundancy, shift, covariance, functions) -> PointChanges:
    """Displacements (3k,) tested by their covariance (3k, 3k), one by one and together."""
    single, free = np.full(len(names), np.nan), np.flatnonzero(~held)
    for k in free:
        at = slice(3 * k, 3 * k + 3)
        single[k] = congruency(shift[at], covariance[at, at]).probability
    at = (3 * free[:, None] + np.arange(3)).ravel()
    overall = congruency(shift[at], covariance[np.ix_(at, at)], redundancy)
    moved = discoveries(single, level)
    return PointChanges(
        names, xyz, shift.reshape(-1, 3), covariance, held, single, moved, overall, functions
    )


def _without_motion(motions: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """S (n, n) of displacements, by the motions (n, m) of the whole block."""
    return np.eye(len(weight)) - motions @ s_transformation(motions, weight)


def _inner_sigma(covariance: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """Standard deviations (n,) within the block: a weak datum must not hide who moves."""
    away = _without_motion(motions, np.ones(len(motions)))
    inner = np.sqrt(np.maximum(np.diag(away @ covariance @ away.T), 0.0))
    return np.maximum(inner, 1e-3 * np.median(inner))
