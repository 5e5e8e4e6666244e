"""Tests of many numbers that are correlated: all at once, and one by one.

Source: Pelzer 1971, Caspary 2000 (global congruency); Benjamini and Hochberg 1995 (false
discovery rate); Nichols and Hayasaka 2003 (clusters, the largest of each null map).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2, f, false_discovery_control, norm, t

from corridor.tools.change.m3c2 import polynomial

# Directions of a covariance without information, against its largest.
OPEN = 1e-9
# Cells that a patch may hold: beyond this many of their standard deviations, which is chosen before
# and decides only how large a patch is drawn (Nichols and Hayasaka 2003).
RAISED = 1.64
# Maps of nothing that say how large a patch comes by chance.
MAPS = 1000


@dataclass(frozen=True)
class Congruency:
    """Whether numbers as a whole differ from zero by more than their covariance says.

    statistic: the weighted square; freedom: independent numbers in it; probability: of so much or
    more, were there no difference.
    """

    statistic: float
    freedom: int
    probability: float


def congruency(
    difference: np.ndarray, covariance: np.ndarray, redundancy: float = np.inf
) -> Congruency:
    """The global test of numbers (n,) with their covariance (n, n), which may be singular.

    redundancy: of the sigma naught in the covariance.
    """
    if not len(difference):
        return Congruency(0.0, 0, 1.0)
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    value, vector = np.linalg.eigh(covariance / scale[:, None] / scale)
    kept = value > OPEN * value[-1]
    along = vector[:, kept].T @ (difference / scale)
    statistic, freedom = float(np.sum(along**2 / value[kept])), int(kept.sum())
    if not freedom:
        probability = 1.0
    elif np.isfinite(redundancy):
        probability = f.sf(statistic / freedom, freedom, redundancy)
    else:
        probability = chi2.sf(statistic, freedom)
    return Congruency(statistic, freedom, float(probability))


def two_sided(z: np.ndarray, freedom: np.ndarray | float = np.inf) -> np.ndarray:
    """Probability of a number as large as each of z, whatever its sign: normal, or Student's.

    freedom: of the standard deviation that z was divided by.
    """
    return 2.0 * t.sf(np.abs(z), freedom)


def normal_scores(z: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """The normal numbers that are as unlikely as Student's z of so many degrees of freedom."""
    # Far out both tails end in zero; there a normal number of 37 stands for all.
    return np.sign(z) * norm.isf(np.maximum(t.sf(np.abs(z), freedom), 1e-300))


def discoveries(probability: np.ndarray, rate: float) -> np.ndarray:
    """Which tests are significant when at most this share of those may be false; NaN never is."""
    out, known = np.zeros(len(probability), dtype=bool), np.isfinite(probability)
    if known.any():
        out[known] = false_discovery_control(probability[known]) <= rate
    return out


@dataclass(frozen=True)
class Test:
    """Whether changes are significant at a level: as a whole, or one of them (`located`).
    probability: the smaller of both, for two tests."""

    significant: bool
    probability: float
    freedom: int
    located: bool = False


def tested(
    value: np.ndarray,
    covariance: np.ndarray,
    level: float,
    freedom: np.ndarray,
    redundancy: float = np.inf,
) -> Test:
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
    located = bool(discoveries(single, 0.5 * level).any())
    found = located or overall.probability < 0.5 * level
    least = min(overall.probability, float(single.min()) * len(single))
    return Test(bool(found), float(min(2.0 * least, 1.0)), overall.freedom, located)


@dataclass(frozen=True)
class Patch:
    """Neighbouring cells that moved one way. cells: their numbers; z: of their sum, in its standard
    deviations; probability: of a patch as significant anywhere, were nothing moved. weight (k,):
    of all cells, where the change is one against those around; None: the mean of its cells."""

    cells: np.ndarray
    z: float
    probability: float
    weight: np.ndarray | None = None


def patches(z: np.ndarray, correlation: np.ndarray, near: np.ndarray, level: float) -> list[Patch]:
    """The significant patches of a map, the most significant first.

    z (k,): cells in their standard deviations, normal; correlation (k, k); near (k, k): whether
    cells are neighbours. Maps of nothing with the same correlation say what comes by chance.
    """
    found = [(cells, size) for _, cells, size in _clusters(z[None], correlation, near)]
    if not found:
        return []
    value, vector = np.linalg.eigh(correlation)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    draws = np.random.default_rng(0).normal(size=(MAPS, len(z))) @ root.T
    largest = np.zeros(MAPS)
    for n, _, size in _clusters(draws, correlation, near):
        largest[n] = max(largest[n], abs(size))
    out = []
    for cells, size in found:
        more = float(np.mean(largest >= abs(size)))
        if more < level:
            out.append(Patch(cells, size, max(more, 1.0 / MAPS)))
    return sorted(out, key=lambda one: -abs(one.z))


