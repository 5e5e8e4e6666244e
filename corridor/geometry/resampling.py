"""How certain a value is, by the groups of what it was estimated from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri


def jackknife(values: Sequence[float]) -> float:
    """Standard deviation by leaving out one group in turn (Efron and Tibshirani 1993, eq. 11.5)."""
    count = len(values)
    if count < 2:
        return float("nan")
    return float(np.sqrt((count - 1) / count * np.sum((values - np.mean(values)) ** 2)))


def honest(formal: float, by_strips: float, groups: int) -> float:
    """The formal sigma, or that of a jackknife where it contradicts the formal one.

    A jackknife over few groups scatters itself, with groups - 1 degrees of freedom: it is taken
    where it is larger than chance makes it in one flight of twenty.
    """
    free = groups - 1
    if free < 1 or not np.isfinite(by_strips):
        return formal
    return by_strips if free * (by_strips / formal) ** 2 > chdtri(free, 0.05) else formal
