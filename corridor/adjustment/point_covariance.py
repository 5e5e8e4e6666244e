"""Covariance of every point, by one pass over the points like the assembly itself."""

from typing import NamedTuple

import numpy as np

from corridor.adjustment.kernels import (
    SEEN,
    Rows,
    Storage,
    U,
    block_offset,
    invert_cholesky,
    jacobian_rows,
    point_rows,
    see,
)
from corridor.compiled import compiled


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

    @compiled(nogil=True, error_model="numpy", fastmath={"contract"})
    def point_covariance(first, last, scene, known, longest, out, cross):
        """V^-1 + K' Q K of points first..last, with K = W V^-1 and Q of poses and shared.

        out: (points, 6) lower halves; cross: (points, 3, q) with the shared. longest: the most
        rays of a point.
        """
        observations = scene.observations
        img = observations.image
        near, shared, poses_shared = known.near.flat, known.shared, known.poses_shared
        stride = known.near.stride
        q = shared.shape[0]
        work, gained = make_room(longest, d, scene.columns.wide, q)
        kc, kb = gained.own, gained.shared
        sums, moved = np.zeros((3, 3)), np.zeros((d, 3))
        for p in range(first, last):
            start = observations.start[p]
            m = observations.start[p + 1] - start
            n00, n10, n11, n20, n21, n22 = gain(p, scene, d, work, gained)
            # cov(P, shared) = -(K_c' Q_cs + K_b' Q_ss)
            for x in range(3):
                for c in range(q):
                    total = 0.0
                    for b in range(q):
                        total += kb[b, x] * shared[b, c]
                    for k in range(m):
                        i = img[start + k]
                        for a in range(d):
                            total += kc[k, a, x] * poses_shared[i * d + a, c]
                    cross[p, x, c] = -total
            for x in range(3):
                for w in range(3):
                    # K_b' Q_sc K_c + K_c' Q_cs K_b + K_b' Q_ss K_b, of which cross holds the most
                    total = 0.0
                    for b in range(q):
                        total -= cross[p, x, b] * kb[b, w] + cross[p, w, b] * kb[b, x]
                        for c in range(q):
                            total -= kb[b, x] * shared[b, c] * kb[c, w]
                    sums[x, w] = total
            for k in range(m):
                i = img[start + k]
                # Q K_c of the rays from this one on, half of its own: what follows is symmetric.
                for c in range(d):
                    moved[c, 0], moved[c, 1], moved[c, 2] = 0.0, 0.0, 0.0
                at = block_offset(i, i, i, d, known.near)
                for c in range(d):
                    entry = 0.5 * near[at + U(c * stride + c)]
                    for x in range(3):
                        moved[c, x] += entry * kc[k, c, x]
                    for e in range(c):
                        entry = near[at + U(e * stride + c)]
                        for x in range(3):
                            moved[c, x] += entry * kc[k, e, x]
                for n in range(k + 1, m):
                    at = block_offset(i, img[start + n], i, d, known.near)
                    for c in range(d):
                        for e in range(d):
                            entry = near[at + U(c * stride + e)]
                            for x in range(3):
                                moved[c, x] += entry * kc[n, e, x]
                for c in range(d):
                    for x in range(3):
                        for w in range(3):
                            term = kc[k, c, x] * moved[c, w]
                            sums[x, w] += term
                            sums[w, x] += term
            out[p, 0] = n00 + sums[0, 0]
            out[p, 1] = n10 + sums[1, 0]
            out[p, 2] = n11 + sums[1, 1]
            out[p, 3] = n20 + sums[2, 0]
            out[p, 4] = n21 + sums[2, 1]
            out[p, 5] = n22 + sums[2, 2]

    return point_covariance
