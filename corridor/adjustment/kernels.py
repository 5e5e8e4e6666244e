"""One pass over the points: residual, Jacobian, Schur complement, straight into band storage.

No Jacobian is stored. Points are sorted by their first image, images along the corridor, so that
a point touches a few neighbouring columns of a band matrix and a thin border. Each image has `d`
unknowns (centre 3, rotation 3, effects of its own), the border holds what images share.

Increments of image i: C += dC; R <- Exp(dr) R, so that dX/ddr = -[X]x, dX/dC = -R, dX/dP = R.
Motion (c, theta) of the camera at a row: X = Exp(-theta) R (P - C - c).

For one point let J be its rays' Jacobian rows by images and border, P those by the point, and
V = P'P (with damping and control) = L L'. With T = P L^-T the reduced equations are J'(I - TT')J
and J'(I - TT')e: every row j of J meets itself minus its part in T.

Indices are unsigned and arrays flat where it is hot: the compiler then vectorises (no test for a
negative index, no view to count references of).

Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 4.3 and 6.
"""

import numba
import numpy as np
from numba import njit

from corridor.camera import distort, interior_derivative

# Numba leaves straight-line code scalar unless told otherwise; here it is worth a factor of two.
numba.config.SLP_VECTORIZE = 1

SQUARES, HUBER, CAUCHY = 0, 1, 2
# Border columns are handled in panels of this many; the number of columns is rounded up to it.
PANEL = 4
U = np.uint64


@njit(cache=True, inline="always", error_model="numpy")
def _robust(loss, width, s):
    """Cost rho(s) and root of the weight rho'(s); s = |r|^2.

    The weight alone makes the step (iteratively reweighted least squares): slower than with the
    second derivative, but it never overshoots, and a point with two outlying rays stays put.
    """
    k2 = width * width
    if loss == HUBER:
        if s <= k2:
            return s, 1.0
        length = np.sqrt(s)
        return 2.0 * width * length - k2, np.sqrt(width / length)
    return k2 * np.log1p(s / k2), 1.0 / np.sqrt(1.0 + s / k2)


@njit(cache=True, inline="always", error_model="numpy")
def _turn(t0, t1, t2, x, y, z):
    """Exp(-t) applied to (x, y, z)."""
    a2 = t0 * t0 + t1 * t1 + t2 * t2
    if a2 == 0.0:
        return x, y, z
    a = np.sqrt(a2)
    s = np.sin(a) / a
    h = np.sin(0.5 * a)
    q = 2.0 * h * h / a2
    cx, cy, cz = t1 * z - t2 * y, t2 * x - t0 * z, t0 * y - t1 * x
    return (
        x - s * cx + q * (t1 * cz - t2 * cy),
        y - s * cy + q * (t2 * cx - t0 * cz),
        z - s * cz + q * (t0 * cy - t1 * cx),
    )


