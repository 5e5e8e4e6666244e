"""Images in an order that keeps the normal equations a narrow band."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from corridor.core.engine.compiled import compiled


def corridor_order(
    point: np.ndarray,
    image: np.ndarray,
    position: np.ndarray,
    count: int,
) -> np.ndarray:
    """Order (count,) of the images: by footprint along the block, or reverse Cuthill-McKee.

    point, image: (n,) of each observation; position: (points, 3). Exposures of a rig in the place
    of images are ordered alike. The order with the narrower band is taken; a block that bends or
    goes round is better off with the graph.
    """
    footprint, seen = _sums(point, image, position, np.isfinite(position).all(axis=1), count)
    footprint /= np.maximum(seen, 1)[:, None]
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
    return _widest(point, image, rank, int(point.max()) + 1) + 1


@compiled()
def appearances(codes, count):
    """How often (count,) each code appears: as `np.bincount`, which copies the codes first."""
    often = np.zeros(count, dtype=np.int64)
    for code in codes:
        often[code] += 1
    return often


@compiled()
def _sums(point, image, position, known, count):
    """Sum (count, 3) of the known positions that each image shows, and how many these are."""
    total, seen = np.zeros((count, 3)), np.zeros(count, dtype=np.int64)
    for o in range(len(point)):
        p, i = point[o], image[o]
        if known[p]:
            seen[i] += 1
            for k in range(3):
                total[i, k] += position[p, k]
    return total, seen


@compiled()
def _widest(point, image, rank, count):
    """The largest distance between images that share a point."""
    first, last = np.full(count, len(rank), dtype=np.int32), np.full(count, -1, dtype=np.int32)
    for o in range(len(point)):
        p, at = point[o], rank[image[o]]
        first[p], last[p] = min(first[p], at), max(last[p], at)
    widest = -1
    for p in range(count):
        widest = max(widest, last[p] - first[p])
    return widest


@compiled()
def first_and_same(point, image, rank, count):
    """Of each point the first place of its images, and the sum of their squares, which is the same
    for points that the same images see."""
    first, same = np.full(count, len(rank), dtype=np.int32), np.zeros(count)
    for o in range(len(point)):
        p, at = point[o], rank[image[o]]
        first[p] = min(first[p], at)
        same[p] += float(at) * float(at)
    return first, same


@compiled()
def sorted_rows(point, image, rank, start):
    """Places of the images, by point and place, and the rows they come from.

    start (points,): where the rows of each point begin.
    """
    where = start.copy()
    img = np.empty(len(point), dtype=np.int32)
    row = np.empty(len(point), dtype=np.int32)
    for o in range(len(point)):
        p, at = point[o], rank[image[o]]
        n = where[p]
        # A point has few rows: each goes before those that it precedes.
        while n > start[p] and img[n - 1] > at:
            img[n], row[n] = img[n - 1], row[n - 1]
            n -= 1
        img[n], row[n] = at, o
        where[p] += 1
    return img, row


@compiled()
def pixels_of_rows(row, x, y, mark_x, mark_y):
    """Pixels (n, 2) of rows of tie points, with those of marks counted on behind them."""
    out = np.empty((len(row), 2))
    for n in range(len(row)):
        r = row[n]
        if r < len(x):
            out[n, 0], out[n, 1] = x[r], y[r]
        else:
            out[n, 0], out[n, 1] = mark_x[r - len(x)], mark_y[r - len(x)]
    return out


@compiled()
def bandwidth(ptr, img):
    """Half bandwidth in images: 1 + the largest distance between images that share a point."""
    widest = 0
    for p in range(ptr.shape[0] - 1):
        if ptr[p + 1] > ptr[p]:
            widest = max(widest, img[ptr[p + 1] - 1] - img[ptr[p]])
    return widest + 1
