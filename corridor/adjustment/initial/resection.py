"""The pose of an image from the known points it sees.

Source of the closed solutions: OpenCV (AP3P within RANSAC; SQPNP for a few points).
"""

import cv2
import numpy as np

from corridor.adjustment.initial.frame import width
from corridor.adjustment.initial.network import AGREEING, GATES_PX, Network
from corridor.adjustment.initial.refinement import refine

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
    if reach == 0 or width(place) < 1e-3:
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