@njit(cache=True, inline="always", error_model="numpy")
def _model(o, e, i, px, py, pz, xy, pose, interior, radials, row_of, motion, image_shift):
    """The modelled pixel of one observation, with what its derivatives need.

    o: observation, e: its row in image_shift, i: image. With motion the row of the modelled pixel
    decides where the camera is, and the camera where the pixel is: Newton, from the row of the
    measured pixel, needs two turns (the rest is of third order in the residual).

    Returns whether the point is ahead; X, Y, Z; u, v; the pixel without and with the image shift;
    its derivative by X, Y, Z (6); rotation (9) and its turn (3) at that row, the place s of the
    row in the motion's polynomial, the pixel's slope g by the row (2).
    """
    wx, wy, wz = px - pose[i, U(0)], py - pose[i, U(1)], pz - pose[i, U(2)]
    r0, r1, r2 = pose[i, U(3)], pose[i, U(4)], pose[i, U(5)]
    r3, r4, r5 = pose[i, U(6)], pose[i, U(7)], pose[i, U(8)]
    r6, r7, r8 = pose[i, U(9)], pose[i, U(10)], pose[i, U(11)]
    sx = 0.0
    sy = 0.0
    if image_shift.shape[0] > 0:
        sx, sy = image_shift[e, U(0)], image_shift[e, U(1)]
    degree = motion.shape[1] - 1
    t0 = 0.0
    t1 = 0.0
    t2 = 0.0
    s = 0.0
    g0 = 0.0
    g1 = 0.0
    missed = 0.0
    row = 0.0
    downwards = True
    if degree >= 0:
        downwards = row_of[i, U(0)] > 0.0
        row = xy[o, U(1)] if downwards else xy[o, U(0)]
    x, y, z = 0.0, 0.0, 0.0
    u, v, qx, qy = 0.0, 0.0, 0.0, 0.0
    a0, a1, a2, a3, a4, a5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(2 if degree >= 0 else 1):
        dx, dy, dz = wx, wy, wz
        c0, c1, c2, c3, c4, c5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if degree >= 0:
            s = row_of[i, U(1)] * row + row_of[i, U(2)]
            m0, m1, m2 = 0.0, 0.0, 0.0
            t0, t1, t2 = 0.0, 0.0, 0.0
            for n in range(degree, -1, -1):
                c0, c1, c2 = c0 * s + m0, c1 * s + m1, c2 * s + m2
                c3, c4, c5 = c3 * s + t0, c4 * s + t1, c5 * s + t2
                m0 = m0 * s + motion[i, U(n), U(0)]
                m1 = m1 * s + motion[i, U(n), U(1)]
                m2 = m2 * s + motion[i, U(n), U(2)]
                t0 = t0 * s + motion[i, U(n), U(3)]
                t1 = t1 * s + motion[i, U(n), U(4)]
                t2 = t2 * s + motion[i, U(n), U(5)]
            dx, dy, dz = wx - m0, wy - m1, wz - m2
            if t0 != 0.0 or t1 != 0.0 or t2 != 0.0:
                r0, r3, r6 = _turn(t0, t1, t2, pose[i, U(3)], pose[i, U(6)], pose[i, U(9)])
                r1, r4, r7 = _turn(t0, t1, t2, pose[i, U(4)], pose[i, U(7)], pose[i, U(10)])
                r2, r5, r8 = _turn(t0, t1, t2, pose[i, U(5)], pose[i, U(8)], pose[i, U(11)])
        x = r0 * dx + r1 * dy + r2 * dz
        y = r3 * dx + r4 * dy + r5 * dz
        z = r6 * dx + r7 * dy + r8 * dz
        if not z > 0.0:
            break
        iz = 1.0 / z
        u, v = x * iz, y * iz
        qx, qy, xu, xv, yu, yv = distort(u, v, interior, i, radials)
        a0, a1, a3, a4 = xu * iz, xv * iz, yu * iz, yv * iz
        a2, a5 = -(a0 * u + a1 * v), -(a3 * u + a4 * v)
        if degree >= 0:
            k = row_of[i, U(1)]
            fx = k * (-(r0 * c0 + r1 * c1 + r2 * c2) + c5 * y - c4 * z)
            fy = k * (-(r3 * c0 + r4 * c1 + r5 * c2) + c3 * z - c5 * x)
            fz = k * (-(r6 * c0 + r7 * c1 + r8 * c2) + c4 * x - c3 * y)
            g0 = a0 * fx + a1 * fy + a2 * fz
            g1 = a3 * fx + a4 * fy + a5 * fz
            if downwards:
                missed = (qy + sy - row) / (1.0 - g1)
            else:
                missed = (qx + sx - row) / (1.0 - g0)
            row += missed
    qx += g0 * missed
    qy += g1 * missed
    return (
        z > 0.0, x, y, z, u, v, qx, qy, qx + sx, qy + sy, a0, a1, a2, a3, a4, a5,
        r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2, s, g0, g1,
    )  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def residuals(first, last, ptr, img, xy, points, pose, interior, radials, row_of, motion,
              image_shift, base, out, modelled):  # fmt: skip
    """Residuals (pixels, measured minus modelled) of the observations of points first..last.

    modelled: (n, 4) or (0, 4); receives x, y, u, v of each. Returns how many are behind a camera
    (their residual is NaN).
    """
    behind = 0
    for p in range(first, last):
        for o in range(ptr[p], ptr[p + 1]):
            ahead, _, _, _, u, v, _, _, bx, by = _model(
                U(o), U(o - base), U(img[o]), points[p, 0], points[p, 1], points[p, 2], xy, pose,
                interior, radials, row_of, motion, image_shift,
            )[:10]  # fmt: skip
            if not ahead:
                behind += 1
                out[o, 0] = np.nan
                out[o, 1] = np.nan
                continue
            out[o, 0] = xy[o, 0] - bx
            out[o, 1] = xy[o, 1] - by
            if modelled.shape[0] > 0:
                modelled[o, 0], modelled[o, 1], modelled[o, 2], modelled[o, 3] = bx, by, u, v
    return behind


@njit(cache=True, inline="always")
def _put(column, gx, gy, jb, b0, b1, jc, j0, j1):
    """Add to a border column, or to the image's own unknown 4 - column where it is <= -2."""
    if column >= 0:
        jb[b0 + U(column)] += gx
        jb[b1 + U(column)] += gy
    elif column <= -2:
        jc[j0 + U(4 - column)] += gx
        jc[j1 + U(4 - column)] += gy


