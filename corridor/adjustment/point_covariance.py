"""Covariance of every point, by one pass over the points like the assembly itself."""

from typing import NamedTuple

import numpy as np
from numba import njit

from corridor.adjustment.kernels import (
    PANEL,
    SEEN,
    Rows,
    Storage,
    U,
    block_offset,
    invert_cholesky,
    jacobian_rows,
    panel,
    plus,
    point_rows,
    put,
    same_images,
    see,
    zeros,
)
from corridor.compiled import SCALAR, compiled

# Points seen by the same images that are gone over together: three panels of four numbers.
GROUP = 4
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


class Work(NamedTuple):
    """Room for the rays of one point: what is seen, their derivatives, also by the point, and these
    times V^-1."""

    seen: np.ndarray
    by_image: np.ndarray
    by_shared: np.ndarray
    by_point: np.ndarray
    part: np.ndarray


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
    (GROUP, 6): lower halves."""

    gains: np.ndarray
    moved: np.ndarray
    offset: np.ndarray
    sums: np.ndarray


# Of the module and not of a maker's: a function that a maker's holds is compiled in each process.
# Number by number: a line on whole arrays takes seconds to compile.
@compiled(nogil=True, error_model="numpy", fastmath={"contract"})
def gain(p, scene, d, work, out):
    """Fills K of point p; returns the lower half of V^-1, m^2. d: unknowns of an image."""
    observations, columns, control = scene.observations, scene.columns, scene.control
    img, low, high, wide = observations.image, columns.low, columns.high, columns.wide
    d_ground = scene.derivatives.ground
    seen, jc, jb, part = work.seen, work.by_image, work.by_shared, work.part
    jp, sighted = work.by_point, scene.derivatives.sight.shape[0] > 0
    kc, kb = out.own, out.shared
    q = len(kb)
    start = observations.start[p]
    m = observations.start[p + 1] - start
    v0, v1, v2, v3, v4, v5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(q):
        for x in range(3):
            kb[c, x] = 0.0
    point = scene.points[p, 0], scene.points[p, 1], scene.points[p, 2]
    see(start, m, point, observations, scene.cameras, scene.looked, scene.loss, seen)
    for k in range(m):
        i = U(img[start + k])
        j0, b0 = U(k * 2 * d), U(k * 2 * wide)
        to = Rows(jc, j0, j0 + U(d), jb, b0, b0 + U(wide))
        e, at = U(start + k - scene.looked.base), U(k * SEEN)
        jacobian_rows(i, e, seen, at, scene, (low[i], high[i]), d, to)
        if sighted:
            a, b = point_rows(i, e, seen, at, scene)
            jp[k, 0, 0], jp[k, 0, 1], jp[k, 0, 2] = a
            jp[k, 1, 0], jp[k, 1, 1], jp[k, 1, 2] = b
        for row in range(2):
            if not sighted:
                for x in range(3):
                    jp[k, row, x] = -jc[k * 2 * d + row * d + x]
            a0, a1, a2 = jp[k, row, 0], jp[k, row, 1], jp[k, row, 2]
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
        for row in range(2):
            a0, a1, a2 = jp[k, row, 0], jp[k, row, 1], jp[k, row, 2]
            part[k, row, 0] = n00 * a0 + n10 * a1 + n20 * a2
            part[k, row, 1] = n10 * a0 + n11 * a1 + n21 * a2
            part[k, row, 2] = n20 * a0 + n21 * a1 + n22 * a2
            bt = (2 * k + row) * wide
            for c in range(low[i], min(high[i], q)):
                for x in range(3):
                    kb[c, x] += jb[bt + c] * part[k, row, x]
        for c in range(d):
            for x in range(3):
                kc[k, c, x] = (
                    jc[k * 2 * d + c] * part[k, 0, x] + jc[k * 2 * d + d + c] * part[k, 1, x]
                )
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


@compiled(nogil=True, error_model="numpy")
def make_room(longest, d, wide, q):
    """Room for points of so many rays, and for their gain."""
    work = Work(
        np.zeros(longest * SEEN),
        np.zeros(longest * 2 * d),
        np.zeros(longest * 2 * wide),
        np.zeros((longest, 2, 3)),
        np.zeros((longest, 2, 3)),
    )
    return work, Gain(np.zeros((longest, d, 3)), np.zeros((q, 3)))


def make_point_gains(d):
    """Gains of points for images with `d` unknowns."""

    @compiled(nogil=True, error_model="numpy", fastmath={"contract"})
    def point_gains(wanted, first, last, scene, longest, inverse, own, shared):
        """V^-1 and K of the points first..last whose number in wanted is not -1.

        inverse (k, 6): lower halves; shared (k, q, 3), by number. own (observations, d, 3).
        """
        observations = scene.observations
        work, out = make_room(longest, d, scene.columns.wide, shared.shape[1])
        for p in range(first, last):
            number = wanted[p]
            if number < 0:
                continue
            found = gain(p, scene, d, work, out)
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

    return point_gains


def make_point_covariance(d):
    """Covariances of points for images with `d` unknowns."""

    @compiled(vectorised=True, nogil=True, error_model="numpy", fastmath={"contract"})
    def point_covariance(first, last, scene, known, longest, asked):
        """V^-1 + K' Q K of points first..last, with K = W V^-1 and Q of poses and shared.

        longest: the most rays of a point. asked: `Asked`, which receives them.

        Points that the same images see need the same part of Q: up to `GROUP` of them go together,
        a panel of numbers at a time.
        """
        observations = scene.observations
        img = observations.image
        shared, poses_shared = known.shared, known.poses_shared
        wanted, columns, out, cross = asked.number, asked.columns, asked.out, asked.cross
        q = shared.shape[0]
        work, gained = make_room(longest, d, scene.columns.wide, q)
        kc, kb = gained.own, gained.shared
        gains, sums = np.zeros(longest * d * LANES), np.zeros((GROUP, 6))
        together = Together(gains, np.zeros(d * LANES), np.zeros(longest, dtype=np.int64), sums)
        own, whole = np.zeros((3, q)), np.zeros((3, q))
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
                    start + (count - 1) * m,
                    m,
                    observations.start[p + count + 1] - observations.start[p + count],
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
                inverse = gain(p + j, scene, d, work, gained)
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

    return point_covariance


@njit(**SCALAR)
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
        for j in range(used // 3):
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


@njit(**SCALAR)
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
