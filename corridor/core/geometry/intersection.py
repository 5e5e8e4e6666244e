"""Points where rays meet: least squares in the image, wrong rays held down."""

import math
from typing import NamedTuple

import numpy as np

from corridor.core.engine.compiled import compiled

# Rays at a smaller angle, rad, fix no distance.
PARALLEL = 6e-4


class Rays(NamedTuple):
    """Rays u, v of images that have a pose.

    image (n,) and ray (n, 2): one row a ray. rotation (m, 3, 3), world to camera, centre (m, 3)
    and pixel (m,), the size of a pixel as a ray: one row an image. An image whose centre is NaN
    has no pose, and its rays do not count.
    """

    image: np.ndarray
    ray: np.ndarray
    rotation: np.ndarray
    centre: np.ndarray
    pixel: np.ndarray


class Intersection(NamedTuple):
    """What is known of points: place (k, 3), largest angle (k,) between two rays (rad), how many
    rays are within the gate and how many there are, and whether all cameras have it ahead."""

    place: np.ndarray
    angle: np.ndarray
    within: np.ndarray
    count: np.ndarray  # type: ignore[assignment]
    ahead: np.ndarray


def intersect(
    rays: Rays,
    starts: np.ndarray,
    rows: np.ndarray,
    points: np.ndarray | None = None,
    gate: float = np.inf,
    depth: np.ndarray | None = None,
) -> Intersection:
    """The points where rays meet; NaN where no image with a pose sees one.

    First the point nearest to all rays, then Gauss-Newton on the image coordinates as long as it
    lies ahead of all cameras, with Cauchy weights of this width where a gate is given.

    starts (k + 1,), rows (n,): rows[starts[p]:starts[p + 1]] are the rays of point p.
    points: which of them, default all. gate: pixels.
    depth: (m,), metres; rays that do not fix the distance are stopped there.
    """
    points = np.arange(len(starts) - 1) if points is None else np.asarray(points, dtype=np.int64)
    depth = np.zeros(0) if depth is None else depth
    rays = _as_compiled(rays)
    count = len(points)
    found = Intersection(
        np.full((count, 3), np.nan),
        np.zeros(count),
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.int64),
        np.zeros(count, dtype=np.bool_),
    )
    _intersect(points, starts, rows, rays, float(gate), depth, found)
    return found


def _as_compiled(rays: Rays) -> Rays:
    """Rays in the one layout for which `_intersect` is compiled: each other costs a second."""
    kinds = np.int32, float, float, float, float
    return Rays(*(np.ascontiguousarray(a, kind) for a, kind in zip(rays, kinds, strict=True)))


def meeting_points(rays: Rays, point: np.ndarray, count: int) -> np.ndarray:
    """Places (count, 3) of points (n,), one a ray; NaN with fewer than two rays that meet."""
    starts = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=count))])
    found = intersect(rays, starts, np.argsort(point, kind="stable"))
    fixed = (found.count >= 2) & (found.angle > PARALLEL)
    return np.where(fixed[:, None], found.place, np.nan)


# Number by number: a line on whole arrays is compiled in seconds, for three numbers each.


@compiled(error_model="numpy")
def _intersect(points, starts, rows, rays, gate, depth, found):
    longest = 0
    for q in range(len(points)):
        longest = max(longest, starts[points[q] + 1] - starts[points[q]])
    way, eye = np.empty((longest, 3)), np.empty((longest, 3))
    row = np.empty(longest, dtype=np.int64)
    m, b, x, base, stop = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for q in range(len(points)):
        count = np.int64(0)  # A literal 0 would have what takes it compiled twice.
        for c in range(3):
            base[c] = stop[c] = 0.0
        for n in range(starts[points[q]], starts[points[q] + 1]):
            i = rays.image[rows[n]]
            if not np.isnan(rays.centre[i, 0]):
                row[count] = rows[n]
                count += 1
                for c in range(3):
                    base[c] += rays.centre[i, c]
        found.count[q] = count
        if count == 0:
            continue
        for c in range(3):
            base[c] /= count
        _cleared(m, b)
        for k in range(count):
            o = row[k]
            i = rays.image[o]
            u, v = rays.ray[o, 0], rays.ray[o, 1]
            length = np.sqrt(u * u + v * v + 1.0)
            for c in range(3):
                r = rays.rotation
                d = r[i, 0, c] * u + r[i, 1, c] * v + r[i, 2, c]
                way[k, c] = d / length
                eye[k, c] = rays.centre[i, c] - base[c]
                if len(depth):
                    stop[c] += (eye[k, c] + depth[i] * d) / count
            along = way[k, 0] * eye[k, 0] + way[k, 1] * eye[k, 1] + way[k, 2] * eye[k, 2]
            for c in range(3):
                for e in range(3):
                    m[c, e] -= way[k, c] * way[k, e]
                m[c, c] += 1.0
                b[c] += eye[k, c] - along * way[k, c]
        smallest = 1.0
        for k in range(1, count):
            for h in range(k if count <= 12 else 1):
                cosine = way[k, 0] * way[h, 0] + way[k, 1] * way[h, 1] + way[k, 2] * way[h, 2]
                smallest = min(smallest, cosine)
        found.angle[q] = math.acos(max(-1.0, smallest))
        if len(depth):
            # A pull to the stop, a thousandth of a ray that would see it from the side.
            for c in range(3):
                m[c, c] += 1e-3 * count
                b[c] += 1e-3 * count * stop[c]
        x[0], x[1], x[2], solved = _solve3(m, b)
        if not solved:
            x[0], x[1], x[2] = stop[0], stop[1], stop[2]
        move = len(depth) == 0 and count > 1
        good, ahead = _least_squares(x, count, eye, row, rays, gate, move)
        kept = stop if len(depth) and not ahead else x
        for c in range(3):
            found.place[q, c] = kept[c] + base[c]
        found.within[q] = good
        found.ahead[q] = ahead


