"""Poses of images from known points that they see.

Source of the closed solutions: OpenCV (AP3P within RANSAC; SQPNP for a few points).
"""

import numpy as np

from corridor.core.engine.compiled import compiled
from corridor.core.geometry.vectors import rotated, sines

# So many points are few: all of them count, and none is set aside.
FEW_POINTS = 6


def closed_pose(points: np.ndarray, rays: np.ndarray, gate: float):
    """Rotation, centre and agreeing share of a resection on points near the origin, or None."""
    import cv2  # a second and 50 MB

    few = len(points) < FEW_POINTS
    cv2.setRNGSeed(0)
    try:
        if few:
            done, turn, shift = cv2.solvePnP(
                points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
            )
        else:
            done, turn, shift, _ = cv2.solvePnPRansac(
                points, rays, np.eye(3), None, iterationsCount=300, reprojectionError=gate,
                confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
            )  # fmt: skip
    except cv2.error:
        return None
    if not done:
        return None
    rotation = cv2.Rodrigues(turn)[0]
    seen = points @ rotation.T + shift.ravel()
    agreeing = seen[:, 2] > 0
    if not few:
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - rays, axis=1)
        agreeing &= off < gate
    return rotation, -rotation.T @ shift.ravel(), agreeing.mean()


@compiled()
def refine_poses(images, rays, starts, point, place, known, gate, held):
    """Poses that fit the known points best: Levenberg-Marquardt, Cauchy weights, in place.

    images (k,): those to move, of the `Rays`, which stand image by image. starts (m + 1,): where
    those of an image begin. point (n,): what each ray sees; place (p, 3), known (p,): of points.
    gate: width of the weights, px. held (m,): images whose centre stays.
    """
    rotation, centre = rays.rotation, rays.centre
    for i in images:
        free = 3 if held[i] else 6
        r, c = rotation[i].copy(), centre[i].copy()
        rows = np.empty(starts[i + 1] - starts[i], dtype=np.int64)
        count = 0
        for n in range(starts[i], starts[i + 1]):
            if known[point[n]]:
                rows[count] = n
                count += 1
        if count < 4:
            continue
        rows = rows[:count]
        damping = 1e-6
        cost, m, b = _pose_system(r, c, free, rows, rays, point, place, gate * rays.pixel[i])
        for _ in range(20):
            system = m.copy()
            for k in range(free):
                system[k, k] += damping * (m[k, k] + 1e-12)
            step = np.linalg.solve(system, b)
            trial_r = _turned(r, step)
            trial_c = c.copy()
            for k in range(free - 3):
                trial_c[k] += step[3 + k]
            trial, m2, b2 = _pose_system(
                trial_r, trial_c, free, rows, rays, point, place, gate * rays.pixel[i]
            )
            if trial <= cost:
                gain = cost - trial
                r, c, cost, m, b = trial_r, trial_c, trial, m2, b2
                damping = max(damping * 0.1, 1e-12)
                if gain <= 1e-9 * (1.0 + cost):
                    break
            else:
                damping *= 30.0
                if damping > 1e6:
                    break
        for k in range(3):
            centre[i, k] = c[k]
            for j in range(3):
                rotation[i, k, j] = r[k, j]


@compiled()
def _pose_system(r, c, free, rows, rays, point, place, gate):
    """Cost of a pose, its normal matrix and right-hand side for a turn and a shift of the centre.

    free: 6, or 3 for the turn alone. gate: as a ray.
    """
    m = np.zeros((free, free))
    b = np.zeros(free)
    cost = 0.0
    ju = np.empty(6)
    jv = np.empty(6)
    for n in rows:
        p = point[n]
        d0, d1, d2 = place[p, 0] - c[0], place[p, 1] - c[1], place[p, 2] - c[2]
        x = r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2
        y = r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2
        z = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
        if z <= 0.0:
            cost += 50.0
            continue
        u, v = x / z, y / z
        eu, ev = (rays.ray[n, 0] - u) / gate, (rays.ray[n, 1] - v) / gate
        square = eu * eu + ev * ev
        cost += np.log1p(square)
        w = 1.0 / (1.0 + square)
        # d(x, y, z) by a small turn of the camera is the turn times (x, y, z), by its centre -R.
        ju[0], jv[0] = -u * v, -(1.0 + v * v)
        ju[1], jv[1] = 1.0 + u * u, u * v
        ju[2], jv[2] = -v, u
        for k in range(3):
            ju[3 + k] = -(r[0, k] - u * r[2, k]) / z
            jv[3 + k] = -(r[1, k] - v * r[2, k]) / z
        for k in range(free):
            b[k] += w * (ju[k] * eu + jv[k] * ev) / gate
            for h in range(free):
                m[k, h] += w * (ju[k] * ju[h] + jv[k] * jv[h]) / (gate * gate)
    return cost, m, b


@compiled()
def _turned(r, step):
    """Rotation (3, 3) turned on by the vector step[:3], rad."""
    out = np.empty((3, 3))
    turn = step[0], step[1], step[2]
    s, q = sines(turn)
    for k in range(3):
        out[0, k], out[1, k], out[2, k] = rotated(s, q, turn, (r[0, k], r[1, k], r[2, k]))
    return out
