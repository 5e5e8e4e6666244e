"""Poses that fit the points they see, from near ones."""

import numpy as np

from corridor.adjustment.initial.network import Network
from corridor.compiled import compiled


def refine(network: Network, images: np.ndarray) -> None:
    """Poses of oriented images from the known points they see; a GNSS position stays."""
    at = images[network.held[images]]
    # The turn moves the arm, and with it the centre below the antenna.
    for _ in range(3 if len(at) else 1):
        arm = np.einsum("nij,ni->nj", network.rotation[at], network.arm[at])
        network.centre[at] = network.antenna[at] - arm
        _refine_poses(
            images.astype(np.int64), network.image_start, network.point, network.ray,
            network.place, network.known, network.rotation, network.centre, network.pixel,
            network.gate, network.held,
        )  # fmt: skip


@compiled()
def _refine_poses(images, image_start, point, ray, place, known, rotation, centre, pixel, gate,
                  at):  # fmt: skip
    """Poses that fit the known points best: Levenberg-Marquardt, Cauchy weights, in place.

    at: images whose centre stays.
    """
    for i in images:
        free = 3 if at[i] else 6
        r, c = rotation[i].copy(), centre[i].copy()
        rows = np.empty(image_start[i + 1] - image_start[i], dtype=np.int64)
        count = 0
        for n in range(image_start[i], image_start[i + 1]):
            if known[point[n]]:
                rows[count] = n
                count += 1
        if count < 4:
            continue
        rows = rows[:count]
        damping = 1e-6
        cost, m, b = _pose_system(r, c, rows, point, ray, place, pixel[i], gate, free)
        for _ in range(20):
            system = m.copy()
            for k in range(free):
                system[k, k] += damping * (m[k, k] + 1e-12)
            step = np.linalg.solve(system, b)
            trial_r = _turn(step[:3]) @ r
            trial_c = c.copy()
            if free == 6:
                trial_c += step[3:]
            trial, m2, b2 = _pose_system(
                trial_r, trial_c, rows, point, ray, place, pixel[i], gate, free
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
        rotation[i] = r
        centre[i] = c


@compiled()
def _pose_system(r, c, rows, point, ray, place, pixel, gate, free):
    """Cost of a pose, its normal matrix and right-hand side for a turn and a shift of the centre.

    free: 6, or 3 for the turn alone.
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
        eu, ev = (ray[n, 0] - u) / pixel, (ray[n, 1] - v) / pixel
        square = (eu * eu + ev * ev) / (gate * gate)
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
            b[k] += w * (ju[k] * eu + jv[k] * ev) / pixel
            for h in range(free):
                m[k, h] += w * (ju[k] * ju[h] + jv[k] * jv[h]) / (pixel * pixel)
    return cost, m, b


@compiled()
def _turn(w):
    """Rotation (3, 3) by the vector w, rad (Rodrigues)."""
    angle = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-8:
        return np.eye(3) + cross
    s = np.sin(angle) / angle
    h = np.sin(angle / 2) / (angle / 2)
    return np.eye(3) + s * cross + 0.5 * h * h * (cross @ cross)
