"""How a frame of its own lies in the world: from points, poses and antennas known in both."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from corridor.adjustment.initial.network import Network
from corridor.errors import InputError
from corridor.geometry import Similarity, nearest_rotation, similarity


def frame_between(island: Network, network: Network) -> Similarity | None:
    """Similarity from the island to the network, None where nothing fixes it."""
    points = np.flatnonzero(island.known & network.known)
    poses = np.flatnonzero(island.posed & network.posed)
    antenna = np.flatnonzero(island.posed & ~network.posed & np.isfinite(network.antenna).all(1))
    arm = np.einsum("nij,ni->nj", island.rotation[antenna], network.arm[antenna])

    def source_at(scale: float) -> np.ndarray:
        """What both know, in the island: arms shrink where its unit is `scale` metres."""
        tips = island.centre[antenna] + arm / scale
        return np.concatenate([island.place[points], island.centre[poses], tips])

    target = np.concatenate(
        [network.place[points], network.centre[poses], network.antenna[antenna]]
    )
    source = source_at(np.inf)
    if len(source) >= 3 and width(target) > 0.01:
        frame = _robust(source_at, target)
        if frame is not None:
            return frame
    # On one line, or less: the view tells how the island is turned about it.
    free = island.centre[island.posed]
    if len(poses):
        turns = np.swapaxes(network.rotation[poses], 1, 2) @ island.rotation[poses]
        rotation = nearest_rotation(turns.sum(0))
    else:
        rotation = _look_down(island.rotation[island.posed])
    if len(source) == 0:
        if network.posed.any() or network.known.any():
            return None
        scale = 1 / _neighbour(free)
        return Similarity(scale, rotation, -scale * rotation @ free.mean(0))
    source_mean, target_mean = source.mean(0), target.mean(0)
    long = (source - source_mean) @ rotation.T
    reach = np.sqrt((long**2).sum())
    if len(source) == 1 or reach == 0:
        # One pose alone gives a place and a view, and no scale: that of the network is free.
        if not len(poses) or network.known.any() or len(antenna):
            return None
        scale = 1 / _neighbour(free)
    else:
        scale = np.sqrt(((target - target_mean) ** 2).sum()) / reach
        rotation = _turn_to(long, target - target_mean, rotation, about_view=not len(poses))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def _robust(source_at: Callable[[float], np.ndarray], target: np.ndarray) -> Similarity | None:
    """Similarity to the target with less weight for what lies off, None where on one line."""
    source, weights = source_at(np.inf), np.ones(len(target))
    for _ in range(8):
        try:
            frame = similarity(source, target, weights)
        except InputError:
            return None
        source = source_at(frame.scale)
        off = np.linalg.norm(frame.apply(source) - target, axis=1)
        weights = 1 / (1 + (off / max(2 * np.median(off), 1e-12)) ** 2)
    return frame


def width(points: np.ndarray) -> float:
    """How far points spread to the side, as a share of their length; 0 on one line."""
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return float(spread[1] / spread[0]) if spread[0] > 0 else 0.0


def _look_down(rotations: np.ndarray) -> np.ndarray:
    """Rotation of a frame that turns the mean view of its cameras to (0, 0, -1)."""
    view = rotations[:, 2].mean(0)
    right = rotations[:, 0].mean(0)
    length = np.linalg.norm(view)
    if length < 1e-6:
        return np.eye(3)
    up = -view / length
    right = right - (right @ up) * up
    if np.linalg.norm(right) < 1e-6:
        right = np.linalg.svd(up[None])[2][1]
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(up, right), up])


def _turn_to(
    source: np.ndarray, target: np.ndarray, rotation: np.ndarray, about_view: bool
) -> np.ndarray:
    """The rotation, turned on so that the line of the source lies along that of the target."""
    u, _, vt = np.linalg.svd(source.T @ target)
    a, b = u[:, 0], vt[0]
    if about_view:
        turn = np.arctan2(b[1], b[0]) - np.arctan2(a[1], a[0])
        c, s = np.cos(turn), np.sin(turn)
        level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        rotation, a = level @ rotation, level @ a
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -0.999999:
        return rotation
    cross = np.cross(np.eye(3), axis)
    return (np.eye(3) + cross + cross @ cross / (1 + cosine)) @ rotation


def _neighbour(centres: np.ndarray) -> float:
    """Median distance of a camera to the next."""
    distance = KDTree(centres).query(centres, k=2)[0][:, 1]
    return float(np.median(distance)) or 1.0
