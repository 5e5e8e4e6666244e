"""What adjusted points take over from poses and what images share.

A point follows from its rays once the images are known: with u the unknowns of the equations,

    P = own - K' u,    cov(P_i, P_j) = [i = j] V_i^-1 + K_i' N^-1 K_j

so any linear function of points has an exact variance, at the price of one solution.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import CHUNK, Normal, View


@dataclass(frozen=True)
class PointGains:
    """points (k,): positions among those of the system. own (k, 3, 3): V^-1, m^2, of each at given
    poses. gain (n, 3k): K, by the columns of the system.
    """

    points: np.ndarray
    own: np.ndarray
    gain: csc_array


def point_gains(system: LinearSystem, points: np.ndarray) -> PointGains:
    """V^-1 and K of some points (k,), positions among `system.points`, each at most once."""
    p = system.problem
    points = np.asarray(points, dtype=np.int64)
    normal = Normal(p, system.loss, storage=system.storage)
    view, modelled = normal.view(system.state), normal.modelled_at(system.state)
    number = np.full(len(p.ptr) - 1, -1)
    number[points] = np.arange(len(points))
    # Of points that are not control, the last.
    weight = np.concatenate([normal.control_weight[0], np.zeros((1, 6))])
    inverse = np.zeros((len(points), 3, 3))
    own = np.zeros((len(p.img), p.d, 3))
    shared = np.zeros((len(points), p.shared_count, 3))
    ground = np.concatenate([_of_control(normal, view), np.zeros((1, 3, p.wide))])
    for first, last in normal.chunks(0, len(p.ptr) - 1, CHUNK):
        wanted = np.flatnonzero(number[first:last] >= 0)
        if not len(wanted):
            continue
        scene = normal.scene(view, modelled, first, last)
        control = p.control[first:last]
        rays = normal.engine.rows(first, last, scene, control, weight[control])
        root = np.zeros((last - first, 3, 3))
        root[:, *np.tril_indices(3)] = rays.root
        whole = root.transpose(0, 2, 1) @ root
        by_point = rays.point.reshape(-1, 2, 3)
        of_ray = np.repeat(np.arange(last - first), np.diff(rays.start))
        gain = whole[of_ray] @ by_point.transpose(0, 2, 1)
        found = gain @ rays.own.reshape(-1, 2, p.d)
        own[p.ptr[first] : p.ptr[last]] = found.transpose(0, 2, 1)
        inverse[number[first + wanted]] = whole[wanted]
        if p.shared_count:
            each = gain @ rays.shared.reshape(len(of_ray), 2, -1)
            add = csr_array((np.ones(len(of_ray)), np.arange(len(of_ray)), rays.start))
            total = (add @ each.reshape(len(of_ray), -1)).reshape(last - first, 3, -1)
            total += whole @ ground[control]
            found = total[wanted, :, : p.shared_count]
            shared[number[first + wanted]] = found.transpose(0, 2, 1)
    return PointGains(points, inverse, _matrix(system, points, own, shared))


def _of_control(normal: Normal, view: View) -> np.ndarray:
    """W B (c, 3, wide) of control points: B their rows by what is shared."""
    p, by = normal.problem, view.d_ground
    out = np.zeros((len(by), 3, p.wide))
    for slot in range(by.shape[2]):
        some = np.flatnonzero(p.ground_column[:, slot] >= 0)
        out[some, :, p.ground_column[some, slot]] += by[some, :, slot]
    weight = normal.control_weight[0][:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
    return weight @ out


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
