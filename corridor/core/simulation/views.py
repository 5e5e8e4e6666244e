"""Which image sees which point, and where."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from corridor.core.camera import distort, radials_in_use
from corridor.core.engine.compiled import compiled
from corridor.core.simulation.fly import Flown, border_rays

# Points looked at between two reports of progress.
_CHUNK = 200_000


@dataclass
class Views:
    """Rays of points: image[start[p]:start[p + 1]] are the images that see point p, ascending."""

    start: np.ndarray
    image: np.ndarray

    @property
    def multiplicity(self) -> np.ndarray:
        """How many images see each point (p,)."""
        return np.diff(self.start)

    @property
    def point(self) -> np.ndarray:
        """The point of each ray."""
        return np.repeat(np.arange(len(self.start) - 1, dtype=np.int32), self.multiplicity)

    def of(self, points: np.ndarray) -> "Views":
        """The rays of some of the points, in the order given."""
        count = self.multiplicity[points]
        start = np.concatenate([[0], np.cumsum(count)])
        step = np.arange(start[-1]) - np.repeat(start[:-1], count)
        return Views(start, self.image[np.repeat(self.start[points], count) + step])


class _Grid(NamedTuple):
    """Which footprints may cover a place; cells of one size, column by column.

    box (n, 4): bounds of each footprint, x and y, least and greatest. image[start[c]:start[c + 1]]
    are the images whose box touches cell c, ascending.
    """

    box: np.ndarray
    origin: np.ndarray
    size: float
    cells: np.ndarray
    start: np.ndarray
    image: np.ndarray


class _Pictures(NamedTuple):
    """Poses of the images, and their cameras; limit (k, 2), border: where a picture sees, px."""

    centre: np.ndarray
    rotation: np.ndarray
    camera: np.ndarray
    interior: np.ndarray
    radials: int
    limit: np.ndarray
    border: float


class Network:
    """The images of a flight, ready to be asked what they see.

    low, high: bounds of the ground, metres. border_px: pictures see nothing nearer their edge.
    """

    def __init__(self, flown: Flown, low: float, high: float, border_px: float):
        self.images = len(flown.centre)
        self.footprints = _footprints(flown, low, high)
        box = np.concatenate([self.footprints.min(axis=1), self.footprints.max(axis=1)], axis=1)
        # The border is sampled: between two of its rays a picture may reach a little further.
        slack = 0.5 + 0.02 * (box[:, 2:] - box[:, :2])
        box[:, :2] -= slack
        box[:, 2:] += slack
        origin = box[:, :2].min(axis=0)
        span = box[:, 2:].max(axis=0) - origin
        size = max(float(np.median(box[:, 2:] - box[:, :2])) / 2, float(span.max()) / 3000)
        cells = np.floor(span / size).astype(np.int64) + 1
        self._grid = _Grid(box, origin, size, cells, *_fill(box, origin, size, cells))
        interior = np.array([c.interior for c in flown.cameras])
        limit = [(c.width - 1 - border_px, c.height - 1 - border_px) for c in flown.cameras]
        self._pictures = _Pictures(
            flown.centre, flown.rotation, flown.camera, interior, radials_in_use(interior),
            np.array(limit, dtype=float), float(border_px),
        )  # fmt: skip

    def look(self, points: np.ndarray, progress: Callable[[float], None] | None = None) -> Views:
        """Who sees points (n, 3). progress: called with the share that is done."""
        count = len(points)
        parts = []
        for first in range(0, max(count, 1), _CHUNK):
            some = points[first : first + _CHUNK]
            parts.append(_visit(some, self._grid, self._pictures))
            if progress:
                progress(min(1.0, (first + _CHUNK) / max(count, 1)))
        seen = np.concatenate([part[0] for part in parts])
        return Views(
            np.concatenate([[0], np.cumsum(seen)]), np.concatenate([part[1] for part in parts])
        )

    def pixels(self, points: np.ndarray, views: Views) -> np.ndarray:
        """Image coordinates (rays, 2) px of points (n, 3) without any error."""
        return _project(points, views.point, views.image, self._pictures)


def matched(
    views: Views,
    away: np.ndarray,
    angle_deg: float | None,
    scale: float | None,
    draw: np.random.Generator,
) -> Views:
    """The rays that a matcher would find: those like that of one image of the point, by lot.

    away (rays, 3): from the point to the images, metres. angle_deg, scale: largest angle between
    the two rays, and largest ratio of their lengths; None: any.
    """
    count = views.multiplicity
    lot = np.minimum((draw.random(len(count)) * count).astype(np.int64), np.maximum(count - 1, 0))
    reference = away[(views.start[:-1] + lot)[views.point]] if len(away) else away
    length, other = np.linalg.norm(away, axis=1), np.linalg.norm(reference, axis=1)
    kept = np.ones(len(away), dtype=bool)
    if angle_deg is not None:
        cosine = np.einsum("ni,ni->n", away, reference) / (length * other)
        # Rounding alone must not part a ray from itself.
        kept &= cosine >= np.cos(np.radians(min(angle_deg, 180.0))) - 1e-12
    if scale is not None:
        kept &= np.maximum(length / other, other / length) <= scale * (1 + 1e-12)
    start = np.concatenate([[0], np.cumsum(kept)])[views.start]
    return Views(start, views.image[kept])


def thin(views: Views, images: int, target: float, draw: np.random.Generator) -> np.ndarray:
    """Points to keep, such that an image has `target` of them on average; in ascending order.

    Points seen once are dropped. A point is kept as a whole as long as the images that see it
    still want more, taken together.
    """
    turn = draw.permutation(len(views.start) - 1)
    keep = _thin(views.start, views.image, turn, images, float(target))
    # The last point of an image overshoots; a second pass meets the number on average.
    mean = views.multiplicity[keep].sum() / images
    if mean > target:
        keep = _thin(views.start, views.image, turn, images, target * target / mean)
    return np.flatnonzero(keep)


def _footprints(flown: Flown, low: float, high: float) -> np.ndarray:
    """Where the border of each picture meets the lowest and the highest ground (m, n, 2)."""
    out: np.ndarray | None = None
    for k, camera in enumerate(flown.cameras):
        rays = border_rays(camera)
        rays = np.column_stack([rays, np.ones(len(rays))])
        mine = flown.camera == k
        world = np.einsum("nij,ri->nrj", flown.rotation[mine], rays)
        # With jitter a flat ray may miss the ground: it then ends far away.
        fall = np.minimum(world[:, :, 2:], -0.05)
        centre = flown.centre[mine][:, None]
        down = (level - centre[:, :, 2:] for level in (low, high))
        hits = np.concatenate(
            [centre[:, :, :2] + world[:, :, :2] * way / fall for way in down], axis=1
        )
        if out is None:
            out = np.empty((len(flown.centre), hits.shape[1], 2))
        out[mine] = hits
    assert out is not None  # a flight has a camera
    return out


def _fill(box, origin, size, cells):
    """Images whose footprint touches each cell of a grid, ascending."""
    first, last = (((part - origin) / size).astype(np.int64) for part in (box[:, :2], box[:, 2:]))
    wide = np.minimum(last, cells - 1) - first + 1
    count = wide.prod(axis=1)
    image = np.repeat(np.arange(len(box), dtype=np.int32), count)
    step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    x, y = first[image].T + np.divmod(step, wide[image, 1])
    cell = x * cells[1] + y
    start = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=cells.prod()))])
    return start, image[np.argsort(cell, kind="stable")]


@compiled(error_model="numpy")
def _seen(point, i, pictures):
    """Where image i sees a point, px; then the four derivatives by u and v, and the depth."""
    r, c = pictures.rotation[i], pictures.camera[i]
    d0 = point[0] - pictures.centre[i, 0]
    d1 = point[1] - pictures.centre[i, 1]
    d2 = point[2] - pictures.centre[i, 2]
    depth = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
    u = (r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2) / depth
    v = (r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2) / depth
    bent = distort(u, v, pictures.interior, np.uint64(c), pictures.radials)
    return *bent, depth


@compiled()
def _inside(point, i, pictures):
    x, y, xu, xv, yu, yv, depth = _seen(point, i, pictures)
    # Beyond a fold of the distortion, or two, a far point would seem to lie inside.
    if depth <= 0.0 or xu * yv - xv * yu <= 0.0 or xu + yv <= 0.0:
        return False
    border, limit = pictures.border, pictures.limit[pictures.camera[i]]
    return border <= x <= limit[0] and border <= y <= limit[1]


@compiled()
def _visit(points, grid, pictures):
    """How many images see each point, and which, point after point."""
    box, origin, cells = grid.box, grid.origin, grid.cells
    seen = np.zeros(points.shape[0], dtype=np.int64)
    image = np.empty(16 * points.shape[0] + 16, dtype=np.int32)
    n = 0
    for p in range(points.shape[0]):
        x, y = points[p, 0], points[p, 1]
        cx, cy = int((x - origin[0]) / grid.size), int((y - origin[1]) / grid.size)
        if x < origin[0] or y < origin[1] or cx >= cells[0] or cy >= cells[1]:
            continue
        cell = cx * cells[1] + cy
        for k in range(grid.start[cell], grid.start[cell + 1]):
            i = grid.image[k]
            if x < box[i, 0] or y < box[i, 1] or x > box[i, 2] or y > box[i, 3]:
                continue
            if _inside(points[p], i, pictures):
                if n == len(image):
                    image = np.concatenate((image, np.empty_like(image)))
                image[n] = i
                n += 1
                seen[p] += 1
    return seen, image[:n].copy()


@compiled()
def _thin(start, image, turn, images, target):
    count = np.zeros(images, dtype=np.int64)
    keep = np.zeros(len(turn), dtype=np.bool_)
    for p in turn:
        mine = image[start[p] : start[p + 1]]
        if len(mine) > 1 and np.sum(target - count[mine]) > 0:
            keep[p] = True
            count[mine] += 1
    return keep


@compiled()
def _project(points, point, image, pictures):
    out = np.empty((len(point), 2))
    for n in range(len(point)):
        out[n, 0], out[n, 1], _, _, _, _, _ = _seen(points[point[n]], image[n], pictures)
    return out
