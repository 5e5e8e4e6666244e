"""Tests of many numbers that are correlated: all at once, and one by one.

Source: Pelzer 1971, Caspary 2000 (global congruency); Benjamini and Hochberg 1995 (false
discovery rate).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, f, false_discovery_control, norm, t

# Directions of a covariance without information, against its largest.
OPEN = 1e-9


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
    """Whether changes are significant at a level: as a whole, or one of them. probability: the
    smaller of both, for two tests."""

    significant: bool
    probability: float
    freedom: int


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
    found = discoveries(single, 0.5 * level).any() or overall.probability < 0.5 * level
    least = min(overall.probability, float(single.min()) * len(single))
    return Test(bool(found), float(min(2.0 * least, 1.0)), overall.freedom)
