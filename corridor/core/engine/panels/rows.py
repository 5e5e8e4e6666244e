"""Jacobian rows that are kept, and sets of residuals that pass through the points.

Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from typing import NamedTuple

import numpy as np

from corridor.core.engine.compiled import KERNEL, compiled
from corridor.core.engine.panels.kernels import invert_cholesky
from corridor.core.engine.panels.lanes import panel, plus, put, zeros
from corridor.core.engine.panels.rays import U, fill_rows, inner_row_length, three
from corridor.core.engine.scene import PANEL


class Out(NamedTuple):
    """Where rows go, all flat but the last: by the image, by the point, by what is shared; inverse
    of the Cholesky factor of V (points, 6)."""

    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    root: np.ndarray


@compiled(**KERNEL)
def pass_points(rays, left, to):
    """Residuals left, in place, less what the points follow: P V^-1 (P' left + heavy)."""
    d, q, sets = rays.own.shape[1], rays.shared.shape[1], to.sets
    for p in range(len(rays.root)):
        row, first, last = rays.row[p], 2 * rays.start[p], 2 * rays.start[p + 1]
        i0, i1, i2 = rays.root[p, 0], rays.root[p, 1], rays.root[p, 2]
        i3, i4, i5 = rays.root[p, 3], rays.root[p, 4], rays.root[p, 5]
        for at in range(0, sets, PANEL):
            x = y = z = zeros()
            if row >= 0:
                x = panel(to.heavy, U(3 * row * sets + at))
                y = panel(to.heavy, U((3 * row + 1) * sets + at))
                z = panel(to.heavy, U((3 * row + 2) * sets + at))
            for n in range(first, last):
                e = panel(left, U(n * sets + at))
                if to.taken:
                    image = rays.image[n // 2]
                    for c in range(d):
                        step = panel(to.unknowns, U((image * d + c) * sets + at))
                        e = plus(e, -rays.own[n, c], step)
                    for c in range(q):
                        step = panel(to.unknowns, U((to.shared + c) * sets + at))
                        e = plus(e, -rays.shared[n, c], step)
                    put(left, U(n * sets + at), e)
                x = plus(x, rays.point[n, 0], e)
                y = plus(y, rays.point[n, 1], e)
                z = plus(z, rays.point[n, 2], e)
            z = i3 * x + i4 * y + i5 * z
            y = i1 * x + i2 * y
            x = i0 * (i0 * x) + i1 * y + i3 * z
            y = i2 * y + i4 * z
            z = i5 * z
            if row >= 0:
                put(to.moved, U(3 * row * sets + at), x)
                put(to.moved, U((3 * row + 1) * sets + at), y)
                put(to.moved, U((3 * row + 2) * sets + at), z)
            for n in range(first, last):
                e = panel(left, U(n * sets + at))
                e = plus(e, -rays.point[n, 0], x)
                e = plus(e, -rays.point[n, 1], y)
                e = plus(e, -rays.point[n, 2], z)
                put(left, U(n * sets + at), e)
                if not to.taken:
                    image = rays.image[n // 2]
                    for c in range(d):
                        here = U((image * d + c) * sets + at)
                        put(to.unknowns, here, plus(panel(to.unknowns, here), rays.own[n, c], e))
                    for c in range(q):
                        here = U((to.shared + c) * sets + at)
                        put(to.unknowns, here, plus(panel(to.unknowns, here), rays.shared[n, c], e))


@compiled(**KERNEL)
def fill(first, last, scene, weight, to, room, kind):
    """Make the rows of points first..last; arguments as of the assembly's.

    weight (points, 6): of control. to: where rows go. room: for a point's rays.
    """
    d, sighted = kind
    row = inner_row_length(d)
    start, wide = scene.observations.start, scene.columns.wide
    # Rows by the point, negative. No literals: `fill_rows` would be compiled for them alone.
    by_point, apart = (room.point, PANEL) if sighted else (room.own, row)
    for p in range(first, last):
        fill_rows(p, p + 1, scene, room, (np.int64(0), wide), d)
        v0, v1, v2 = weight[p - first, 0], weight[p - first, 1], weight[p - first, 2]
        v3, v4, v5 = weight[p - first, 3], weight[p - first, 4], weight[p - first, 5]
        for k in range(2 * (start[p + 1] - start[p])):
            n = 2 * (start[p] - start[first]) + k
            for c in range(d):
                to.own[n * d + c] = room.own[k * row + c]
            for c in range(wide):
                to.shared[n * wide + c] = room.shared[k * wide + c]
            a0, a1, a2 = three(by_point, U(k * apart))
            to.point[3 * n], to.point[3 * n + 1], to.point[3 * n + 2] = -a0, -a1, -a2
            v0 += a0 * a0
            v1 += a1 * a0
            v2 += a1 * a1
            v3 += a2 * a0
            v4 += a2 * a1
            v5 += a2 * a2
        i0, i1, i2, i3, i4, i5, _ = invert_cholesky((v0, v1, v2, v3, v4, v5))
        to.root[p - first, 0], to.root[p - first, 1], to.root[p - first, 2] = i0, i1, i2
        to.root[p - first, 3], to.root[p - first, 4], to.root[p - first, 5] = i3, i4, i5