@njit(cache=True, inline="always", error_model="numpy")
def _ray(o, e, i, k, px, py, pz, xy, weight, pose, interior, radials, loss, width, camera_column,
         slot_column, row_of, image_shift, motion, d_interior, d_image, d_motion, low, high,
         wide, modelled, jc, jb, d):  # fmt: skip
    """Weighted Jacobian rows and residual of one observation, the k-th of its point.

    o: observation, e: its row in the effects' arrays, i: image. Fills jc[k] (2, d): by the image;
    jb[k] (2, wide): by the border, in the panels low..high. By the point: -jc[k][:, :3].
    Returns whether the point is ahead, the two weighted residuals and the cost.
    """
    (
        ahead, x, y, z, u, v, qx, qy, bx, by, g0, g1, g2, h0, h1, h2,
        r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2, place, slope0, slope1,
    ) = _model(
        o, e, i, px, py, pz, xy, pose, interior, radials, row_of, motion, image_shift
    )  # fmt: skip
    if not ahead:
        return False, 0.0, 0.0, 0.0
    if modelled.shape[0] > 0:
        modelled[o, U(0)], modelled[o, U(1)], modelled[o, U(2)], modelled[o, U(3)] = bx, by, u, v
    w = weight[o if weight.shape[0] > 1 else U(0)]
    rx, ry = w * (xy[o, U(0)] - bx), w * (xy[o, U(1)] - by)
    cost = rx * rx + ry * ry
    root = w
    if loss != SQUARES:
        cost, soft = _robust(loss, width, cost)
        root *= soft
        rx *= soft
        ry *= soft
    g0, g1, g2 = g0 * root, g1 * root, g2 * root
    h0, h1, h2 = h0 * root, h1 * root, h2 * root
    # g . (dr x X) = dr . (X x g)
    a0, a1, a2 = y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0
    c0, c1, c2 = y * h2 - z * h1, z * h0 - x * h2, x * h1 - y * h0
    spins = t0 != 0.0 or t1 != 0.0 or t2 != 0.0
    if spins:  # X turns with Exp(-theta) dr
        a0, a1, a2 = _turn(-t0, -t1, -t2, a0, a1, a2)
        c0, c1, c2 = _turn(-t0, -t1, -t2, c0, c1, c2)
    j0 = k * U(2 * d)
    j1 = j0 + U(d)
    jc[j0] = -(g0 * r0 + g1 * r3 + g2 * r6)
    jc[j0 + U(1)] = -(g0 * r1 + g1 * r4 + g2 * r7)
    jc[j0 + U(2)] = -(g0 * r2 + g1 * r5 + g2 * r8)
    jc[j0 + U(3)] = a0
    jc[j0 + U(4)] = a1
    jc[j0 + U(5)] = a2
    jc[j1] = -(h0 * r0 + h1 * r3 + h2 * r6)
    jc[j1 + U(1)] = -(h0 * r1 + h1 * r4 + h2 * r7)
    jc[j1 + U(2)] = -(h0 * r2 + h1 * r5 + h2 * r8)
    jc[j1 + U(3)] = c0
    jc[j1 + U(4)] = c1
    jc[j1 + U(5)] = c2
    for n in range(6, d):
        jc[j0 + U(n)] = 0.0
        jc[j1 + U(n)] = 0.0

    b0 = k * U(2) * wide
    b1 = b0 + wide
    for c in range(low, high):
        jb[b0 + U(c)] = 0.0
        jb[b1 + U(c)] = 0.0
    if high > low:
        f = root * interior[i, U(0)]
        square = u * u + v * v
        column = camera_column[i, U(0)]
        if column >= 0:
            share = root / interior[i, U(0)]
            jb[b0 + U(column)] = share * (qx - interior[i, U(1)])
            jb[b1 + U(column)] = share * (qy - interior[i, U(2)])
        column = camera_column[i, U(1)]
        if column >= 0:
            jb[b0 + U(column)] = root
        column = camera_column[i, U(2)]
        if column >= 0:
            jb[b1 + U(column)] = root
        column = camera_column[i, U(3)]
        if column >= 0:
            jb[b0 + U(column)] = f * (square + 2.0 * u * u)
            jb[b1 + U(column)] = f * 2.0 * u * v
        column = camera_column[i, U(4)]
        if column >= 0:
            jb[b0 + U(column)] = f * 2.0 * u * v
            jb[b1 + U(column)] = f * (square + 2.0 * v * v)
        column = camera_column[i, U(5)]
        if column >= 0:
            jb[b0 + U(column)] = f * u
        column = camera_column[i, U(6)]
        if column >= 0:
            jb[b0 + U(column)] = f * v
        for n in range(radials):
            f *= square
            column = camera_column[i, U(7 + n)]
            if column >= 0:
                jb[b0 + U(column)] = f * u
                jb[b1 + U(column)] = f * v
    slot = 0
    for n in range(d_interior.shape[2]):
        column = slot_column[i, U(slot)]
        slot += 1
        gx = 0.0
        gy = 0.0
        for m in range(15):
            factor = d_interior[i, U(m), U(n)]
            if factor != 0.0:
                fx, fy = interior_derivative(u, v, qx, qy, interior, i, m)
                gx += fx * factor
                gy += fy * factor
        _put(column, root * gx, root * gy, jb, b0, b1, jc, j0, j1)
    for n in range(d_image.shape[2]):
        column = slot_column[i, U(slot)]
        slot += 1
        gx, gy = root * d_image[e, U(0), U(n)], root * d_image[e, U(1), U(n)]
        _put(column, gx, gy, jb, b0, b1, jc, j0, j1)
    for n in range(d_motion.shape[3]):
        column = slot_column[i, U(slot)]
        slot += 1
        m0, m1, m2, q0, q1, q2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(d_motion.shape[1] - 1, -1, -1):
            m0 = m0 * place + d_motion[i, U(m), U(0), U(n)]
            m1 = m1 * place + d_motion[i, U(m), U(1), U(n)]
            m2 = m2 * place + d_motion[i, U(m), U(2), U(n)]
            q0 = q0 * place + d_motion[i, U(m), U(3), U(n)]
            q1 = q1 * place + d_motion[i, U(m), U(4), U(n)]
            q2 = q2 * place + d_motion[i, U(m), U(5), U(n)]
        gx = jc[j0] * m0 + jc[j0 + U(1)] * m1 + jc[j0 + U(2)] * m2
        gy = jc[j1] * m0 + jc[j1 + U(1)] * m1 + jc[j1 + U(2)] * m2
        if q0 != 0.0 or q1 != 0.0 or q2 != 0.0:
            if spins:  # left Jacobian of Exp(-theta), to second order
                e0, e1, e2 = t1 * q2 - t2 * q1, t2 * q0 - t0 * q2, t0 * q1 - t1 * q0
                f0, f1, f2 = t1 * e2 - t2 * e1, t2 * e0 - t0 * e2, t0 * e1 - t1 * e0
                q0 += -0.5 * e0 + f0 / 6.0
                q1 += -0.5 * e1 + f1 / 6.0
                q2 += -0.5 * e2 + f2 / 6.0
            dx, dy, dz = q2 * y - q1 * z, q0 * z - q2 * x, q1 * x - q0 * y
            gx += g0 * dx + g1 * dy + g2 * dz
            gy += h0 * dx + h1 * dy + h2 * dz
        _put(column, gx, gy, jb, b0, b1, jc, j0, j1)
    if slope0 != 0.0 or slope1 != 0.0:
        # What moves the pixel moves its row, and the row moves the camera.
        if row_of[i, U(0)] > 0.0:
            own = 1.0 / (1.0 - slope1)
            other = slope0 * own
            for n in range(d):
                jc[j0 + U(n)] += other * jc[j1 + U(n)]
                jc[j1 + U(n)] *= own
            for n in range(low, high):
                jb[b0 + U(n)] += other * jb[b1 + U(n)]
                jb[b1 + U(n)] *= own
        else:
            own = 1.0 / (1.0 - slope0)
            other = slope1 * own
            for n in range(d):
                jc[j1 + U(n)] += other * jc[j0 + U(n)]
                jc[j0 + U(n)] *= own
            for n in range(low, high):
                jb[b1 + U(n)] += other * jb[b0 + U(n)]
                jb[b0 + U(n)] *= own
    return True, rx, ry, cost


