"""Images in an order that keeps the normal equations a narrow band."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from corridor.compiled import compiled
from corridor.effects import Images


def corridor_order(
    point: np.ndarray, image: np.ndarray, position: np.ndarray, images: Images
) -> np.ndarray:
    """Order (m,) of the images: by footprint along the block, or reverse Cuthill-McKee.

    point, image: (n,) of each observation; position: (points, 3). The one with the narrower band
    is taken; a block that bends or goes round is better off with the graph.
    """
    count = len(images.names)
    known = np.isfinite(position).all(axis=1)[point]
    where, by = (point, image) if known.all() else (point[known], image[known])
    by = by.astype(np.int64)
    seen = np.maximum(np.bincount(by, minlength=count), 1)
    footprint = np.stack(
        [np.bincount(by, position[where, k], minlength=count) / seen for k in range(3)], 1
    )
    del where, by, known
    centred = footprint - footprint.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    along = centred @ axes[:, -1]
    # The axis has no sense of its own: start where the first image lies.
    first = np.argsort(along if along[0] <= 0 else -along, kind="stable")
    if count < 8:
        return first
    width = _width(point, image, first)
    if width * 8 <= count:
        return first
    linked = _links(point, image, count)
    second = np.asarray(reverse_cuthill_mckee(linked, symmetric_mode=True), dtype=np.int64)
    return second if _width(point, image, second) < width else first


def _links(point: np.ndarray, image: np.ndarray, count: int):
    """Images that share a point: (m, m) sparse pattern."""
    ones = np.ones(len(point), dtype=np.float32)
    seen = coo_array((ones, (image, point))).tocsr()
    return (seen @ seen.T).tocsr()


def _width(point: np.ndarray, image: np.ndarray, order: np.ndarray) -> int:
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order))
    at = rank[image]
    first = np.full(point.max() + 1, len(order), dtype=np.int32)
    last = np.full(point.max() + 1, -1, dtype=np.int32)
    np.minimum.at(first, point, at)
    np.maximum.at(last, point, at)
    return int((last - first).max()) + 1


@compiled()
def bandwidth(ptr, img):
    """Half bandwidth in images: 1 + the largest distance between images that share a point."""
    widest = 0
    for p in range(ptr.shape[0] - 1):
        if ptr[p + 1] > ptr[p]:
            widest = max(widest, img[ptr[p + 1] - 1] - img[ptr[p]])
    return widest + 1
