"""Tests of many numbers that are correlated: all at once, and one by one.

Source: Pelzer 1971, Caspary 2000 (global congruency); Benjamini and Hochberg 1995 (false
discovery rate); Nichols and Hayasaka 2003 (clusters, the largest of each null map).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2, f, false_discovery_control, norm, t

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
    of all cells, where the change is one against those around; None: the mean of its cells.
    disc: cells whose mean says how much; wider: see `discs_in`."""

    cells: np.ndarray
    z: float
    probability: float
    weight: np.ndarray | None = None
    disc: np.ndarray | None = None
    wider: float = 1.0


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
    value: np.ndarray, covariance: np.ndarray, noise: np.ndarray, places: np.ndarray, level: float
) -> list[Patch]:
    """Pieces that moved against what lies around them, one after the other, the surest first.

    value (k,), covariance (k, k): of cells at places (k, 2). Camera and datum bend all of a date at
    once, so that the cells farther off than two radii predict what they do to a disc; noise (k,):
    variances of each cell beside that, so that no difference of neighbours is trusted to its last
    digit. Maps of nothing with the covariance say what comes by chance.
    Source: Kulldorff 1997 (scan statistic), Wackernagel 2003 (simple kriging).
    """
    rest, out = np.arange(len(value)), []
    while True:
        among = np.ix_(rest, rest)
        found = _beside(value[rest], covariance[among], noise[rest], places[rest], level)
        if found is None:
            return out
        patch, near = found
        weight = np.zeros(len(value))
        weight[rest] = patch.weight
        cells = rest[patch.cells]
        out.append(replace(patch, cells=cells, disc=cells, weight=weight))
        # What moved predicts others wrongly, which stand still.
        rest = np.delete(rest, near)


def _beside(
    value: np.ndarray, covariance: np.ndarray, noise: np.ndarray, places: np.ndarray, level: float
) -> tuple[Patch, np.ndarray] | None:
    """The most significant piece of `patches_beside`, and the cells in and near its disc."""
    discs = [(disc, near) for _, disc, near in _discs(places) if len(disc) > 1]
    discs = [(disc, near) for disc, near in discs if 2 * len(near) < len(places)]
    if not discs:
        return None
    blunt = np.linalg.inv(covariance + np.diag(noise))
    weight = np.empty((len(discs), len(value)))
    for k, (disc, near) in enumerate(discs):
        # What is left of the cells nearby once those beyond have predicted them.
        left = np.linalg.solve(blunt[np.ix_(near, near)], blunt[near])
        weight[k] = left[np.isin(near, disc)].mean(axis=0)
    z, largest = _of_maps(weight, value, covariance)
    best = int(np.argmax(np.abs(z)))
    more = float(np.mean(largest >= abs(z[best])))
    if more >= level:
        return None
    disc, near = discs[best]
    wider = _wider(largest)
    return Patch(disc, float(z[best]), max(more, 1.0 / MAPS), weight[best], wider=wider), near


def discs_in(
    some: list[Patch], value: np.ndarray, covariance: np.ndarray, places: np.ndarray
) -> list[Patch]:
    """The same patches, each with the disc around one of its cells whose mean is the surest.

    value (k,), covariance (k, k): of all cells, at places (k, 2). Cells that were chosen because
    they lie beyond a limit err outwards, and so does their mean, far beyond its sigma. Discs are
    few, and alike. wider: what a standard deviation is multiplied by so that two of them hold for
    all discs of the map at once (95 %), and so for the one that the data choose.
    Source: Berk et al. 2013 (valid post-selection inference).
    """
    if not some:
        return []
    middle, discs, _ = zip(*_discs(places), strict=True)
    weight = np.zeros((len(discs), len(value)))
    for row, disc in zip(weight, discs, strict=True):
        row[disc] = 1.0 / len(disc)
    z, largest = _of_maps(weight, value, covariance)
    wider, out = _wider(largest), []
    for one in some:
        mine = np.isin(middle, one.cells)
        best = int(np.argmax(np.where(mine, np.sign(one.z) * z, -np.inf)))
        out.append(replace(one, disc=discs[best], wider=wider))
    return out


def _of_maps(
    weight: np.ndarray, value: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sums (s,) of a map in their standard deviations, and the largest (`MAPS`,) of each map of
    nothing."""
    known, vector = np.linalg.eigh(covariance)
    along = weight @ (vector * np.sqrt(np.maximum(known, 0.0)))
    sigma = np.maximum(np.linalg.norm(along, axis=1), np.finfo(float).tiny)
    draws = np.random.default_rng(0).normal(size=(len(value), MAPS))
    return weight @ value / sigma, np.abs(along / sigma[:, None] @ draws).max(axis=0)


def _wider(largest: np.ndarray) -> float:
    """The 95 % of the largest of all against those of one."""
    return max(float(np.quantile(largest, 0.95) / norm.ppf(0.975)), 1.0)


def _discs(places: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Each of the places (k, 2), numbers of those in a disc around it, and of those nearer than two
    radii: itself alone, and discs of several sizes up to half of the extent across."""
    away = np.linalg.norm(places[:, None] - places, axis=2)
    nearest = np.partition(away, 1, axis=1)[:, 1] if len(places) > 1 else np.zeros(1)
    radius, last = 1.1 * float(np.median(nearest)), 0.25 * float(away.max(initial=0.0))
    sizes = [0.0]
    while 0.0 < radius <= last:
        sizes.append(radius)
        radius *= np.sqrt(2.0)
    for radius in sizes:
        for middle, distance in enumerate(away):
            yield middle, *(np.flatnonzero(distance <= r) for r in (radius, 2.0 * radius))


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
