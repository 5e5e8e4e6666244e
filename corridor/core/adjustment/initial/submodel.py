"""Images that the chain does not reach: oriented by themselves, then brought over."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from corridor.core.adjustment.initial.chain import (
    FEWEST_MARKS,
    adjust_interim,
    refine,
    resect_in_turn,
    sweep,
)
from corridor.core.adjustment.initial.intersection import intersect_new
from corridor.core.adjustment.initial.network import GATES_PX, LEAST_INLIER_SHARE, Network
from corridor.core.adjustment.initial.relative_orientation import start_from_pair
from corridor.core.errors import InputError
from corridor.core.geometry import Similarity, nearest_rotation, relative_width, similarity

# A frame of its own goes over to the antenna positions when it has so many images and they
# spread to a side by this share of their length, or when it has grown too long.
_FEWEST, _WIDTH, _LONG = 6, 0.1, 40


def orient_submodel(network: Network, say: Callable[[str], None]) -> None:
    """Orient images that the chain does not reach, in a frame of their own, and bring them over.

    Raises InputError where they hold together with nothing, or their frame cannot be found.
    """
    lost = ~network.posed
    shared = np.zeros(len(network.points), dtype=bool)
    shared[network.point[lost[network.image]]] = True
    # Oriented neighbours join, as what is known of them holds the submodel.
    members = lost.copy()
    members[network.image[shared[network.point]]] = True
    submodel = network.submodel(members)
    positions = np.isfinite(network.antenna).all(1)
    if not start_from_pair(submodel):
        raise _cannot(network, lost, "they share too few tie points with each other")

    def enough() -> bool:
        there = submodel.posed & positions
        count = there.sum()
        return count >= _LONG or (
            count >= _FEWEST and relative_width(network.antenna[there]) > _WIDTH
        )

    resect_in_turn(submodel, say, enough)
    adjust_interim(submodel)

    gained = submodel.posed & lost
    if not gained.any():
        raise _cannot(network, lost, "they share too few tie points with the others")
    frame = frame_between(submodel, network)
    if frame is None:
        raise _cannot(
            network,
            gained,
            "they see too few ground points with coordinates and have no GNSS position",
        )
    network.centre[gained] = frame.apply(submodel.centre[gained])
    network.rotation[gained] = frame.apply_to_rotations(submodel.rotation[gained])
    network.posed |= gained
    network.gate = max(network.gate, submodel.gate)
    fresh = submodel.known & ~network.known
    network.place[fresh] = frame.apply(submodel.place[fresh])
    network.known |= fresh
    network.look_through(submodel.interior)
    _take_gnss(network, np.flatnonzero(gained & positions))
    adjust_interim(network)


def _take_gnss(network: Network, images: np.ndarray) -> None:
    """Put the centres of images where GNSS has them, and fit all else to that.

    A frame of its own is bent where the camera is not known well; GNSS straightens it. Images
    that then do not see their points any more keep their own centre: their fix is wrong.
    """
    if not len(images):
        return
    rotation, centre, gate = network.rotation.copy(), network.centre.copy(), network.gate
    network.held[images] = network.trusted[images] = True
    for wide in (GATES_PX[-1], GATES_PX[-1], gate):
        network.gate = wide
        sweep(network, images)
    sees = [network.agreement(image, GATES_PX[-1]) >= LEAST_INLIER_SHARE for image in images]
    wrong = images[~np.array(sees)]
    if len(wrong):
        network.held[wrong] = network.trusted[wrong] = False
        network.rotation[wrong], network.centre[wrong] = rotation[wrong], centre[wrong]
        refine(network, wrong)
        intersect_new(network, again=True)


def _cannot(network: Network, lost: np.ndarray, why: str) -> InputError:
    names = network.images[lost]
    some = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    plural = len(names) > 1
    return InputError(
        f"images.csv: image{'s' if plural else ''} {some} cannot be oriented: {why}; give "
        f"{'their poses' if plural else 'its pose'}, measure at least {FEWEST_MARKS} ground "
        f"points in {'one of them' if plural else 'it'}, or delete {'them' if plural else 'it'}"
    )


# --- how a frame of its own lies in the world -------------------------------------------------


def frame_between(submodel: Network, network: Network) -> Similarity | None:
    """Similarity from the submodel to the network, None where nothing fixes it."""
    points = np.flatnonzero(submodel.known & network.known)
    poses = np.flatnonzero(submodel.posed & network.posed)
    antenna = np.flatnonzero(submodel.posed & ~network.posed & np.isfinite(network.antenna).all(1))
    arm = np.einsum("nij,ni->nj", submodel.rotation[antenna], network.arm[antenna])

    def source_at(scale: float) -> np.ndarray:
        """What both know, in the submodel: arms shrink where its unit is `scale` metres."""
        tips = submodel.centre[antenna] + arm / scale
        return np.concatenate([submodel.place[points], submodel.centre[poses], tips])

    target = np.concatenate(
        [network.place[points], network.centre[poses], network.antenna[antenna]]
    )
    source = source_at(np.inf)
    if len(source) >= 3 and relative_width(target) > 0.01:
        frame = _robust(source_at, target)
        if frame is not None:
            return frame
    # On one line, or less: the view tells how the submodel is turned about it.
    free = submodel.centre[submodel.posed]
    if len(poses):
        turns = np.swapaxes(network.rotation[poses], 1, 2) @ submodel.rotation[poses]
        rotation = nearest_rotation(turns.sum(0))
    else:
        rotation = _look_down(submodel.rotation[submodel.posed])
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