def patches_beside(
    value: np.ndarray, covariance: np.ndarray, places: np.ndarray, level: float
) -> list[Patch]:
    """Pieces that moved against what lies around them, the most significant first, each apart.

    value (k,), covariance (k, k): of cells at places (k, 2). Camera and datum bend the ground over
    the length of an image, which a surface through the surroundings follows: what they share with a
    disc cancels. Maps of nothing with the same covariance say what comes by chance. The piece is
    what lies farther from that surface than half of the disc does.
    Source: Kulldorff 1997 (scan statistic).
    """
    discs = _discs(places)
    if not discs:
        return []
    weight = np.array([one.mean - one.through for one in discs])
    known, vector = np.linalg.eigh(covariance)
    along = weight @ (vector * np.sqrt(np.maximum(known, 0.0)))
    sigma = np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)
    z = weight @ value / sigma
    draws = np.random.default_rng(0).normal(size=(len(value), MAPS))
    largest = np.abs(along / sigma[:, None] @ draws).max(axis=0)
    out, taken = [], np.zeros(len(value), dtype=bool)
    for k in np.argsort(-np.abs(z)):
        more = float(np.mean(largest >= abs(z[k])))
        if more >= level:
            break
        # What moved bends the surroundings of its neighbours, which stand still.
        if not taken[weight[k] != 0.0].any():
            taken[weight[k] != 0.0] = True
            one = discs[k]
            beyond = (value - one.terms @ (one.tell @ value)) / (weight[k] @ value)
            cells = np.flatnonzero(one.near & (beyond > 0.5))
            own = np.zeros(len(value))
            own[cells] = 1.0 / len(cells)
            own -= one.terms[cells].mean(axis=0) @ one.tell
            out.append(Patch(cells, float(z[k]), max(more, 1.0 / MAPS), own))
    return out


@dataclass(frozen=True)
class _Disc:
    """A disc of cells and the ring around it. mean (k,): weights of the mean in it; terms (k, t)
    of a surface at every cell; tell (t, k): its coefficients from the cells of the ring; near (k,):
    what is nearer than that."""

    mean: np.ndarray
    terms: np.ndarray
    tell: np.ndarray
    near: np.ndarray

    @property
    def through(self) -> np.ndarray:
        """Weights (k,) of the mean in the disc of the surface that the ring tells."""
        return self.mean @ self.terms @ self.tell


def _discs(places: np.ndarray) -> list[_Disc]:
    """Discs of several sizes around each of the places (k, 2), rings from twice to four times the
    radius away. The surface: as high a polynomial as these know no worse in the disc than that
    knows its mean."""
    away = np.linalg.norm(places[:, None] - places, axis=2)
    nearest = np.partition(away, 1, axis=1)[:, 1] if len(places) > 1 else np.zeros(1)
    radius, last = 1.1 * float(np.median(nearest)), 0.25 * float(away.max(initial=0.0))
    out = []
    while 0.0 < radius <= last:
        for k, distance in enumerate(away):
            disc, near = distance <= radius, distance <= 2.0 * radius
            ring = ~near & (distance <= 4.0 * radius)
            if disc.sum() < 2 or ring.sum() < disc.sum():
                continue
            mean = disc / disc.sum()
            for degree in (2, 1, 0):
                terms = polynomial(*(places - places[k]).T / radius, degree)
                tell = np.zeros((terms.shape[1], len(places)))
                tell[:, ring] = np.linalg.pinv(terms[ring], rcond=1e-6)
                one = _Disc(mean, terms, tell, near)
                if one.through @ one.through <= mean @ mean:
                    break
            out.append(one)
        radius *= np.sqrt(2.0)
    return out


def _clusters(maps, correlation, near) -> Iterator[tuple[int, np.ndarray, float]]:
    """Of maps (m, k) their number, neighbours beyond `RAISED` of one sign, and the z of their
    sum."""
    sign = np.where(np.abs(maps) > RAISED, np.sign(maps), 0.0)
    i, j = np.nonzero(np.triu(near, 1))
    some, edge = np.nonzero((sign[:, i] == sign[:, j]) & (sign[:, i] != 0.0))
    ends = some * maps.shape[1]
    touching = (np.ones(len(edge), dtype=bool), (ends + i[edge], ends + j[edge]))
    graph = csr_array(touching, shape=(maps.size, maps.size))
    label = connected_components(graph, directed=False)[1].reshape(maps.shape)
    for n in range(len(maps)):
        raised = np.flatnonzero(sign[n])
        of = label[n, raised]
        for one in np.unique(of):
            cells = raised[of == one]
            sigma = np.sqrt(max(correlation[np.ix_(cells, cells)].sum(), 1e-12))
            yield n, cells, float(maps[n, cells].sum() / sigma)
