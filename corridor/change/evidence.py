"""The change of two epochs in few numbers that are tested together: named points, cells of the
surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from corridor.change.clouds import Functions
from corridor.change.joint import Joint
from corridor.change.points import PointChanges
from corridor.change.signature import Signatures
from corridor.change.significance import congruency, discoveries, normal_scores, two_sided
from corridor.change.surface import SurfaceChange

# Cells of the surface at most: their covariance is a dense matrix.
MOST_CELLS = 240


@dataclass(frozen=True, eq=False)
class Evidence:
    """Changes (k,), m, with their covariance (k, k), places (k, 2) and kinds (k,), and what the
    effects of each epoch would do to them: effect (k, e), a column a parameter of `Signatures`.
    freedom (k,): degrees of freedom of each variance, see `SurfaceChange`; redundancy: of the scale
    of them all, where what stands still tells it (`Laying`).
    """

    value: np.ndarray
    covariance: np.ndarray
    places: np.ndarray
    kinds: np.ndarray
    signatures: tuple[Signatures, ...]
    effect: tuple[np.ndarray, ...]
    freedom: np.ndarray
    redundancy: float = np.inf

    def __len__(self) -> int:
        return len(self.value)

    def without(self, slugs: tuple[set[str], ...]) -> tuple[np.ndarray, np.ndarray]:
        """Value and covariance once effects of each epoch are estimated with their priors."""
        value, covariance = self.value.copy(), self.covariance.copy()
        for signature, effect, some in zip(self.signatures, self.effect, slugs, strict=True):
            at = signature.of(some)
            if not len(at):
                continue
            found = signature.estimate(at)
            value -= effect[:, at] @ found.value
            covariance += effect[:, at] @ found.covariance @ effect[:, at].T
        return value, covariance

    def test(self, level: float, slugs: tuple[set[str], ...] = ()) -> Test:
        """Whether the changes are significant, with some effects of each epoch estimated."""
        value, covariance = self.without(slugs) if slugs else (self.value, self.covariance)
        return self.tested(value, covariance, level)

    def tested(self, value: np.ndarray, covariance: np.ndarray, level: float) -> Test:
        """Whether other values of the same changes are significant, by such a covariance."""
        return tested(value, covariance, level, self.freedom, self.redundancy)

    def judged(self, points: PointChanges | None, level: float) -> PointChanges | None:
        """Points that moved beside every effect told from those that an effect could have moved."""
        at = np.flatnonzero(self.kinds == "point")
        if points is None or not len(at):
            return points
        value, covariance = self.without(self.every)
        changed = self.test(level).significant
        return points.beside_effects(value[at], covariance[np.ix_(at, at)], level, changed)

    @property
    def every(self) -> tuple[set[str], ...]:
        """All effects of each epoch."""
        return tuple(set(signature.effects) for signature in self.signatures)


@dataclass(frozen=True)
class Test:
    """Whether changes are significant at a level: as a whole, or one of them. probability: the
    smaller of both, for two tests."""

    significant: bool
    probability: float
    freedom: int


def tested(
    value: np.ndarray, covariance: np.ndarray, level: float, freedom: np.ndarray,
    redundancy: float = np.inf,
) -> Test:  # fmt: skip
    """The global test and the single ones, at half the level each.

    freedom (k,): of each variance; a change counts as the normal one that is as unlikely.
    redundancy: of the scale of the covariance.
    """
    if not len(value):
        return Test(False, 1.0, 0)
    sigma = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    z = normal_scores(value / sigma, freedom)
    overall = congruency(z * sigma, covariance, redundancy)
    single = two_sided(z)
    found = discoveries(single, 0.5 * level).any() or overall.probability < 0.5 * level
    least = min(overall.probability, float(single.min()) * len(single))
    return Test(bool(found), float(min(2.0 * least, 1.0)), overall.freedom)


def gathered(
    joint: Joint,
    points: PointChanges | None,
    surface: SurfaceChange | None,
    signatures: tuple[Signatures, ...],
) -> Evidence:
    """Points that are not held and cells of the surface as one vector with its covariance."""
    parts = [_of_points(points), _of_surface(surface)]
    parts = [part for part in parts if part is not None and len(part[1])]
    if surface is not None:
        joint = surface.joint
    functions = Functions.stack([part[0] for part in parts])
    covariance = joint.covariance(functions, rough=True)
    if surface is not None and surface.laying is not None:
        scale = np.repeat(
            [surface.laying.scale if part[3][0] == "surface" else 1.0 for part in parts],
            [len(part[1]) for part in parts],
        )
        covariance = scale[:, None] * covariance * scale
    spreads = [part.spread for part in joint.parts(functions)]
    effect = tuple(s.on(spread) for s, spread in zip(signatures, spreads, strict=True))
    value, places, kinds = (np.concatenate([part[n] for part in parts]) for n in (1, 2, 3))
    freedom, redundancy = np.full(len(value), np.inf), np.inf
    if surface is not None:
        # Only what comes from rough ground is uncertain, and no surer than at one core point.
        rough = joint.roughness(functions)
        some = (kinds == "surface") & (rough > 0)
        least = max(float(np.median(surface.count.min(axis=1))) - 1.0, 1.0)
        freedom[some] = least * (np.diag(covariance)[some] / rough[some]) ** 2
        if surface.laying is not None:
            of_surface = kinds == "surface"
            redundancy = surface.laying.freedom
            freedom[of_surface] = np.minimum(freedom[of_surface], redundancy)
    return Evidence(value, covariance, places, kinds, signatures, effect, freedom, redundancy)


def _of_points(found: PointChanges | None):
    if found is None:
        return None
    at = np.flatnonzero(np.repeat(~found.held, 3))
    places = np.repeat(found.xyz[:, :2], 3, axis=0)[at]
    value = found.shift.ravel()[at]
    return found.functions[at], value, places, np.full(len(at), "point", dtype=object)


def _of_surface(found: SurfaceChange | None):
    """The surface by cells: the mean of the core points in each."""
    if found is None or not len(found):
        return None
    cores = found.cores
    size = 2.0 * cores.radius
    while True:
        cell = np.floor(np.column_stack([cores.station, cores.across]) / size).astype(int)
        _, number, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        if len(count) <= MOST_CELLS:
            break
        size *= 1.15
    number = number.ravel()
    entries = (1.0 / count[number], (number, np.arange(len(number))))
    mean = csr_array(entries, shape=(len(count), len(number)))
    kinds = np.full(len(count), "surface", dtype=object)
    return found.sums(mean), mean @ found.distance, mean @ cores.xyz[:, :2], kinds
