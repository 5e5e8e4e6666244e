"""Observations that can be spared, so that a fit can be asked for them."""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.settings import SETTINGS


def spared(point: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Rows (k,), ascending, of a share of observations: one of a point of four rays or more.

    point: (n,) number of the point of each tie observation.
    """
    multiplicity = np.bincount(point)
    order = rng.permutation(np.flatnonzero(multiplicity[point] >= SETTINGS.held_out_rays))
    _, first = np.unique(point[order], return_index=True)
    return np.sort(rng.permutation(order[first])[: max(int(share * len(point)), 1)])
