"""The pose of an image from the known points it sees.

Source of the closed solutions: OpenCV (AP3P within RANSAC; SQPNP for a few points).
"""

import cv2
import numpy as np

from corridor.adjustment.initial.network import AGREEING, GATES_PX, Network
from corridor.adjustment.kernels import rotated, sines
from corridor.compiled import compiled
from corridor.geometry import relative_width

# Marks, or points of any kind, that orient an image.
FEWEST_MARKS, _FEWEST_POINTS = 4, 6


def resect(network: Network, image: int) -> bool:
    """Pose of one image from the known points it sees; False where they do not agree on one."""
    rows = np.arange(network.image_start[image], network.image_start[image + 1])
    rows = rows[network.known[network.point[rows]]]
    place, ray = network.place[network.point[rows]], np.ascontiguousarray(network.ray[rows])
    marks = int(network.ground[network.point[rows]].sum())
    if len(rows) < _FEWEST_POINTS and marks < FEWEST_MARKS:
        return False
    origin = place.mean(0)
    reach = np.abs(place - origin).max()
    if reach == 0 or relative_width(place) < 1e-3:
        return False
    near = np.ascontiguousarray((place - origin) / reach)
    for gate in [gate for gate in GATES_PX if gate >= network.gate]:
        found = _closed(near, ray, gate * network.pixel[image])
        if found is None:
            continue
        rotation, centre, agreeing = found
        if agreeing < (AGREEING if gate < GATES_PX[-1] else 0.3):
            continue
        if agreeing * len(rows) < min(_FEWEST_POINTS, len(rows)):
            continue
        network.rotation[image], network.centre[image] = rotation, centre * reach + origin
        network.posed[image] = True
        network.gate = max(network.gate, gate)
        refine(network, np.array([image]))
        # Many marks know better than a GNSS that may be in another datum.
        if marks < FEWEST_MARKS and np.isfinite(network.antenna[image]).all():
            _hold(network, image)
        return True
    return False


def _hold(network: Network, image: int) -> None:
    """Take the centre of an image from GNSS, if it still sees its points from there."""
    free = network.rotation[image].copy(), network.centre[image].copy()
    before = network.agreement(image, GATES_PX[-1])
    network.held[image] = network.trusted[image] = True
    refine(network, np.array([image]))
    if network.agreement(image, GATES_PX[-1]) < AGREEING * before:
        network.held[image] = network.trusted[image] = False
        network.rotation[image], network.centre[image] = free


def _closed(points: np.ndarray, rays: np.ndarray, gate: float):
    """Rotation, centre and agreeing share of a resection on points near the origin, or None."""
    few = len(points) < _FEWEST_POINTS
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
            trial_r = _turned(r, step)
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
def _turned(r, step):
    """Rotation (3, 3) turned on by the vector step[:3], rad."""
    out = np.empty((3, 3))
    turn = step[0], step[1], step[2]
    s, q = sines(turn)
    for k in range(3):
        out[0, k], out[1, k], out[2, k] = rotated(s, q, turn, (r[0, k], r[1, k], r[2, k]))
    return out
