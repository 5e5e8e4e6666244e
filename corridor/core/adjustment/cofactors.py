"""Cofactors of residuals: which share of an error in a measurement its residual shows.

In units of the stated standard deviations, with B the design matrix and Q the cofactors of all
unknowns, the residuals v and the errors e of the measurements follow

    v = R e,   R = 1 - B Q B',   cofactors of v: R itself

Positions of antennas need their image and what is shared; rays and coordinates of one point need
the images that show it, which lie within the pattern of the equations.
Source: Baarda 1968; Förstner 1979 for the redundancy numbers, the diagonal of R.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.design import Design
from corridor.core.adjustment.measured_poses import pose_rows

# Random signs for redundancies: of a hundred numbers the sum is known to 2 %.
_SIGNS = 64


def of_antennas(covariance: Covariance, kind: str = "gnss") -> np.ndarray:
    """R (k, 3, 3) of the antenna positions, or attitudes, each with itself."""
    system = covariance.system
    p = system.problem
    if not len(p.measured(kind)):
        return np.zeros((0, 3, 3))
    rows = pose_rows(kind, p, system.state, system.images)
    root = np.sqrt(rows.weight)[:, :, None]
    own, shared, image = rows.own * root, rows.shared * root, rows.image
    used = np.flatnonzero(shared.any(axis=(0, 1)))
    shared = shared[:, :, used]
    at = image[:, None] * p.d + np.arange(p.d)
    cross = covariance.poses_shared[at][:, :, used]
    mixed = own @ cross @ shared.transpose(0, 2, 1)
    known = own @ covariance.each_pose[image] @ own.transpose(0, 2, 1)
    known += mixed + mixed.transpose(0, 2, 1)
    known += shared @ covariance.shared[np.ix_(used, used)] @ shared.transpose(0, 2, 1)
    return np.eye(3) - known


def shares_of_antennas(covariance: Covariance) -> np.ndarray:
    """Redundancies (k, 3) of the antenna positions, of which the sums over many are meant.

    With random signs e the mean of e times R e is the diagonal of R; of n numbers together with
    `_SIGNS` of them the sum r is known to sqrt(2 r / _SIGNS). Few positions are asked one by one.
    Source: Hutchinson 1990.
    """
    system = covariance.system
    rows = system.gnss
    count = rows.sigma.size
    if count <= _SIGNS:
        sign = np.eye(count)
    else:
        sign = np.random.default_rng(0).choice([-1.0, 1.0], (count, _SIGNS)) / np.sqrt(_SIGNS)
    root = 1.0 / rows.sigma.ravel()[:, None]
    seen = root * (rows.jacobian @ covariance.solve(rows.jacobian.T @ (root * sign)))
    return np.sum(sign * (sign - seen), axis=1).reshape(-1, 3)


class OfPoint(NamedTuple):
    """Residuals of one point: of its n rays x, y and, of control, of its three coordinates.

    point: its number. share: R of these residuals (2 n, 2 n) or (2 n + 3, 2 n + 3).
    """

    point: int
    share: np.ndarray


def of_points(covariance: Covariance, points: Sequence[int]) -> Iterator[OfPoint]:
    """R of the residuals of some points, one after the other; of marked ones it takes least."""
    system = covariance.system
    p = system.problem
    ground = system.control.jacobian
    m, d, q = p.image_count, p.d, p.shared_count
    shared_at = m * d + np.arange(q)
    for point, rays in zip(points, Design(system).rays_of(points), strict=True):
        image = rays.image
        n = len(image)
        names, place = np.unique(image, return_inverse=True)
        own = np.zeros((2 * n, len(names), d))
        own[np.arange(2 * n), np.repeat(place, 2)] = rays.own
        by = np.concatenate([own.reshape(2 * n, -1), rays.shared], axis=1)
        at_point = rays.point
        columns = np.concatenate([(names[:, None] * d + np.arange(d)).ravel(), shared_at])
        control = p.control[point]
        if control >= 0:
            root = np.sqrt(p.control_weight[control])
            moved = ground[3 * control : 3 * control + 3][:, columns].toarray()
            by = np.concatenate([by, moved * root[:, None]])
            at_point = np.concatenate([at_point, root[:, None] * p.control_turn[control]])
        half = np.zeros((3, 3))
        half[np.tril_indices(3)] = rays.root[0]
        half = at_point @ half.T
        left = np.eye(len(at_point)) - half @ half.T
        seen = left @ by
        between = covariance.poses_shared[columns[: len(names) * d]]
        poses = covariance.of_marked.get(point)
        poses = covariance.of_images(names) if poses is None else poses
        known = np.block([[poses, between], [between.T, covariance.shared]])
        share = left - seen @ known @ seen.T
        yield OfPoint(point, share)


def of_control(covariance: Covariance) -> np.ndarray:
    """R (3 c, 3 c) of the residuals of c control points together."""
    p, (points, own, rows) = covariance.system.problem, covariance.control
    c = len(points)
    root = np.sqrt(p.control_weight[:c])[:, :, None] * p.control_turn[:c]
    seen = np.zeros((3 * c, 3 * c))
    for some, known in covariance.with_control():
        seen[:, some] = rows @ known
    between = seen.reshape(c, 3, c, 3).transpose(0, 2, 1, 3)
    between[np.arange(c), np.arange(c)] += own
    between = root[:, None] @ between @ root.transpose(0, 2, 1)
    out = np.eye(3 * c) - between.transpose(0, 2, 1, 3).reshape(3 * c, 3 * c)
    return (out + out.T) / 2.0


def with_control(covariance: Covariance) -> np.ndarray:
    """Covariances (3 c, q) of what control sees with the shared unknowns, in its own standard
    deviations."""
    p, points = covariance.system.problem, covariance.control.points
    c, first = len(points), p.image_count * p.d
    root = np.sqrt(p.control_weight[:c])[:, :, None] * p.control_turn[:c]
    parts = [known[first : first + p.shared_count] for _, known in covariance.with_control()]
    return (root @ np.concatenate(parts, axis=1).T.reshape(c, 3, -1)).reshape(3 * c, -1)
