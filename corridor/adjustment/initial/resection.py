"""The pose of an image from the known points it sees."""

import numpy as np

from corridor.adjustment.initial.network import AGREEING, GATES_PX, Network
from corridor.geometry import closed_pose, refine_poses, relative_width

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
        found = closed_pose(near, ray, gate * network.pixel[image])
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


def refine(network: Network, images: np.ndarray) -> None:
    """Poses of oriented images from the known points they see; a GNSS position stays."""
    at = images[network.held[images]]
    # The turn moves the arm, and with it the centre below the antenna.
    for _ in range(3 if len(at) else 1):
        arm = np.einsum("nij,ni->nj", network.rotation[at], network.arm[at])
        network.centre[at] = network.antenna[at] - arm
        refine_poses(
            images.astype(np.int64), network.rays, network.image_start, network.point,
            network.place, network.known, float(network.gate), network.held,
        )  # fmt: skip