@njit(cache=True, inline="always", error_model="numpy")
def _invert_cholesky(v0, v1, v2, v3, v4, v5):
    """Inverse of the lower Cholesky factor of (00 10 11 20 21 22), in the same order.

    A direction without information (rays that are parallel) gets a zero: it does not move.
    Returns also how many such directions there are.
    """
    weak = 0
    i0 = 0.0
    i2 = 0.0
    i5 = 0.0
    if v0 > 0.0:
        i0 = 1.0 / np.sqrt(v0)
    else:
        weak += 1
    l1, l3 = v1 * i0, v3 * i0
    left = v2 - l1 * l1
    if left > 1e-14 * v2:
        i2 = 1.0 / np.sqrt(left)
    else:
        weak += 1
    l4 = (v4 - l3 * l1) * i2
    left = v5 - l3 * l3 - l4 * l4
    if left > 1e-14 * v5:
        i5 = 1.0 / np.sqrt(left)
    else:
        weak += 1
    i1 = -i2 * l1 * i0
    return i0, i1, i2, i5 * (-l3 * i0 - l4 * i1), -i5 * l4 * i2, i5, weak


@njit(cache=True, inline="always")
def block_offset(i, j, t, d, stride, neighbour_start, neighbour):
    """Where the block (rows of image j, columns of image i <= j) begins in the flat matrix.

    Entry (r, c) of the block lies at offset + c stride + r. Band: LAPACK lower storage with
    leading dimension stride + 1, t is the column image. Sparse: dense d x d blocks in the order
    of each image's sorted neighbours (itself first).
    """
    if neighbour.shape[0] == 0:
        return U(t * d * (stride + 1) + (j - i) * d)
    lower = neighbour_start[i]
    upper = neighbour_start[i + 1] - 1
    while lower < upper:
        middle = (lower + upper) // 2
        if neighbour[middle] < j:
            lower = middle + 1
        else:
            upper = middle
    return U(lower * d * d)


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
def _subtract_block(matrix, offset, stride, y, a, b, d):
    """matrix block (rows of ray b, columns of ray a) -= Y_b Y_a'; a, b: where in y."""
    y00, y01, y02 = y[b], y[b + U(1)], y[b + U(2)]
    y03, y04, y05 = y[b + U(3)], y[b + U(4)], y[b + U(5)]
    n = b + U(d)
    y10, y11, y12 = y[n], y[n + U(1)], y[n + U(2)]
    y13, y14, y15 = y[n + U(3)], y[n + U(4)], y[n + U(5)]
    n += U(d)
    y20, y21, y22 = y[n], y[n + U(1)], y[n + U(2)]
    y23, y24, y25 = y[n + U(3)], y[n + U(4)], y[n + U(5)]
    for c in range(d):
        j0, j1, j2 = y[a + U(c)], y[a + U(d + c)], y[a + U(2 * d + c)]
        at = offset + U(c * stride)
        # All loads before the first store: the compiler cannot know that y is not matrix.
        s0 = matrix[at] - (j0 * y00 + j1 * y10 + j2 * y20)
        s1 = matrix[at + U(1)] - (j0 * y01 + j1 * y11 + j2 * y21)
        s2 = matrix[at + U(2)] - (j0 * y02 + j1 * y12 + j2 * y22)
        s3 = matrix[at + U(3)] - (j0 * y03 + j1 * y13 + j2 * y23)
        s4 = matrix[at + U(4)] - (j0 * y04 + j1 * y14 + j2 * y24)
        s5 = matrix[at + U(5)] - (j0 * y05 + j1 * y15 + j2 * y25)
        matrix[at] = s0
        matrix[at + U(1)] = s1
        matrix[at + U(2)] = s2
        matrix[at + U(3)] = s3
        matrix[at + U(4)] = s4
        matrix[at + U(5)] = s5
        for r in range(6, d):
            n = b + U(r)
            matrix[at + U(r)] -= j0 * y[n] + j1 * y[n + U(d)] + j2 * y[n + U(2 * d)]


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
def _add2(out, at, f0, f1, x, x0, x1):
    """out[at:at + PANEL] += f0 x[x0:] + f1 x[x1:]."""
    s0 = out[at] + (f0 * x[x0] + f1 * x[x1])
    s1 = out[at + U(1)] + (f0 * x[x0 + U(1)] + f1 * x[x1 + U(1)])
    s2 = out[at + U(2)] + (f0 * x[x0 + U(2)] + f1 * x[x1 + U(2)])
    s3 = out[at + U(3)] + (f0 * x[x0 + U(3)] + f1 * x[x1 + U(3)])
    out[at] = s0
    out[at + U(1)] = s1
    out[at + U(2)] = s2
    out[at + U(3)] = s3


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
def _less3(out, at, x, x0, f0, f1, f2, y, y0, y1, y2):
    """out[at:at + PANEL] = x[x0:] - (f0 y[y0:] + f1 y[y1:] + f2 y[y2:])."""
    s0 = x[x0] - (f0 * y[y0] + f1 * y[y1] + f2 * y[y2])
    s1 = x[x0 + U(1)] - (f0 * y[y0 + U(1)] + f1 * y[y1 + U(1)] + f2 * y[y2 + U(1)])
    s2 = x[x0 + U(2)] - (f0 * y[y0 + U(2)] + f1 * y[y1 + U(2)] + f2 * y[y2 + U(2)])
    s3 = x[x0 + U(3)] - (f0 * y[y0 + U(3)] + f1 * y[y1 + U(3)] + f2 * y[y2 + U(3)])
    out[at] = s0
    out[at + U(1)] = s1
    out[at + U(2)] = s2
    out[at + U(3)] = s3


