"""The point where rays meet."""

import numpy as np
from numba import njit


@njit(cache=True)
def meet(points, point_start, by_point, image, ray, rotation, centre, posed, pixel, gate,
         depth):  # fmt: skip
    """Places (n, 3) of points where their rays meet; largest angle between two rays (rad), rays
    within the gate, rays, and whether the place lies in front of all cameras.

    First the point nearest to all rays, then Gauss-Newton on the image coordinates with Cauchy
    weights. depth: one for each image, or empty; when given, rays that do not fix the distance
    are stopped there.
    """
    places = np.full((len(points), 3), np.nan)
    angles = np.zeros(len(points))
    goods = np.zeros(len(points), dtype=np.int64)
    counts = np.zeros(len(points), dtype=np.int64)
    aheads = np.zeros(len(points), dtype=np.bool_)
    m = np.empty((3, 3))
    b = np.empty(3)
    for q in range(len(points)):
        first, last = point_start[points[q]], point_start[points[q] + 1]
        count = 0
        base = np.zeros(3)
        for n in range(first, last):
            i = image[by_point[n]]
            if posed[i]:
                count += 1
                base += centre[i]
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
            o = by_point[n]
            i = image[o]
            if not posed[i]:
                continue
            u, v = ray[o, 0], ray[o, 1]
            length = np.sqrt(u * u + v * v + 1.0)
            for c in range(3):
                d = rotation[i, 0, c] * u + rotation[i, 1, c] * v + rotation[i, 2, c]
                way[k, c] = d / length
                eye[k, c] = centre[i, c] - base[c]
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
        place, good, ahead = _polish(x, eye, row, ray, image, rotation, pixel, gate,
                                     len(depth) == 0 and count > 1)  # fmt: skip
        if len(depth) and not ahead:
            place[:] = stop
        places[q] = place + base
        goods[q] = good
        aheads[q] = ahead
    return places, angles, goods, counts, aheads


@njit(cache=True)
def _polish(start, eye, row, ray, image, rotation, pixel, gate, move):
    """The point that fits its rays best, from a start: place, rays within the gate, in front.

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
            i = image[o]
            r = rotation[i]
            d0, d1, d2 = x[0] - eye[k, 0], x[1] - eye[k, 1], x[2] - eye[k, 2]
            z = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
            if z <= 0.0:
                ahead = False
                continue
            u = (r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2) / z
            v = (r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2) / z
            eu = (ray[o, 0] - u) / pixel[i]
            ev = (ray[o, 1] - v) / pixel[i]
            square = (eu * eu + ev * ev) / (gate * gate)
            cost += np.log1p(square)
            if square <= 1.0:
                good += 1
            w = 1.0 / (1.0 + square)
            for c in range(3):
                ju = (r[0, c] - u * r[2, c]) / z / pixel[i]
                jv = (r[1, c] - v * r[2, c]) / z / pixel[i]
                b[c] += w * (ju * eu + jv * ev)
                for e in range(3):
                    m[c, e] += w * (
                        ju * (r[0, e] - u * r[2, e]) + jv * (r[1, e] - v * r[2, e])
                    ) / z / pixel[i]  # fmt: skip
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


@njit(cache=True)
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
