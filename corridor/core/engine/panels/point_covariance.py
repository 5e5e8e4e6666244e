"""Covariance of every point, by one pass over the points like the assembly itself.

With V^-1 = L^-T L^-1 of a point and Q of poses and shared unknowns its covariance is

    L^-T (1 + Y Q Y') L^-1,    Y = L^-1 P'J    (`corridor.core.engine.panels.kernels`)

Points that the same images see need the same part of Q: up to eight of them go together, each in a
lane of its own of all panels.
"""

from typing import NamedTuple

import numpy as np

from corridor.core.engine.compiled import KERNEL, UNWRAPPED, compiled, njit
from corridor.core.engine.panels.kernels import (
    BLOCK,
    GROUP,
    block_offset,
    exposure_of,
    group_size,
    invert_cholesky,
    leads,
)
from corridor.core.engine.panels.lanes import panel, plus, put, same, transposed, zeros
from corridor.core.engine.panels.rays import U, aligned, fill_rows, make_room, put_rows
from corridor.core.engine.scene import PANEL

# Numbers of an unknown in Y: of each axis a panel, one lane a point.
ROW = 3 * PANEL


class Together(NamedTuple):
    """Points that the same images see, all flat. own: Y of the images, ROW numbers an unknown;
    shared: the same of the shared unknowns; root: L^-1, a panel an entry; block (longest,): where
    blocks of Q begin; found: eight numbers of each point."""

    own: np.ndarray
    shared: np.ndarray
    root: np.ndarray
    block: np.ndarray
    found: np.ndarray


def _together(longest: int, d: int, wide: int) -> Together:
    """Room for points of so many rays at most."""
    return Together(
        aligned(longest * d * ROW),
        aligned(wide * ROW),
        aligned(6 * PANEL),
        np.zeros(longest, dtype=np.int64),
        aligned(PANEL * PANEL),
    )


# --- points that the same images see ------------------------------------------------------------


@njit(**UNWRAPPED)
def _of_points(rows, at, apart, count):
    """Numbers at, at + 1 ... of so many rows, `apart` from each other: a panel each, a lane a row.

    Where there are fewer than eight, the last is there again.
    """
    last = U(count - 1)
    return transposed(
        (
            panel(rows, at),
            panel(rows, at + min(U(1), last) * apart),
            panel(rows, at + min(U(2), last) * apart),
            panel(rows, at + min(U(3), last) * apart),
            panel(rows, at + min(U(4), last) * apart),
            panel(rows, at + min(U(5), last) * apart),
            panel(rows, at + min(U(6), last) * apart),
            panel(rows, at + min(U(7), last) * apart),
        )
    )


@njit(**UNWRAPPED)
def _three(values, at):
    """Three panels, one behind the other."""
    return panel(values, at), panel(values, at + U(PANEL)), panel(values, at + U(2 * PANEL))


@njit(**UNWRAPPED)
def _put_three(out, at, a):
    """Put three panels one behind the other."""
    put(out, at, a[0])
    put(out, at + U(PANEL), a[1])
    put(out, at + U(2 * PANEL), a[2])


@njit(**UNWRAPPED)
def _half(root, a):
    """L^-1 a of eight points, a: three panels."""
    i0, i1, i2, i3, i4, i5 = root
    return i0 * a[0], i1 * a[0] + i2 * a[1], i3 * a[0] + i4 * a[1] + i5 * a[2]


@njit(**UNWRAPPED)
def _other_half(root, a):
    """L^-T a of eight points, a: three panels."""
    i0, i1, i2, i3, i4, i5 = root
    return i0 * a[0] + i1 * a[1] + i3 * a[2], i2 * a[1] + i4 * a[2], i5 * a[2]


@njit(**UNWRAPPED)
def _root(together):
    """L^-1 of eight points: 00 10 11 20 21 22."""
    i0, i1, i2 = _three(together.root, U(0))
    i3, i4, i5 = _three(together.root, U(3 * PANEL))
    return i0, i1, i2, i3, i4, i5


