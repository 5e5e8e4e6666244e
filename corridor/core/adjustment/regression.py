"""What adjusted points take over from poses and what images share.

A point follows from its rays once the images are known: with u the unknowns of the equations,

    P = own - K' u,    cov(P_i, P_j) = [i = j] V_i^-1 + K_i' N^-1 K_j

so any linear function of points has an exact variance, at the price of one solution.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_array, csc_array, csr_array, hstack

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import CHUNK, Normal, View
from corridor.core.adjustment.problem import Problem, problem_of_points


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
    few = problem_of_points(p, points)
    state = replace(system.state, points=system.state.points[points])
    normal = Normal(few, system.loss, storage=system.storage)
    view, modelled = normal.view(state), normal.modelled_at(state)
    # Of points that are not control, the last.
    weight = np.concatenate([normal.control_weight[0], np.zeros((1, 6))])
    ground = np.concatenate([_of_control(normal, view), np.zeros((1, 3, p.wide))])
    inverse = np.zeros((len(points), 3, 3))
    own = np.zeros((len(few.img), 3, p.d))
    shared = np.zeros((len(points), 3, p.shared_count))
    for first, last in normal.chunks(0, len(points), CHUNK):
        scene = normal.scene(view, modelled, first, last)
        control = few.control[first:last]
        rays = normal.engine.rows(scene, control, weight[control])
        root = np.zeros((last - first, 3, 3))
        root[:, *np.tril_indices(3)] = rays.root
        whole = inverse[first:last] = root.transpose(0, 2, 1) @ root
        # V^-1 P' and K', ray by ray: `einsum` takes three times as long over small products.
        of_ray = np.repeat(np.arange(last - first), np.diff(rays.start))
        back = whole[of_ray] @ _pairs(rays.point).transpose(0, 2, 1)
        own[few.ptr[first] : few.ptr[last]] = back @ _pairs(rays.own)
        if p.shared_count:
            by = back @ _pairs(rays.shared)
            add = csr_array((np.ones(len(by)), np.arange(len(by)), rays.start))
            total = (add @ by.reshape(len(by), -1)).reshape(last - first, 3, -1)
            total += whole @ ground[control]
            shared[first:last] = total[..., : p.shared_count]
    return PointRegression(points, inverse, _matrix(system, few, own, shared))


def _of_control(normal: Normal, view: View) -> np.ndarray:
    """W B (c, 3, wide) of control points: B their rows by what is shared."""
    p, by = normal.problem, view.d_ground
    out = np.zeros((len(by), 3, p.wide))
    for slot in range(by.shape[2]):
        some = np.flatnonzero(p.ground_column[:, slot] >= 0)
        out[some, :, p.ground_column[some, slot]] += by[some, :, slot]
    weight = normal.control_weight[0][:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
    return weight @ out


def _pairs(rows: np.ndarray) -> np.ndarray:
    """Rows (2 n, k) ray by ray (n, 2, k)."""
    return rows.reshape(-1, 2, rows.shape[1])


def _matrix(system: LinearSystem, few: Problem, own: np.ndarray, shared: np.ndarray) -> csc_array:
    p, count = system.problem, len(shared)
    blocks = (own, few.img, few.ptr)
    of_images = bsr_array(blocks, shape=(3 * count, p.image_count * p.d), blocksize=(3, p.d))
    beside = csr_array((3 * count, len(system.columns) - p.image_count * p.d - p.shared_count))
    parts = [of_images.tocsr(), csr_array(shared.reshape(3 * count, p.shared_count)), beside]
    return csc_array(hstack(parts, format="csr").T)
