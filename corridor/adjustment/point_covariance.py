"""Covariance of every point, by one pass over the points like the assembly itself.

Numba keeps this kernel compiled as long as this very file is unchanged, also where functions of
`kernels` that it takes in have changed: clear `__pycache__` after such a change.
"""

import numpy as np
from numba import njit

from corridor.adjustment.kernels import SEEN, U, _invert_cholesky, _ray, block_offset


def make_point_covariance(d):
    """Covariances of points for images with `d` unknowns."""

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    def point_covariance(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss,
                         width, camera_column, slot_column, low, high, row_of, at_row,
                         image_shift, motion, d_interior, d_image, d_motion, base, control,
                         control_weight, control_residual, d_ground, ground_column, wide, near,
                         stride, neighbour_start, neighbour, poses_shared, shared, longest, out,
                         cross):  # fmt: skip
        """V^-1 + K' Q K of points first..last, with K = W V^-1 and Q of poses and border.

        near: entries of Q between images, stored as the equations; poses_shared (n, q) and shared
        (q, q) the rest. out: (points, 6) lower halves; cross: (points, 3, q) with the border.
        """
        q = shared.shape[0]
        jc = np.zeros(longest * 2 * d)
        jb = np.zeros(longest * 2 * wide)
        part = np.zeros((longest, 2, 3))
        kb = np.zeros((q, 3))
        kc = np.zeros((longest, d, 3))
        modelled = np.zeros((0, 4))
        seen = np.zeros(SEEN)
        for p in range(first, last):
            start = ptr[p]
            m = ptr[p + 1] - start
            v = np.zeros(6)
            kb[:] = 0.0
            for k in range(m):
                i = U(img[start + k])
                ahead, _, _, _ = _ray(
                    U(start + k), U(start + k - base), i, U(k), points[p, 0], points[p, 1],
                    points[p, 2], xy, weight, pose, interior, radials, loss, width, camera_column,
                    slot_column, row_of, at_row, image_shift, motion, d_interior, d_image, d_motion,
                    low[i], high[i], U(wide), modelled, jc, jb, d, img, seen,
                )  # fmt: skip
                for row in range(2):
                    at = k * 2 * d + row * d
                    if not ahead:
                        for c in range(d):
                            jc[at + c] = 0.0
                    a0, a1, a2 = -jc[at], -jc[at + 1], -jc[at + 2]
                    v[0] += a0 * a0
                    v[1] += a1 * a0
                    v[2] += a1 * a1
                    v[3] += a2 * a0
                    v[4] += a2 * a1
                    v[5] += a2 * a2
            r = control[p]
            if r >= 0:
                v[0] += control_weight[r, 0]
                v[2] += control_weight[r, 1]
                v[5] += control_weight[r, 2]
            i0, i1, i2, i3, i4, i5, _ = _invert_cholesky(v[0], v[1], v[2], v[3], v[4], v[5])
            n00 = i0 * i0 + i1 * i1 + i3 * i3
            n10 = i2 * i1 + i4 * i3
            n11 = i2 * i2 + i4 * i4
            n20 = i5 * i3
            n21 = i5 * i4
            n22 = i5 * i5
            for k in range(m):
                i = img[start + k]
                for row in range(2):
                    at = k * 2 * d + row * d
                    a0, a1, a2 = -jc[at], -jc[at + 1], -jc[at + 2]
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
                            jc[k * 2 * d + c] * part[k, 0, x]
                            + jc[k * 2 * d + d + c] * part[k, 1, x]
                        )
            if r >= 0:
                for s in range(d_ground.shape[2]):
                    c = ground_column[r, s]
                    if c >= 0:
                        g0 = control_weight[r, 0] * d_ground[r, 0, s]
                        g1 = control_weight[r, 1] * d_ground[r, 1, s]
                        g2 = control_weight[r, 2] * d_ground[r, 2, s]
                        kb[c, 0] += n00 * g0 + n10 * g1 + n20 * g2
                        kb[c, 1] += n10 * g0 + n11 * g1 + n21 * g2
                        kb[c, 2] += n20 * g0 + n21 * g1 + n22 * g2
            # cov(P, border) = -(K_c' Q_cs + K_b' Q_ss)
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
            sums = np.zeros((3, 3))
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
                for n in range(k, m):
                    i, j = img[start + k], img[start + n]
                    at = block_offset(i, j, i, d, stride, neighbour_start, neighbour)
                    for c in range(d):
                        for e in range(d):
                            if k == n:
                                lower, upper = max(c, e), min(c, e)
                                entry = near[at + U(upper * stride + lower)]
                            else:
                                entry = near[at + U(c * stride + e)]
                            for x in range(3):
                                for w in range(3):
                                    term = entry * kc[k, c, x] * kc[n, e, w]
                                    sums[x, w] += term
                                    if k != n:
                                        sums[w, x] += term
            out[p, 0] = n00 + sums[0, 0]
            out[p, 1] = n10 + sums[1, 0]
            out[p, 2] = n11 + sums[1, 1]
            out[p, 3] = n20 + sums[2, 0]
            out[p, 4] = n21 + sums[2, 1]
            out[p, 5] = n22 + sums[2, 2]

    return point_covariance