@compiled(error_model="numpy")
def _least_squares(x, count, eye, row, rays, gate, move):
    """Moves a point x to where it fits its first `count` rays best: rays within the gate, ahead.

    eye: centres of the cameras, from the same origin as x. move: False leaves the point where it
    is.
    """
    m, b, best = np.empty((3, 3)), np.empty(3), np.empty(3)
    for c in range(3):
        best[c] = x[c]
    best_cost = np.inf
    best_good = 0
    best_ahead = False
    for step in range(8 if move else 1):
        _cleared(m, b)
        cost = 0.0
        good = 0
        ahead = True
        for k in range(count):
            o = row[k]
            i = rays.image[o]
            r = rays.rotation
            pixel = rays.pixel[i]
            d0, d1, d2 = x[0] - eye[k, 0], x[1] - eye[k, 1], x[2] - eye[k, 2]
            z = r[i, 2, 0] * d0 + r[i, 2, 1] * d1 + r[i, 2, 2] * d2
            if z <= 0.0:
                ahead = False
                continue
            u = (r[i, 0, 0] * d0 + r[i, 0, 1] * d1 + r[i, 0, 2] * d2) / z
            v = (r[i, 1, 0] * d0 + r[i, 1, 1] * d1 + r[i, 1, 2] * d2) / z
            eu = (rays.ray[o, 0] - u) / pixel
            ev = (rays.ray[o, 1] - v) / pixel
            square = eu * eu + ev * ev
            w = 1.0
            if gate == np.inf:
                cost += square
                good += 1
            else:
                square /= gate * gate
                cost += math.log1p(square)
                good += square <= 1.0
                w = 1.0 / (1.0 + square)
            for c in range(3):
                ju = (r[i, 0, c] - u * r[i, 2, c]) / z / pixel
                jv = (r[i, 1, c] - v * r[i, 2, c]) / z / pixel
                b[c] += w * (ju * eu + jv * ev)
                for e in range(3):
                    by_u, by_v = r[i, 0, e] - u * r[i, 2, e], r[i, 1, e] - v * r[i, 2, e]
                    m[c, e] += w * (ju * by_u + jv * by_v) / z / pixel
        if step and not (ahead and cost < best_cost):
            break
        gain = best_cost - cost
        for c in range(3):
            best[c] = x[c]
        best_cost, best_good, best_ahead = cost, good, ahead
        if not ahead or gain < 1e-9 * (1.0 + cost):
            break
        for c in range(3):
            m[c, c] *= 1.0 + 1e-9
        dx, dy, dz, solved = _solve3(m, b)
        if not solved:
            break
        x[0], x[1], x[2] = x[0] + dx, x[1] + dy, x[2] + dz
    for c in range(3):
        x[c] = best[c]
    return best_good, best_ahead


@compiled(error_model="numpy")
def _cleared(m, b):
    for c in range(3):
        b[c] = 0.0
        for e in range(3):
            m[c, e] = 0.0


@compiled(error_model="numpy")
def _solve3(m, b):
    """Solution of a symmetric 3 x 3 system and whether there is one."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    if abs(det) < 1e-300:
        return 0.0, 0.0, 0.0, False
    x = (b[0] * c00 + b[1] * c01 + b[2] * c02) / det
    y = (
        b[0] * (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2])
        + b[1] * (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0])
        + b[2] * (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1])
    ) / det
    z = (
        b[0] * (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1])
        + b[1] * (m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2])
        + b[2] * (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    ) / det
    return x, y, z, True
