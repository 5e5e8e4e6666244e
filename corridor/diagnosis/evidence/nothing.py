"""One probability for "nothing is missing": that of the whole search, all its tests together.

Of the equations of the believed model alone, with the noise of the GNSS that belongs to it, the
statistic is what all groups that images share say together,

    T = log sum_k B_k,   B_k: evidence of the k-th group, its prior probability included,

which is the evidence of "one of them is missing", whichever. How large it becomes where nothing is
missing is asked of scores g that are drawn. Residuals of a real flight hang together, so half of
what is known of their spread is resampled: with g_c what a run c of images contributes,

    g = sqrt(a) M^1/2 z + sqrt(1 - a) (sum_c xi_c g_c + what noise of the GNSS contributes)

z, xi: independent, of unit variance; a = m / (m + clusters), m as of `scores`. All tests see the
same draw, so their number and correlation need no correction.
Source: Anau Montel, Alvey and Weniger 2024 (one level for many correlated local tests of a base
model); Cameron, Gelbach and Miller 2008 (wild bootstrap by clusters).
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtr, chdtri

from corridor.core.adjustment import Design, LinearSystem, Sets
from corridor.diagnosis.evidence.evidence import Evidence, Spectrum
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination

# Runs at most: each is a right side of all equations.
_MOST_RUNS = 24
# Share of the squares of scores that tell what is usual, and directions that are enough for it.
_LOWER, _FEWEST = 0.8, 20


def probability_of_nothing(evidence: Evidence, rng: np.random.Generator) -> float:
    """Probability of evidence like that of a block from which nothing is missing, or more.

    evidence: beside no effect, with the noise of the GNSS that fits none. At least one over the
    number of draws.
    """
    drawn = null_scores(evidence, SETTINGS.null_draws, rng)
    every = np.concatenate([evidence.reduced.g[:, None], drawn], axis=1)
    each = evidence.of_scores(every / _size(evidence, every))
    found = np.logaddexp.reduce([np.full(every.shape[1], -np.inf), *each], axis=0)
    return float((1 + np.count_nonzero(found[1:] >= found[0])) / len(found))


def _size(evidence: Evidence, core: np.ndarray) -> np.ndarray:
    """By how much the usual score is larger than its standard deviation (k,), of scores (c, k).

    The noise is known to some per cent, and what is usual in all directions is noise: of the
    squares, the lower four in five. So it does not matter to the draws and to what is measured.
    """
    whole = Spectrum.of(evidence.reduced.M)
    known = whole.value > 1.0
    if np.count_nonzero(known) < _FEWEST:
        return np.ones(core.shape[1])
    square = (whole.vector[:, known].T @ core) ** 2 / whole.value[known, None]
    lower = np.sort(square, axis=0)[: int(_LOWER * len(square))]
    # Mean of such squares of a normal variable below the quantile q: F_3(q) / F_1(q).
    usual = chdtr(3.0, chdtri(1.0, 1.0 - _LOWER)) / _LOWER
    return np.sqrt(lower.mean(axis=0) / usual)


def null_scores(evidence: Evidence, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Scores of the core (c, draws) of blocks from which nothing is missing."""
    independent = Spectrum.of(evidence.reduced.M).drawn(draws, rng)
    by_run = scores_by_run(evidence.reduced.elimination)
    count = by_run.shape[1]
    if not count:
        return independent
    worth = SETTINGS.clusters_of_prior / (SETTINGS.clusters_of_prior + count)
    resampled = by_run @ rng.standard_normal((count, draws))
    resampled += of_antenna(evidence.reduced.elimination, draws, rng)
    return np.sqrt(worth) * independent + np.sqrt(1.0 - worth) * resampled


def scores_by_run(elimination: Elimination) -> np.ndarray:
    """What runs of images contribute to the scores of the core (c, runs)."""
    e = elimination.equations
    design = Design(e.system)
    step = np.zeros((len(e.system.columns), 1))
    step[elimination.at] = e.unit[elimination.at, None] * elimination.solve(elimination.here)
    left, *_ = design.back(residuals(elimination), step)
    right = design.right(by_run(e.system, left))
    return elimination.scores(right, np.zeros((len(e.residual), right.shape[1])))


def residuals(elimination: Elimination) -> Sets:
    """Pseudo-residuals of the images, in standard deviations, and residuals of the control, m."""
    e = elimination.equations
    image = np.nan_to_num(e.pixels) / e.scales.of_observation[:, None]
    return Sets([image.ravel()], e.system.control.residual.reshape(-1, 1))


def by_run(system: LinearSystem, errors: Sets) -> Sets:
    """The errors of one set of measurements as a set for each run of images."""
    rows, run = system.image_rows, runs(system)
    of_row = np.repeat(run[rows.image], 2)
    # An error of a control point counts where it is first seen.
    first = np.zeros(len(system.points.names), dtype=np.int64)
    first[rows.point[::-1]] = run[rows.image[::-1]]
    index = {name: n for n, name in enumerate(system.points.names)}
    of_control = np.array([first[index[name]] for name in system.control.names], dtype=np.int64)
    numbers = np.arange(int(run.max()) + 1)
    mine = np.repeat(of_control, 3)[:, None] == numbers
    image = [np.where(of_row == n, errors.image[0], 0.0) for n in numbers]
    return Sets(image, np.where(mine, errors.control, 0.0))


def of_antenna(elimination: Elimination, draws: int, rng: np.random.Generator) -> np.ndarray:
    """What noise of GNSS, distances and lens contributes to the scores of the core (c, draws)."""
    e, noise = elimination.equations, elimination.noise
    # A lens of the size that it has: what its prior expects of it is off by as much.
    priors = rng.standard_normal((len(elimination.sizes), draws)) / elimination.sizes[:, None]
    if noise is None:
        moved = e.stated[:, None] * rng.standard_normal((len(e.stated), draws))
    else:
        moved = noise.draw(rng, draws)
    # Distances have no image either.
    rows = e.system.distance
    errors = rng.standard_normal((len(rows.sigma), draws)) / rows.sigma
    return elimination.scores(rows.jacobian.T @ errors, moved, priors)


def runs(system: LinearSystem) -> np.ndarray:
    """Number (images,) of the run of each image: neighbours in time, of one flight."""
    images = system.images
    time = np.where(np.isfinite(images.time), images.time, system.image_order)
    order = np.lexsort((system.image_order, time, images.flight))
    count = np.clip(len(order) // SETTINGS.run_of_images, 1, _MOST_RUNS)
    run = np.empty(len(order), dtype=np.int64)
    run[order] = np.arange(len(order)) * count // len(order)
    return run
