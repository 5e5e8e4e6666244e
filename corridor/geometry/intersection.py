"""Points where rays meet: least squares in the image, wrong rays held down."""

from typing import NamedTuple

import numpy as np

from corridor.compiled import compiled

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
    count: np.ndarray
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
    return Intersection(*_intersect(points, starts, rows, rays, float(gate), depth))


def meeting_points(rays: Rays, point: np.ndarray, count: int) -> np.ndarray:
    """Places (count, 3) of points (n,), one a ray; NaN with fewer than two rays that meet."""
    starts = np.concatenate([[0], np.cumsum(np.bincount(point, minlength=count))])
    found = intersect(rays, starts, np.argsort(point, kind="stable"))
    fixed = (found.count >= 2) & (found.angle > PARALLEL)
    return np.where(fixed[:, None], found.place, np.nan)


@compiled()
def _intersect(points, starts, rows, rays, gate, depth):
    places = np.full((len(points), 3), np.nan)
    angles = np.zeros(len(points))
    goods = np.zeros(len(points), dtype=np.int64)
    counts = np.zeros(len(points), dtype=np.int64)
    aheads = np.zeros(len(points), dtype=np.bool_)
    m = np.empty((3, 3))
    b = np.empty(3)
    for q in range(len(points)):
        first, last = starts[points[q]], starts[points[q] + 1]
        count = 0
        base = np.zeros(3)
        for n in range(first, last):
            i = rays.image[rows[n]]
            if not np.isnan(rays.centre[i, 0]):
                count += 1
                base += rays.centre[i]
        counts[q] = count
        if count == 0:
            continue
        base /= count
        way = np.empty((count, 3))
        eye = np.empty((count, 3))
        row = np.empty(count, dtype=np.int64)
        stop = np.zeros(3)
        m[:] = 0.0
        b[:] = 0.0
        k = 0
        for n in range(first, last):
            o = rows[n]
            i = rays.image[o]
            if np.isnan(rays.centre[i, 0]):
                continue
            u, v = rays.ray[o, 0], rays.ray[o, 1]
            r = rays.rotation[i]
            length = np.sqrt(u * u + v * v + 1.0)
            for c in range(3):
                d = r[0, c] * u + r[1, c] * v + r[2, c]
                way[k, c] = d / length
                eye[k, c] = rays.centre[i, c] - base[c]
                if len(depth):
                    stop[c] += (eye[k, c] + depth[i] * d) / count
            row[k] = o
            along = way[k, 0] * eye[k, 0] + way[k, 1] * eye[k, 1] + way[k, 2] * eye[k, 2]
            for c in range(3):
                for e in range(3):
                    m[c, e] -= way[k, c] * way[k, e]
                m[c, c] += 1.0
                b[c] += eye[k, c] - along * way[k, c]
            k += 1
        smallest = 1.0
        for k in range(1, count):
            for h in range(k if count <= 12 else 1):
                cosine = way[k, 0] * way[h, 0] + way[k, 1] * way[h, 1] + way[k, 2] * way[h, 2]
                smallest = min(smallest, cosine)
        angles[q] = np.arccos(max(-1.0, smallest))
        if len(depth):
            # A pull to the stop, a thousandth of a ray that would see it from the side.
            for c in range(3):
                m[c, c] += 1e-3 * count
                b[c] += 1e-3 * count * stop[c]
        x, solved = _solve3(m, b)
        if not solved:
            x[:] = stop
        move = len(depth) == 0 and count > 1
        place, good, ahead = _least_squares(x, eye, row, rays, gate, move)
        if len(depth) and not ahead:
            place[:] = stop
        places[q] = place + base
        goods[q] = good
        aheads[q] = ahead
    return places, angles, goods, counts, aheads


@compiled()
def _least_squares(start, eye, row, rays, gate, move):
    """The point that fits its rays best, from a start: place, rays within the gate, ahead.

    eye: centres of the cameras, start and place: all from the same origin. move: False leaves the
    point where it starts.
    """
    x = start.copy()
    m = np.empty((3, 3))
    b = np.empty(3)
    best = x.copy()
    best_cost = np.inf
    best_good = 0
    best_ahead = False
    for step in range(8 if move else 1):
        m[:] = 0.0
        b[:] = 0.0
        cost = 0.0
        good = 0
        ahead = True
        for k in range(len(row)):
            o = row[k]
            i = rays.image[o]
            r = rays.rotation[i]
            pixel = rays.pixel[i]
            d0, d1, d2 = x[0] - eye[k, 0], x[1] - eye[k, 1], x[2] - eye[k, 2]
            z = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
            if z <= 0.0:
                ahead = False
                continue
            u = (r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2) / z
            v = (r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2) / z
            eu = (rays.ray[o, 0] - u) / pixel
            ev = (rays.ray[o, 1] - v) / pixel
            square = eu * eu + ev * ev
            w = 1.0
            if gate == np.inf:
                cost += square
                good += 1
            else:
                square /= gate * gate
                cost += np.log1p(square)
                good += square <= 1.0
                w = 1.0 / (1.0 + square)
            for c in range(3):
                ju = (r[0, c] - u * r[2, c]) / z / pixel
                jv = (r[1, c] - v * r[2, c]) / z / pixel
                b[c] += w * (ju * eu + jv * ev)
                for e in range(3):
                    by_u, by_v = r[0, e] - u * r[2, e], r[1, e] - v * r[2, e]
                    m[c, e] += w * (ju * by_u + jv * by_v) / z / pixel
        if step and not (ahead and cost < best_cost):
            break
        gain = best_cost - cost
        best[:] = x
        best_cost, best_good, best_ahead = cost, good, ahead
        if not ahead or gain < 1e-9 * (1.0 + cost):
            break
        for c in range(3):
            m[c, c] *= 1.0 + 1e-9
        dx, solved = _solve3(m, b)
        if not solved:
            break
        x += dx
    return best, best_good, best_ahead


@compiled()
def _solve3(m, b):
    """Solution of a symmetric 3 x 3 system and whether there is one."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    x = np.zeros(3)
    if abs(det) < 1e-300:
        return x, False
    x[0] = (b[0] * c00 + b[1] * c01 + b[2] * c02) / det
    x[1] = (
        b[0] * (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2])
        + b[1] * (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0])
        + b[2] * (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1])
    ) / det
    x[2] = (
        b[0] * (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1])
        + b[1] * (m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2])
        + b[2] * (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    ) / det
    return x, True
