"""Tests of many numbers that are correlated: all at once, and one by one.

Source: Pelzer 1971, Caspary 2000 (global congruency); Benjamini and Hochberg 1995 (false
discovery rate); Nichols and Hayasaka 2003 (clusters, the largest of each null map),
Baarda 1968 (test of one alternative, here a step of one neighbourhood).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2, f, false_discovery_control, norm, rankdata, t

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
    deviations; probability: of a patch as significant anywhere, were nothing moved."""

    cells: np.ndarray
    z: float
    probability: float


def patches(
    z: np.ndarray,
    correlation: np.ndarray,
    near: np.ndarray,
    level: float,
    weight: np.ndarray | float = 1.0,
    cells: int | None = None,
) -> list[Patch]:
    """The significant patches of a map, the most significant first.

    z (k,): cells in their standard deviations, normal; correlation (k, k); near (k, k): whether
    cells are neighbours, and each its own. cells: so many are the map (default: all); others speak
    with their neighbours. Cells of the map that are raised together are a patch. What none shows, a
    step of a neighbourhood against all others may, which raises z by the weights (k,), the inverse
    standard deviations. Maps of nothing with the same correlation say what comes by chance, of
    raised cells and of steps of any width, at half the level each.
    """
    c = slice(0, cells)
    value, vector = np.linalg.eigh(correlation)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    draws = np.random.default_rng(0).normal(size=(MAPS, len(z))) @ root.T
    raised, largest = np.zeros(MAPS), []
    found = [[one for _, *one in _clusters(z[None, c], correlation[c, c], near[c, c])]]
    for n, _, size in _clusters(draws[:, c], correlation[c, c], near[c, c]):
        raised[n] = max(raised[n], abs(size))
    inverse = np.linalg.pinv(correlation, rcond=OPEN, hermitian=True)
    for reach in _ever_wider(near):
        step = reach * weight @ inverse
        sigma = np.sqrt(np.maximum(np.einsum("ij,ij->i", step, reach * weight), 1e-12))
        size = step @ z / sigma
        largest.append(np.abs(draws @ step.T / sigma).max(axis=1))
        # Beside a step all others seem to go the other way: of each width the one that shows most.
        best = np.argmax(np.abs(size))
        found.append([(np.flatnonzero(reach[best, c]), size[best])])
    chance = 1.0 - (rankdata(largest, "min", axis=1) - 1.0) / MAPS if largest else np.ones((1, 1))
    least = chance.min(axis=0)
    out: list[Patch] = []
    for n, some in enumerate(found):
        for cells, size in some:
            if n:
                more = float(np.mean(least <= np.mean(largest[n - 1] >= abs(size))))
            else:
                more = float(np.mean(raised >= abs(size)))
            if more < 0.5 * level and not any(np.isin(cells, one.cells).any() for one in out):
                out.append(Patch(cells, float(size), max(2.0 * more, 1.0 / MAPS)))
    return sorted(out, key=lambda one: -abs(one.z))


def _ever_wider(near: np.ndarray) -> Iterator[np.ndarray]:
    """Neighbourhoods (k, k) of cells, up to half of the map, each twice as wide as the last."""
    reach, before = near.astype(float), 0.0
    # A map of several parts may have no neighbourhood of half of it.
    while before < reach.mean() < 0.5:
        yield reach
        reach, before = (reach @ reach > 0).astype(float), reach.mean()


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
