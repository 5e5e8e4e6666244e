"""What adjusted points take over from poses and what images share.

A point follows from its rays once the images are known: with u the unknowns of the equations,

    P = own - K' u,    cov(P_i, P_j) = [i = j] V_i^-1 + K_i' N^-1 K_j

so any linear function of points has an exact variance, at the price of one solution.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import Normal
from corridor.core.engine.point_covariance import point_regression as fill_gains


@dataclass(frozen=True)
class PointRegression:
    """points (k,): positions among those of the system. own (k, 3, 3): V^-1, m^2, of each at given
    poses. gain (n, 3k): K, by the columns of the system.
    """

    points: np.ndarray
    own: np.ndarray
    gain: csc_array


def point_regression(system: LinearSystem, points: np.ndarray) -> PointRegression:
    """V^-1 and K of some points (k,), positions among `system.points`, each at most once."""
    p = system.problem
    points = np.asarray(points, dtype=np.int64)
    normal = Normal(p, system.loss, storage=system.storage)
    view, modelled = normal.view(system.state), normal.modelled_at(system.state)
    wanted = np.full(len(p.ptr) - 1, -1)
    wanted[points] = np.arange(len(points))
    inverse = np.zeros((len(points), 6))
    own = np.zeros((len(p.img), p.d, 3))
    shared = np.zeros((len(points), p.shared_count, 3))
    for first, last in normal.chunks(0, len(p.ptr) - 1):
        scene = normal.scene(view, modelled, first, last)
        fill_gains(wanted, first, last, scene, p.d, normal.longest, inverse, own, shared)
    full = inverse[:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
    return PointRegression(points, full, _matrix(system, points, own, shared))


def _matrix(system: LinearSystem, points, own, shared) -> csc_array:
    p = system.problem
    length = np.diff(p.ptr)[points]
    rays = np.repeat(p.ptr[points], length) + _count(length)
    number = np.repeat(np.arange(len(points)), length)
    axis = np.arange(3)
    row = p.img[rays][:, None, None] * p.d + np.arange(p.d)[:, None]
    parts = [(own[rays], row, 3 * number[:, None, None] + axis)]
    if p.shared_count:
        row = p.image_count * p.d + np.arange(p.shared_count)[:, None]
        parts.append((shared, row, 3 * np.arange(len(points))[:, None, None] + axis))
    value, row, column = (
        np.concatenate([np.broadcast_to(part[n], part[0].shape).ravel() for part in parts])
        for n in range(3)
    )
    return csc_array((value, (row, column)), shape=(len(system.columns), 3 * len(points)))


def _count(length: np.ndarray) -> np.ndarray:
    """0, 1, .. of each run of so many."""
    return np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