@njit(**UNWRAPPED)
def _scaled(root, s):
    """L^-T s L^-1 of eight points; s and what is returned: 00 10 11 20 21 22."""
    s0, s1, s2, s3, s4, s5 = s
    zero = zeros()
    # L^-T times the columns of s L^-1, of which only the lower halves are wanted.
    i0, i1, i2, i3, i4, i5 = root
    first = (
        s0 * i0 + s1 * i1 + s3 * i3,
        s1 * i0 + s2 * i1 + s4 * i3,
        s3 * i0 + s4 * i1 + s5 * i3,
    )
    out0, out1, out3 = _other_half(root, first)
    _, out2, out4 = _other_half(root, (zero, s2 * i2 + s4 * i4, s4 * i2 + s5 * i4))
    return out0, out1, out2, out3, out4, i5 * s5 * i5


@njit(**UNWRAPPED)
def _fill(p, n, m, count, scene, d, room, together):
    """Fill L^-1 and Y of `count` points from p on, the first ray of which is the n-th in the room.

    m: rays of each; d: unknowns of an image.
    """
    columns, control, image = scene.columns, scene.control, scene.observations.image
    own, shared, root = together.own, together.shared, together.root
    row, wide, start = U((d + PANEL) // PANEL * PANEL), U(columns.wide), scene.observations.start[p]
    # Rows by the point, negative.
    by_point, p_row = room.own, row
    if scene.derivatives.sight.shape[0] > 0:
        by_point, p_row = room.point, U(PANEL)
    v0, v1, v2, v3, v4, v5 = zeros(), zeros(), zeros(), zeros(), zeros(), zeros()
    for k in range(2 * m):
        at = U(2 * n + k) * p_row
        a0, a1, a2, _, _, _, _, _ = _of_points(by_point, at, U(2 * m) * p_row, count)
        v0, v1, v2 = v0 + a0 * a0, v1 + a1 * a0, v2 + a1 * a1
        v3, v4, v5 = v3 + a2 * a0, v4 + a2 * a1, v5 + a2 * a2
    _put_three(root, U(0), (v0, v1, v2))
    _put_three(root, U(3 * PANEL), (v3, v4, v5))
    for j in range(PANEL):
        at = U(j)
        u0, u1, u2 = root[at], root[at + U(PANEL)], root[at + U(2 * PANEL)]
        u3, u4, u5 = root[at + U(3 * PANEL)], root[at + U(4 * PANEL)], root[at + U(5 * PANEL)]
        given = control.row[p + j] if j < count else -1
        if given >= 0:
            w = control.weight
            u0, u1, u2 = u0 + w[given, 0], u1 + w[given, 1], u2 + w[given, 2]
            u3, u4, u5 = u3 + w[given, 3], u4 + w[given, 4], u5 + w[given, 5]
        i0, i1, i2, i3, i4, i5, _ = invert_cholesky((u0, u1, u2, u3, u4, u5))
        if j >= count:
            i0, i1, i2, i3, i4, i5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        root[at], root[at + U(PANEL)], root[at + U(2 * PANEL)] = i0, i1, i2
        at += U(3 * PANEL)
        root[at], root[at + U(PANEL)], root[at + U(2 * PANEL)] = i3, i4, i5
    inverse = _root(together)
    for c in range(3 * columns.wide):
        put(shared, U(c * PANEL), zeros())
    e = np.int64(-1)
    for k in range(m):
        i, led = image[U(start + k)], leads(k, start, scene)
        e += 1 if led else 0
        for half in range(2):
            r = U(2 * (n + k) + half)
            a0, a1, a2, _, _, _, _, _ = _of_points(
                by_point, r * p_row, U(2 * m) * p_row, count
            )  # fmt: skip
            t = _half(inverse, (-a0, -a1, -a2))
            for x in range(0, d, PANEL):
                j = _of_points(room.own, r * row + U(x), U(2 * m) * row, count)
                anew = led and half == 0
                _add_outer(own, U((e * d + x) * ROW), t, j, min(PANEL, d - x), anew)
            for x in range(columns.low[i], columns.high[i], PANEL):
                j = _of_points(room.shared, r * wide + U(x), U(2 * m) * wide, count)
                _add_outer(shared, U(x * ROW), t, j, PANEL, False)
    given = control.row[p]
    d_ground = scene.derivatives.ground
    if given >= 0:
        # Such a point stands alone, in the first lane.
        for s in range(d_ground.shape[2]):
            c = columns.ground[given, s]
            if c >= 0:
                w = control.weight
                by = d_ground[given, 0, s], d_ground[given, 1, s], d_ground[given, 2, s]
                g0 = w[given, 0] * by[0] + w[given, 1] * by[1] + w[given, 3] * by[2]
                g1 = w[given, 1] * by[0] + w[given, 2] * by[1] + w[given, 4] * by[2]
                g2 = w[given, 3] * by[0] + w[given, 4] * by[1] + w[given, 5] * by[2]
                t = _half(inverse, (g0 * same(1.0), g1 * same(1.0), g2 * same(1.0)))
                at = U(c * ROW)
                z = _three(shared, at)
                _put_three(shared, at, (z[0] + t[0], z[1] + t[1], z[2] + t[2]))


@njit(**UNWRAPPED)
def _add_outer(out, at, t, j, count, anew):
    """Add t x j to `count` rows of Y, or put it there `anew`; t: three panels, j: eight."""
    for c in range(PANEL):
        if c < count:
            product = t[0] * j[c], t[1] * j[c], t[2] * j[c]
            if not anew:
                before = _three(out, at)
                product = before[0] + product[0], before[1] + product[1], before[2] + product[2]
            _put_three(out, at, product)
            at += U(ROW)


# --- what is asked ------------------------------------------------------------------------------


@njit(**UNWRAPPED)
def _nothing():
    return zeros(), zeros(), zeros()


@njit(**UNWRAPPED)
def _plus_three(s, f, y):
    return plus(s[0], f, y[0]), plus(s[1], f, y[1]), plus(s[2], f, y[2])


@njit(**UNWRAPPED)
def _add_columns(sums, values, at, y, first, count):
    """Add what three columns of Q, from `at` on, make of `count` rows of Y: three panels each."""
    s0, s1, s2 = sums
    a0, a1, a2 = at
    row = U(first * ROW)
    for _ in range(count):
        here = _three(y, row)
        s0 = _plus_three(s0, values[a0], here)
        s1 = _plus_three(s1, values[a1], here)
        s2 = _plus_three(s2, values[a2], here)
        a0 += U(1)
        a1 += U(1)
        a2 += U(1)
        row += U(ROW)
    return s0, s1, s2


@njit(**UNWRAPPED)
def _add_squares(s, y, z):
    """Add y' z + z' y of eight points to s: 00 10 11 20 21 22, half of it on the diagonal."""
    s0, s1, s2, s3, s4, s5 = s
    return (
        s0 + y[0] * z[0],
        s1 + (y[1] * z[0] + y[0] * z[1]),
        s2 + y[1] * z[1],
        s3 + (y[2] * z[0] + y[0] * z[2]),
        s4 + (y[2] * z[1] + y[1] * z[2]),
        s5 + y[2] * z[2],
    )


@njit(**UNWRAPPED)
def _products(start, m, scene, d, known, together):
    """1 + Y Q Y' of points that the same m images see, the first ray of one being `start`."""
    near, q = known.near.flat, known.q
    stride, block = U(known.near.stride), together.block
    own, shared = together.own, together.shared
    zero = zeros()
    s = zero, zero, zero, zero, zero, zero
    # Exposures, one for all rays that they have.
    k = np.int64(-1)
    for ray in range(m):
        if not leads(ray, start, scene):
            continue
        k += 1
        i, last = exposure_of(start + ray, scene), k
        for other in range(ray, m):
            if leads(other, start, scene):
                block[U(last)] = block_offset(
                    i, exposure_of(start + other, scene), i, d, known.near
                )
                last += 1
        for c in range(0, d, 3):
            # Half of the image's own block, of which there is half: what follows is symmetric.
            c1, c2 = min(c + 1, d - 1), min(c + 2, d - 1)
            at = U(block[U(k)])
            sums = (
                _half_column(near, at + U(c) * stride, own, k * d, c, d),
                _half_column(near, at + U(c1) * stride, own, k * d, c1, d),
                _half_column(near, at + U(c2) * stride, own, k * d, c2, d),
            )
            first = i * d
            at = U((first + c) * q), U((first + c1) * q), U((first + c2) * q)
            sums = _add_columns(sums, known.poses_shared, at, shared, np.int64(0), q)
            for n in range(k + 1, last):
                at = U(block[U(n)])
                at = at + U(c) * stride, at + U(c1) * stride, at + U(c2) * stride
                sums = _add_columns(sums, near, at, own, n * d, d)
            s = _add_squares(s, _three(own, U((k * d + c) * ROW)), sums[0])
            if c + 1 < d:
                s = _add_squares(s, _three(own, U((k * d + c + 1) * ROW)), sums[1])
            if c + 2 < d:
                s = _add_squares(s, _three(own, U((k * d + c + 2) * ROW)), sums[2])
    for c in range(q):
        z = _half_column(known.shared, U(c * q), shared, np.int64(0), c, q)
        s = _add_squares(s, _three(shared, U(c * ROW)), z)
    return 1.0 + 2.0 * s[0], s[1], 1.0 + 2.0 * s[2], s[3], s[4], 1.0 + 2.0 * s[5]


@njit(**UNWRAPPED)
def _half_column(values, at, y, first, c, count):
    """What column c of a symmetric block, which begins at `at`, makes of `count` rows of Y.

    From the diagonal on, and that by half.
    """
    row, f, s = U((first + c) * ROW), 0.5, _nothing()
    for e in range(c, count):
        s = _plus_three(s, f * values[at + U(e)], _three(y, row))
        f = 1.0
        row += U(ROW)
    return s


@njit(**UNWRAPPED)
def _with_shared(column, start, m, scene, d, known, together):
    """Covariance of points that the same m images see with a shared unknown: three panels."""
    q = known.q
    own, shared = together.own, together.shared
    s, e = _nothing(), np.int64(-1)
    for b in range(q):
        s = _plus_three(s, known.shared[U(b * q + column)], _three(shared, U(b * ROW)))
    for k in range(m):
        if not leads(k, start, scene):
            continue
        e += 1
        first = exposure_of(start + k, scene) * d
        for c in range(d):
            f = known.poses_shared[U((first + c) * q + column)]
            s = _plus_three(s, f, _three(own, U((e * d + c) * ROW)))
    a, b, c = _other_half(_root(together), s)
    return -a, -b, -c


@njit(**UNWRAPPED)
def _is_asked(p, count, number):
    """Whether any of so many points from p on has a number."""
    for j in range(count):
        if number[p + j] >= 0:
            return True
    return False


@njit(**UNWRAPPED)
def _fill_rows(p, last, scene, d, number, every, room):
    """Rows of some groups of points from p on, few enough for the cache; returns where they end.

    number: as of `Asked`; with `every` all points are asked for.
    """
    start, stop, rays = scene.observations.start, p, np.int64(0)
    while stop < last and rays < BLOCK:
        count = group_size(stop, last, scene)
        if not (every or _is_asked(stop, count, number)):
            break
        rays += count * (start[stop + 1] - start[stop])
        stop += count
    if stop > p:
        # No literal 0: all of it would be compiled once more for that.
        fill_rows(p, stop, scene, room, (np.int64(0), scene.columns.wide), d)
    return stop


@compiled(late=True, **KERNEL)
def covariances(first, last, scene, d, known, asked, room, together):
    """Covariances of points first..last; asked: `Asked`, which receives them."""
    start, found = scene.observations.start, together.found
    number, columns, out, cross = asked.number, asked.columns, asked.out, asked.cross
    every, zero = out.shape[0] > 0, zeros()
    p = first
    while p < last:
        stop = _fill_rows(p, last, scene, d, number, every, room)
        if stop == p:
            p += group_size(p, last, scene)
        n = np.int64(0)
        while p < stop:
            m, count = start[p + 1] - start[p], group_size(p, last, scene)
            _fill(p, n, m, count, scene, d, room, together)
            if every:
                root = _root(together)
                v = _scaled(root, _products(start[p], m, scene, d, known, together))
                put_rows(found, U(0), U(PANEL), (v[0], v[1], v[2], v[3], v[4], v[5], zero, zero))
                for j in range(count):
                    for x in range(6):
                        out[p + j, x] = found[U(j * PANEL + x)]
            for c in range(len(columns)):
                v = _with_shared(columns[c], start[p], m, scene, d, known, together)
                _put_three(found, U(0), v)
                for j in range(count):
                    for x in range(3 if number[p + j] >= 0 else 0):
                        cross[number[p + j], x, c] = found[U(x * PANEL + j)]
            p += count
            n += count * m


def point_covariance(first, last, scene, d, known, longest, asked):
    """As `covariances`, for images with `d` unknowns; longest: the most rays of a point."""
    wide = scene.columns.wide
    room, together = make_room(BLOCK + GROUP * longest, d, wide), _together(longest, d, wide)
    covariances(first, last, scene, d, known, asked, room, together)
