"""Which points stand still, and the epochs laid together on them.

An S-transformation takes out of displacements d the motion of the whole block that weighted points
ask for: d~ = S d, S = I - G (G'WG)^-1 G'W. With weights 1 / |d~|, found again and again, the
points that move count less and less and those that stand still carry the datum.
Source: Baarda 1973 (S-transformation); Chen 1983 (iterative weighted similarity transformation).
"""

from __future__ import annotations

import numpy as np

from corridor.geometry import helmert_motions

# Displacements below this share of their own sigma weigh no more for being smaller.
FLOOR = 0.3
PASSES = 100
# Motions that a datum can take out: everything, without scale, position alone.
MOTIONS = {"similarity": 7, "rigid": 6, "translation": 3}


def motions_at(xyz: np.ndarray, kind: str, middle: np.ndarray | None = None) -> np.ndarray:
    """G (n, 3, k): what the whole block may do, by its points (n, 3); middle (default: theirs)."""
    return helmert_motions(xyz, middle)[:, :, : MOTIONS[kind]]


def s_transformation(motions: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The k x n matrix that finds the motion in displacements: (G'WG)^-1 G'W."""
    heavy = weight[:, None] * motions
    return np.linalg.pinv(motions.T @ heavy, rcond=1e-12) @ heavy.T


def stable_weights(change: np.ndarray, motions: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Weights (n,) under which the sum of |S d| is least: large where nothing moves.

    change, sigma (n,): numbers with their standard deviations. motions (n, k).
    """
    weight = sigma**-2.0
    for _ in range(PASSES):
        moved = change - motions @ (s_transformation(motions, weight) @ change)
        new = 1.0 / (sigma * np.maximum(np.abs(moved), FLOOR * sigma))
        done = np.abs(new - weight).max() < 1e-6 * new.max()
        weight = new
        if done:
            break
    return weight
