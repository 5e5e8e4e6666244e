"""How certain a value is, by the groups of what it was estimated from."""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri


def jackknife(values: Sequence[float]) -> float:
    """Standard deviation by leaving out one group in turn (Efron and Tibshirani 1993, eq. 11.5)."""
    count = len(values)
    if count < 2:
        return float("nan")
    return float(np.sqrt((count - 1) / count * np.sum((np.asarray(values) - np.mean(values)) ** 2)))


def cluster_robust_sigma(
    whole: float, sigma: float, left: Sequence[float], left_sigma: Sequence[float]
) -> tuple[float, float]:
    """Standard deviation of an estimate by what it becomes without each group, and its freedom.

    whole, sigma: of all groups, by least squares, with its formal standard deviation; left,
    left_sigma (q,): without one group. The contrast left - whole of an efficient estimate has the
    variance left_sigma^2 - sigma^2 (Hausman 1978). Weighted by what a group brings of the
    information, squared contrasts over their variances are 1 on average where sigma holds,
    however unequal the groups: those of a jackknife, which takes all alike, are more.
    NaN and no freedom where no group brings anything.
    """
    ratio = np.minimum((sigma / np.asarray(left_sigma, dtype=float)) ** 2, 1.0)
    share = 1.0 - ratio
    if not share.sum() > 0.0:
        return float("nan"), 0.0
    factor = np.sum(ratio * ((np.asarray(left) - whole) / sigma) ** 2) / share.sum()
    return float(sigma * np.sqrt(factor)), float(share.sum() ** 2 / np.sum(share**2) - 1.0)


def sigma_by_test(formal: float, by_groups: float, free: float) -> float:
    """The formal sigma, or that of groups left out in turn where it contradicts the formal one.

    Few groups scatter themselves, with so many degrees of freedom: theirs is taken where it is
    larger than chance makes it in one flight of twenty.
    """
    if free < 1 or not np.isfinite(by_groups):
        return formal
    return by_groups if free * (by_groups / formal) ** 2 > chdtri(free, 0.05) else formal
