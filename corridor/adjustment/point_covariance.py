"""Covariance of every point, by one pass over the points like the assembly itself."""

from typing import NamedTuple

import numpy as np
from numba import njit

from corridor.adjustment.kernels import (
    Storage,
    block_offset,
    invert_cholesky,
    same_images,
)
from corridor.adjustment.rays import U, fill_rows, make_room, three
from corridor.compiled import KERNEL, UNWRAPPED, compiled
from corridor.panels import PANEL, panel, plus, put, zeros

# Points seen by the same images that are gone over together: two panels.
GROUP = 5
LANES = -(-3 * GROUP // PANEL) * PANEL


class Inverse(NamedTuple):
    """Covariances of images and shared unknowns: entries between images that share a point, stored
    as the equations; poses_shared (n, q), shared (q, q)."""

    near: Storage
    poses_shared: np.ndarray
    shared: np.ndarray


class Gain(NamedTuple):
    """K = W V^-1 of one point: of its rays (longest, d, 3), of the shared unknowns (q, 3)."""

    own: np.ndarray
    shared: np.ndarray


class Asked(NamedTuple):
    """What is to be found. out (points, 6): lower halves, or (0, 6) for none. cross
    (k, 3, columns): with some of the shared unknowns, of the points whose number k in `number`
    (points,) is not -1."""

    number: np.ndarray
    columns: np.ndarray
    out: np.ndarray
    cross: np.ndarray


class Together(NamedTuple):
    """Points that the same images see. gains: K_c, a row of LANES numbers an unknown of the
    images, three a point; moved: Q K_c of one image; offset (longest,): blocks of Q; sums
    (GROUP, 6): lower halves. Of one point, (3, q): K_b' Q_ss, and that with K_c' Q_cs."""

    gains: np.ndarray
    moved: np.ndarray
    offset: np.ndarray
    sums: np.ndarray
    own: np.ndarray
    whole: np.ndarray


# Number by number: a line on whole arrays takes seconds to compile.
@njit(**UNWRAPPED)
def gain(p, scene, d, room, out):
    """Fills K of point p; returns the lower half of V^-1, m^2. d: unknowns of an image."""
    columns, control = scene.columns, scene.control
    img, low, high, wide = scene.observations.image, columns.low, columns.high, columns.wide
    d_ground = scene.derivatives.ground
    sighted = scene.derivatives.sight.shape[0] > 0
    kc, kb = out.own, out.shared
    q = len(kb)
    start = scene.observations.start[p]
    m = scene.observations.start[p + 1] - start
    for c in range(q):
        for x in range(3):
            kb[c, x] = 0.0
    # No literal 0: all of it would be compiled once more for that.
    fill_rows(p, p + 1, scene, room, (np.int64(0), wide), d)
    jc, jb, row = room.own, room.shared, (d + PANEL) // PANEL * PANEL
    # Rows by the point, negative.
    jp, apart = (room.point, PANEL) if sighted else (jc, row)
    v0, v1, v2, v3, v4, v5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(2 * m):
        a0, a1, a2 = three(jp, U(k * apart))
        v0 += a0 * a0
        v1 += a1 * a0
        v2 += a1 * a1
        v3 += a2 * a0
        v4 += a2 * a1
        v5 += a2 * a2
    r = control.row[p]
    if r >= 0:
        v0 += control.weight[r, 0]
        v2 += control.weight[r, 1]
        v5 += control.weight[r, 2]
    i0, i1, i2, i3, i4, i5, _ = invert_cholesky((v0, v1, v2, v3, v4, v5))
    n00 = i0 * i0 + i1 * i1 + i3 * i3
    n10 = i2 * i1 + i4 * i3
    n11 = i2 * i2 + i4 * i4
    n20 = i5 * i3
    n21 = i5 * i4
    n22 = i5 * i5
    for k in range(m):
        i = img[start + k]
        for c in range(d):
            for x in range(3):
                kc[k, c, x] = 0.0
        for half in range(2):
            a0, a1, a2 = three(jp, U((2 * k + half) * apart))
            part = (
                -(n00 * a0 + n10 * a1 + n20 * a2),
                -(n10 * a0 + n11 * a1 + n21 * a2),
                -(n20 * a0 + n21 * a1 + n22 * a2),
            )
            bt, jt = (2 * k + half) * wide, (2 * k + half) * row
            for x in range(3):
                for c in range(low[i], min(high[i], q)):
                    kb[c, x] += jb[bt + c] * part[x]
                for c in range(d):
                    kc[k, c, x] += jc[jt + c] * part[x]
    if r >= 0:
        for s in range(d_ground.shape[2]):
            c = columns.ground[r, s]
            if c >= 0:
                g0 = control.weight[r, 0] * d_ground[r, 0, s]
                g1 = control.weight[r, 1] * d_ground[r, 1, s]
                g2 = control.weight[r, 2] * d_ground[r, 2, s]
                kb[c, 0] += n00 * g0 + n10 * g1 + n20 * g2
                kb[c, 1] += n10 * g0 + n11 * g1 + n21 * g2
                kb[c, 2] += n20 * g0 + n21 * g1 + n22 * g2
    return n00, n10, n11, n20, n21, n22


@compiled(**KERNEL)
def _gains(wanted, first, last, scene, d, room, out, inverse, own, shared):
    """V^-1 and K of the points first..last whose number in wanted is not -1.

    inverse (k, 6): lower halves; shared (k, q, 3), by number. own (observations, d, 3).
    """
    observations = scene.observations
    for p in range(first, last):
        number = wanted[p]
        if number < 0:
            continue
        found = gain(p, scene, d, room, out)
        for n in range(6):
            inverse[number, n] = found[n]
        for c in range(shared.shape[1]):
            for x in range(3):
                shared[number, c, x] = out.shared[c, x]
        start = observations.start[p]
        for k in range(observations.start[p + 1] - start):
            for c in range(d):
                for x in range(3):
                    own[start + k, c, x] = out.own[k, c, x]


def point_gains(wanted, first, last, scene, d, longest, inverse, own, shared):
    """As `_gains`, for images with `d` unknowns; longest: the most rays of a point."""
    room = make_room(longest, d, scene.columns.wide)
    out = Gain(np.zeros((longest, d, 3)), np.zeros((shared.shape[1], 3)))
    _gains(wanted, first, last, scene, d, room, out, inverse, own, shared)


@compiled(late=True, **KERNEL)
def covariances(first, last, scene, d, known, asked, room, gained, together):
    """V^-1 + K' Q K of points first..last, with K = W V^-1 and Q of poses and shared.

    asked: `Asked`, which receives them. room, gained: for a point's rays and what they gain.

    Points that the same images see need the same part of Q: up to `GROUP` of them go together,
    a panel of numbers at a time.
    """
    observations = scene.observations
    img = observations.image
    shared, poses_shared = known.shared, known.poses_shared
    wanted, columns, out, cross = asked.number, asked.columns, asked.out, asked.cross
    q = shared.shape[0]
    kc, kb = gained.own, gained.shared
    gains, sums = together.gains, together.sums
    own, whole = together.own, together.whole
    p = first
    while p < last:
        start = observations.start[p]
        m = observations.start[p + 1] - start
        count = 1
        while (
            count < GROUP
            and p + count < last
            and same_images(
                img,
                start,
                m,
                observations.start[p + count],
                observations.start[p + count + 1],
            )
        ):
            count += 1
        used = -(-3 * count // PANEL) * PANEL
        for r in range(m * d):
            for x in range(3 * count, used):
                gains[r * LANES + x] = 0.0
        for j in range(count):
            number = wanted[p + j]
            if number < 0 and out.shape[0] == 0:
                continue
            inverse = gain(p + j, scene, d, room, gained)
            # cov(P, shared) = -(K_c' Q_cs + K_b' Q_ss)
            for x in range(3):
                for c in range(q):
                    own[x, c] = 0.0
                for b in range(q):
                    f = kb[b, x]
                    for c in range(q):
                        own[x, c] += f * shared[b, c]
                for c in range(q):
                    whole[x, c] = own[x, c]
            for k in range(m):
                row = img[start + k] * d
                for a in range(d):
                    at = (k * d + a) * LANES + 3 * j
                    for x in range(3):
                        f = kc[k, a, x]
                        gains[at + x] = f
                        for c in range(q):
                            whole[x, c] += f * poses_shared[row + a, c]
            if number >= 0:
                for x in range(3):
                    for c in range(len(columns)):
                        cross[number, x, c] = -whole[x, columns[c]]
            # V^-1 + K_b' Q_sc K_c + K_c' Q_cs K_b + K_b' Q_ss K_b
            n = 0
            for x in range(3):
                for w in range(x + 1):
                    total = inverse[n]
                    for b in range(q):
                        total += whole[x, b] * kb[b, w] + (whole[w, b] - own[w, b]) * kb[b, x]
                    sums[j, n] = total
                    n += 1
        if out.shape[0] > 0:
            _sum_of_images(img, start, m, d, known.near, used, together)
            for j in range(count):
                for n in range(6):
                    out[p + j, n] = sums[j, n]
        p += count


def point_covariance(first, last, scene, d, known, longest, asked):
    """As `covariances`, for images with `d` unknowns; longest: the most rays of a point."""
    room = make_room(longest, d, scene.columns.wide)
    gained = Gain(np.zeros((longest, d, 3)), np.zeros((len(known.shared), 3)))
    together = Together(
        np.zeros(longest * d * LANES),
        np.zeros(d * LANES),
        np.zeros(longest, dtype=np.int64),
        np.zeros((GROUP, 6)),
        np.zeros((3, len(known.shared))),
        np.zeros((3, len(known.shared))),
    )
    covariances(first, last, scene, d, known, asked, room, gained, together)


@njit(**UNWRAPPED)
def _sum_of_images(img, start, m, d, storage, used, together):
    """Add K_c' Q_cc K_c of points that the same m images see; used: numbers of a row of gains."""
    near, stride = storage.flat, U(storage.stride)
    gains, moved, sums = together.gains, together.moved, together.sums
    offset = together.offset
    for k in range(m):
        i = img[start + k]
        # Q K_c of the rays from this one on, half of its own: what follows is symmetric.
        at = block_offset(i, i, i, d, storage)
        for c in range(d):
            column = at + U(c) * stride
            for x in range(0, used, PANEL):
                row = U((k * d + c) * LANES + x)
                total = plus(zeros(), 0.5 * near[column + U(c)], panel(gains, row))
                for e in range(c + 1, d):
                    row += U(LANES)
                    total = plus(total, near[column + U(e)], panel(gains, row))
                put(moved, U(c * LANES + x), total)
        for n in range(k + 1, m):
            offset[n] = block_offset(i, img[start + n], i, d, storage)
        for c in range(0, d - 5, 6):
            _six_columns(k, m, d, c, storage, used, together)
        for c in range(d // 6 * 6, d):
            for x in range(0, used, PANEL):
                total = panel(moved, U(c * LANES + x))
                for n in range(k + 1, m):
                    column = U(offset[n]) + U(c) * stride
                    for e in range(d):
                        row = U((n * d + e) * LANES + x)
                        total = plus(total, near[column + U(e)], panel(gains, row))
                put(moved, U(c * LANES + x), total)
        for j in range(min(used // 3, GROUP)):
            s0, s1, s2, s3, s4, s5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for c in range(d):
                row = U((k * d + c) * LANES + 3 * j)
                a0, a1, a2 = gains[row], gains[row + U(1)], gains[row + U(2)]
                row = U(c * LANES + 3 * j)
                b0, b1, b2 = moved[row], moved[row + U(1)], moved[row + U(2)]
                s0 += 2.0 * (a0 * b0)
                s1 += a1 * b0 + a0 * b1
                s2 += 2.0 * (a1 * b1)
                s3 += a2 * b0 + a0 * b2
                s4 += a2 * b1 + a1 * b2
                s5 += 2.0 * (a2 * b2)
            sums[j, 0] += s0
            sums[j, 1] += s1
            sums[j, 2] += s2
            sums[j, 3] += s3
            sums[j, 4] += s4
            sums[j, 5] += s5


@njit(**UNWRAPPED)
def _six_columns(k, m, d, c, storage, used, together):
    """Add to six columns of Q K_c, from c on, what the images behind image k make of them."""
    near, stride = storage.flat, U(storage.stride)
    gains, moved, offset = together.gains, together.moved, together.offset
    for x in range(0, used, PANEL):
        to = U(c * LANES + x)
        t0, t1 = panel(moved, to), panel(moved, to + U(LANES))
        t2, t3 = panel(moved, to + U(2 * LANES)), panel(moved, to + U(3 * LANES))
        t4, t5 = panel(moved, to + U(4 * LANES)), panel(moved, to + U(5 * LANES))
        for n in range(k + 1, m):
            at = U(offset[n]) + U(c) * stride
            row = U(n * d * LANES + x)
            for _ in range(d):
                g = panel(gains, row)
                column = at
                t0 = plus(t0, near[column], g)
                column += stride
                t1 = plus(t1, near[column], g)
                column += stride
                t2 = plus(t2, near[column], g)
                column += stride
                t3 = plus(t3, near[column], g)
                column += stride
                t4 = plus(t4, near[column], g)
                column += stride
                t5 = plus(t5, near[column], g)
                at += U(1)
                row += U(LANES)
        put(moved, to, t0)
        put(moved, to + U(LANES), t1)
        put(moved, to + U(2 * LANES), t2)
        put(moved, to + U(3 * LANES), t3)
        put(moved, to + U(4 * LANES), t4)
        put(moved, to + U(5 * LANES), t5)