def make_assemble(d):
    """The assembly for images with `d` unknowns (6 and the effects of their own)."""

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    def assemble(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss, width,
                 camera_column, slot_column, low, high, row_of, image_shift, motion, d_interior,
                 d_image, d_motion, base, control, control_weight, control_residual, d_ground,
                 ground_column, wide, damping, split, extra, matrix, stride, neighbour_start,
                 neighbour, gradient, diagonal, border, corner, corner_gradient, corner_diagonal,
                 modelled, totals, longest):  # fmt: skip
        """Add the reduced normal equations of points first..last.

        matrix: flat, see `block_offset`; columns of images >= split go `extra` images later, so
        that two threads do not meet. Flat as well: gradient, diagonal (images, d), border
        (images, d, wide), corner (wide, wide, both halves), corner_gradient, corner_diagonal
        (wide,). low, high: panels of the border that an image touches. control: (points,) row of
        the control arrays or -1. totals: cost, behind, weak directions.
        """
        rows = longest + 2  # room for the three rows of a control point
        jc = np.zeros(longest * 2 * d)
        jb = np.zeros(2 * rows * wide)
        left = np.zeros(2 * wide)
        res = np.zeros(2 * rows)
        seen = np.zeros(longest, dtype=np.uint8)
        y = np.zeros(longest * 3 * d)
        wb = np.zeros(3 * wide)
        yb = np.zeros(3 * wide)
        q = U(wide)
        for p in range(first, last):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            start = ptr[p]
            m = ptr[p + 1] - start
            v0 = 0.0
            v1 = 0.0
            v2 = 0.0
            v3 = 0.0
            v4 = 0.0
            v5 = 0.0
            gp0 = 0.0
            gp1 = 0.0
            gp2 = 0.0
            lo = wide
            hi = 0
            for k in range(m):
                i = img[start + k]
                lo, hi = min(lo, low[i]), max(hi, high[i])
            row = control[p]
            if row >= 0:
                for s in range(d_ground.shape[2]):
                    c = ground_column[row, s]
                    if c >= 0:
                        lo, hi = min(lo, c // PANEL * PANEL), max(hi, c // PANEL * PANEL + PANEL)
            for c in range(lo, hi):
                wb[U(c)] = 0.0
                wb[q + U(c)] = 0.0
                wb[q + q + U(c)] = 0.0
            for k in range(m):
                o = U(start + k)
                i = U(img[o])
                ahead, e0, e1, cost = _ray(
                    o, o - U(base), i, U(k), px, py, pz, xy, weight, pose, interior, radials, loss,
                    width, camera_column, slot_column, row_of, image_shift, motion,
                    d_interior, d_image, d_motion, lo, hi, q, modelled, jc, jb, d,
                )  # fmt: skip
                seen[k] = ahead
                if not ahead:
                    totals[1] += 1.0
                    for r in range(2 * d):
                        jc[U(k * 2 * d + r)] = 0.0
                    continue
                totals[0] += cost
                res[2 * k] = e0
                res[2 * k + 1] = e1
                j0 = U(k * 2 * d)
                j1 = j0 + U(d)
                a0, a1, a2 = -jc[j0], -jc[j0 + U(1)], -jc[j0 + U(2)]
                c0, c1, c2 = -jc[j1], -jc[j1 + U(1)], -jc[j1 + U(2)]
                v0 += a0 * a0 + c0 * c0
                v1 += a1 * a0 + c1 * c0
                v2 += a1 * a1 + c1 * c1
                v3 += a2 * a0 + c2 * c0
                v4 += a2 * a1 + c2 * c1
                v5 += a2 * a2 + c2 * c2
                gp0 += a0 * e0 + c0 * e1
                gp1 += a1 * e0 + c1 * e1
                gp2 += a2 * e0 + c2 * e1
                b0 = U(2 * k) * q
                for c in range(lo, hi, PANEL):
                    at = U(c)
                    _add2(wb, at, a0, c0, jb, b0 + at, b0 + q + at)
                    _add2(wb, q + at, a1, c1, jb, b0 + at, b0 + q + at)
                    _add2(wb, q + q + at, a2, c2, jb, b0 + at, b0 + q + at)
            if row >= 0:
                # Three more rows, one a coordinate: by the point a unit vector, by the border
                # what the effects on ground control say.
                for axis in range(3):
                    root = np.sqrt(control_weight[row, axis])
                    e0 = root * control_residual[row, axis]
                    res[2 * m + axis] = e0
                    b0 = U(2 * m + axis) * q
                    for c in range(lo, hi):
                        jb[b0 + U(c)] = 0.0
                    for s in range(d_ground.shape[2]):
                        c = ground_column[row, s]
                        if c >= 0:
                            jb[b0 + U(c)] += root * d_ground[row, axis, s]
                    for c in range(lo, hi):
                        wb[U(axis) * q + U(c)] += root * jb[b0 + U(c)]
                    if axis == 0:
                        v0 += root * root
                        gp0 += root * e0
                    elif axis == 1:
                        v2 += root * root
                        gp1 += root * e0
                    else:
                        v5 += root * root
                        gp2 += root * e0
            grown = 1.0 + damping
            i0, i1, i2, i3, i4, i5, weak = _invert_cholesky(
                v0 * grown, v1, v2 * grown, v3, v4, v5 * grown
            )
            totals[2] += weak
            n0 = i0 * gp0
            n1 = i1 * gp0 + i2 * gp1
            n2 = i3 * gp0 + i4 * gp1 + i5 * gp2
            for c in range(lo, hi):
                b0, b1, b2 = wb[U(c)], wb[q + U(c)], wb[q + q + U(c)]
                yb[U(c)] = i0 * b0
                yb[q + U(c)] = i1 * b0 + i2 * b1
                yb[q + q + U(c)] = i3 * b0 + i4 * b1 + i5 * b2
            for k in range(m):
                j0 = U(k * 2 * d)
                j1 = j0 + U(d)
                t = img[start + k]
                if t >= split:
                    t += extra
                # T of both rows: P L^-T
                a0, a1, a2 = -jc[j0], -jc[j0 + U(1)], -jc[j0 + U(2)]
                c0, c1, c2 = -jc[j1], -jc[j1 + U(1)], -jc[j1 + U(2)]
                a2 = i3 * a0 + i4 * a1 + i5 * a2
                a1 = i1 * a0 + i2 * a1
                a0 = i0 * a0
                c2 = i3 * c0 + i4 * c1 + i5 * c2
                c1 = i1 * c0 + i2 * c1
                c0 = i0 * c0
                at = U(k * 3 * d)
                for r in range(d):
                    f0, f1 = jc[j0 + U(r)], jc[j1 + U(r)]
                    y[at + U(r)] = f0 * a0 + f1 * c0
                    y[at + U(d + r)] = f0 * a1 + f1 * c1
                    y[at + U(2 * d + r)] = f0 * a2 + f1 * c2
                if not seen[k]:
                    continue
                e0 = res[2 * k] - (a0 * n0 + a1 * n1 + a2 * n2)
                e1 = res[2 * k + 1] - (c0 * n0 + c1 * n1 + c2 * n2)
                m00 = 1.0 - (a0 * a0 + a1 * a1 + a2 * a2)
                m01 = -(a0 * c0 + a1 * c1 + a2 * c2)
                m11 = 1.0 - (c0 * c0 + c1 * c1 + c2 * c2)
                own = block_offset(
                    img[start + k], img[start + k], t, d, stride, neighbour_start, neighbour
                )
                at = U(t * d)
                for c in range(d):
                    f0, f1 = jc[j0 + U(c)], jc[j1 + U(c)]
                    gradient[at + U(c)] += f0 * e0 + f1 * e1
                    diagonal[at + U(c)] += f0 * f0 + f1 * f1
                    w0, w1 = m00 * f0 + m01 * f1, m01 * f0 + m11 * f1
                    column = own + U(c * stride)
                    for r in range(c, d):
                        matrix[column + U(r)] += w0 * jc[j0 + U(r)] + w1 * jc[j1 + U(r)]
                if hi > lo:
                    b0 = U(2 * k) * q
                    b1 = b0 + q
                    for c in range(lo, hi, PANEL):
                        x = U(c)
                        _less3(left, x, jb, b0 + x, a0, a1, a2, yb, x, q + x, q + q + x)
                        _less3(left, q + x, jb, b1 + x, c0, c1, c2, yb, x, q + x, q + q + x)
                        for r in range(d):
                            out = (at + U(r)) * q + x
                            _add2(border, out, jc[j0 + U(r)], jc[j1 + U(r)], left, x, q + x)
                    for r in range(lo, hi):
                        f0, f1 = jb[b0 + U(r)], jb[b1 + U(r)]
                        corner_gradient[U(r)] += f0 * e0 + f1 * e1
                        corner_diagonal[U(r)] += f0 * f0 + f1 * f1
                        for c in range(lo, hi, PANEL):
                            _add2(corner, U(r) * q + U(c), f0, f1, left, U(c), q + U(c))
            if row >= 0 and d_ground.shape[2] > 0:
                for axis in range(3):
                    root = np.sqrt(control_weight[row, axis])
                    a0 = 0.0
                    a1 = 0.0
                    a2 = i5 * root
                    if axis == 0:
                        a0, a1, a2 = i0 * root, i1 * root, i3 * root
                    elif axis == 1:
                        a1, a2 = i2 * root, i4 * root
                    e0 = res[2 * m + axis] - (a0 * n0 + a1 * n1 + a2 * n2)
                    b0 = U(2 * m + axis) * q
                    for c in range(lo, hi, PANEL):
                        x = U(c)
                        _less3(left, x, jb, b0 + x, a0, a1, a2, yb, x, q + x, q + q + x)
                    for r in range(lo, hi):
                        f0 = jb[b0 + U(r)]
                        if f0 != 0.0:
                            corner_gradient[U(r)] += f0 * e0
                            corner_diagonal[U(r)] += f0 * f0
                            for c in range(lo, hi):
                                corner[U(r) * q + U(c)] += f0 * left[U(c)]
            for k in range(m):
                i = img[start + k]
                t = i if i < split else i + extra
                for n in range(k + 1, m):
                    offset = block_offset(
                        i, img[start + n], t, d, stride, neighbour_start, neighbour
                    )
                    _subtract_block(matrix, offset, stride, y, U(k * 3 * d), U(n * 3 * d), d)

    return assemble


def make_substitute(d):
    """The way back to the points for images with `d` unknowns."""

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    def substitute(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss, width,
                   camera_column, slot_column, low, high, row_of, image_shift, motion, d_interior,
                   d_image, d_motion, base, control, control_weight, control_residual, d_ground,
                   ground_column, wide, damping, step, shared, moved, totals):  # fmt: skip
        """Move points first..last by the step of the images (flat) and the border (wide,).

        moved: (points, 3) receives the new points. totals: the points' part of step . gradient and
        of step . diagonal . step.
        """
        jc = np.zeros(2 * d)
        jb = np.zeros(2 * wide)
        modelled = np.zeros((0, 4))
        q = U(wide)
        down = 0.0
        square = 0.0
        for p in range(first, last):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            v0 = 0.0
            v1 = 0.0
            v2 = 0.0
            v3 = 0.0
            v4 = 0.0
            v5 = 0.0
            g0 = 0.0
            g1 = 0.0
            g2 = 0.0
            t0 = 0.0
            t1 = 0.0
            t2 = 0.0
            for o in range(ptr[p], ptr[p + 1]):
                i = U(img[o])
                lo, hi = low[i], high[i]
                ahead, e0, e1, _ = _ray(
                    U(o), U(o - base), i, U(0), px, py, pz, xy, weight, pose, interior, radials,
                    loss, width, camera_column, slot_column, row_of, image_shift, motion,
                    d_interior, d_image, d_motion, lo, hi, q, modelled, jc, jb, d,
                )  # fmt: skip
                if not ahead:
                    continue
                a0, a1, a2 = -jc[U(0)], -jc[U(1)], -jc[U(2)]
                c0, c1, c2 = -jc[U(d)], -jc[U(d + 1)], -jc[U(d + 2)]
                g0 += a0 * e0 + c0 * e1
                g1 += a1 * e0 + c1 * e1
                g2 += a2 * e0 + c2 * e1
                at = i * U(d)
                for c in range(d):
                    e0 -= jc[U(c)] * step[at + U(c)]
                    e1 -= jc[U(d + c)] * step[at + U(c)]
                for c in range(lo, hi):
                    e0 -= jb[U(c)] * shared[U(c)]
                    e1 -= jb[q + U(c)] * shared[U(c)]
                t0 += a0 * e0 + c0 * e1
                t1 += a1 * e0 + c1 * e1
                t2 += a2 * e0 + c2 * e1
                v0 += a0 * a0 + c0 * c0
                v1 += a1 * a0 + c1 * c0
                v2 += a1 * a1 + c1 * c1
                v3 += a2 * a0 + c2 * c0
                v4 += a2 * a1 + c2 * c1
                v5 += a2 * a2 + c2 * c2
            row = control[p]
            if row >= 0:
                w0, w1, w2 = (
                    control_weight[row, 0], control_weight[row, 1], control_weight[row, 2]
                )  # fmt: skip
                e0, e1, e2 = (
                    control_residual[row, 0], control_residual[row, 1], control_residual[row, 2]
                )  # fmt: skip
                v0 += w0
                v2 += w1
                v5 += w2
                g0 += w0 * e0
                g1 += w1 * e1
                g2 += w2 * e2
                for s in range(d_ground.shape[2]):
                    c = ground_column[row, s]
                    if c >= 0:
                        e0 -= d_ground[row, 0, s] * shared[c]
                        e1 -= d_ground[row, 1, s] * shared[c]
                        e2 -= d_ground[row, 2, s] * shared[c]
                t0 += w0 * e0
                t1 += w1 * e1
                t2 += w2 * e2
            grown = 1.0 + damping
            i0, i1, i2, i3, i4, i5, _ = _invert_cholesky(
                v0 * grown, v1, v2 * grown, v3, v4, v5 * grown
            )
            n0 = i0 * t0
            n1 = i1 * t0 + i2 * t1
            n2 = i3 * t0 + i4 * t1 + i5 * t2
            s0 = i0 * n0 + i1 * n1 + i3 * n2
            s1 = i2 * n1 + i4 * n2
            s2 = i5 * n2
            moved[p, 0] = px + s0
            moved[p, 1] = py + s1
            moved[p, 2] = pz + s2
            # With the reduced gradients this adds up to step . gradient of the whole system.
            n0 = i0 * g0
            n1 = i1 * g0 + i2 * g1
            n2 = i3 * g0 + i4 * g1 + i5 * g2
            down += n0 * n0 + n1 * n1 + n2 * n2
            square += s0 * v0 * s0 + s1 * v2 * s1 + s2 * v5 * s2
        totals[0] += down
        totals[1] += square

    return substitute


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def forward(band, ld, n, right):
    """Solve L X = right in place; L (n) in LAPACK lower band storage, right (n, m) row by row."""
    m = right.shape[1]
    for j in range(n):
        at = j * ld
        inverse = 1.0 / band[at]
        for c in range(m):
            right[j, c] *= inverse
        for r in range(1, min(ld, n - j)):
            factor = band[at + r]
            if factor != 0.0:
                for c in range(m):
                    right[j + r, c] -= factor * right[j, c]


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def backward(band, ld, n, right):
    """Solve L' X = right in place; L (n) in LAPACK lower band storage, right (n, m) row by row."""
    m = right.shape[1]
    for j in range(n - 1, -1, -1):
        at = j * ld
        for r in range(1, min(ld, n - j)):
            factor = band[at + r]
            if factor != 0.0:
                for c in range(m):
                    right[j, c] -= factor * right[j + r, c]
        inverse = 1.0 / band[at]
        for c in range(m):
            right[j, c] *= inverse
