"""Two images relative to each other, where nothing else is known."""

import numpy as np
from scipy import sparse

from corridor.core.adjustment.initial.intersection import CHAIN_ANGLE, intersect_new
from corridor.core.adjustment.initial.network import GATES_PX, LEAST_INLIER_SHARE, Network
from corridor.core.geometry import Rays, intersect

_FEWEST_SHARED = 8


def start_from_pair(network: Network) -> bool:
    """Orient the best pair of images relative to each other; False where there is none.

    The first camera is the frame, the base is 1.
    """
    best = None
    pairs = _pairs(network)
    for gate in GATES_PX:
        for first, second in pairs:
            found = _oriented(network, first, second, gate)
            if found is not None and (best is None or found[0] > best[0]):
                best = (*found, first, second)
        if best is not None and best[1] >= LEAST_INLIER_SHARE:
            break
    if best is None:
        return False
    _, _, rotation, centre, first, second = best
    network.rotation[first], network.centre[first] = np.eye(3), 0.0
    network.rotation[second], network.centre[second] = rotation, centre
    network.posed[[first, second]] = True
    network.gate = gate
    intersect_new(network)
    return bool(network.known.any())


def _pairs(network: Network, most: int = 60) -> list[tuple[int, int]]:
    """Pairs that share many points, neighbours and wider ones."""
    seen = sparse.csr_matrix(
        (np.ones(len(network.image)), (network.image, network.point)),
        shape=(len(network.images), len(network.points)),
    )
    shared = sparse.triu(seen @ seen.T, k=1).tocoo()
    many = shared.data >= _FEWEST_SHARED
    row, column, count = shared.row[many], shared.col[many], shared.data[many]
    order = np.lexsort((column, row, -count))
    wide = order[count[order] >= 0.3 * count.max()] if len(order) else order
    chosen = np.union1d(order[: most // 2], wide[:: max(1, 2 * len(wide) // most)])
    return [(int(row[k]), int(column[k])) for k in chosen]


def _oriented(network: Network, first: int, second: int, gate: float):
    """Score, agreeing share, rotation and centre of the second image, or None."""
    rows = [network.rows(first), network.rows(second)]
    _, a, b = np.intersect1d(
        network.point[rows[0]], network.point[rows[1]], assume_unique=True, return_indices=True
    )
    a, b = network.ray[rows[0]][a], network.ray[rows[1]][b]
    pixel = network.pixel[[first, second]]
    count = len(a)
    best = None
    for rotation, centre in _relative(a, b, gate * pixel.max()):
        rays = Rays(
            np.tile(np.array([0, 1], dtype=np.int32), count),
            np.stack([a, b], 1).reshape(-1, 2),
            np.stack([np.eye(3), rotation]),
            np.stack([np.zeros(3), centre]),
            pixel,
        )
        _, angle, good, _, ahead = intersect(
            rays, np.arange(0, 2 * count + 1, 2), np.arange(2 * count), gate=gate
        )
        fine = ahead & (good == 2)
        if fine.sum() < _FEWEST_SHARED:
            continue
        spread = min(np.median(angle[fine]), np.radians(20.0))
        if spread < CHAIN_ANGLE:
            continue
        score = fine.sum() * spread
        if best is None or score > best[0]:
            best = (score, fine.mean(), rotation, centre)
    return best


def _relative(a: np.ndarray, b: np.ndarray, gate: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotations and centres (base 1) of a second camera that sees rays b where the first sees a.

    Both the essential matrix and the homography are asked: on flat ground the first has a second
    solution, in relief the other has none.
    """
    import cv2  # only blocks without start values need it

    cv2.setRNGSeed(0)
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    found = []
    try:
        essential, mask = cv2.findEssentialMat(
            a, b, np.eye(3), method=cv2.RANSAC, prob=0.9999, threshold=gate
        )
        if essential is not None and essential.shape == (3, 3):
            _, rotation, shift, _ = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask)
            found.append((rotation, -rotation.T @ shift.ravel()))
        plane, _ = cv2.findHomography(a, b, cv2.RANSAC, 3 * gate)
        if plane is not None:
            _, rotations, shifts, _ = cv2.decomposeHomographyMat(plane, np.eye(3))
            for rotation, shift in zip(rotations, shifts, strict=True):
                length = np.linalg.norm(shift)
                if length > 1e-6:
                    found.append((rotation, -rotation.T @ shift.ravel() / length))
    except cv2.error:
        pass
    return found
