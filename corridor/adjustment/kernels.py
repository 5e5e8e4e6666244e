"""One pass over the points: residual, Jacobian, Schur complement, straight into band storage.

No Jacobian is stored. Points are sorted by their images, images along the corridor, so that a
point touches a few neighbouring columns of a band matrix and a thin border. Each image has `d`
unknowns (centre 3, rotation 3, effects of its own), the border holds what images share.

Increments of image i: C += dC; R <- Exp(dr) R, so that dX/ddr = -[X]x, dX/dC = -R, dX/dP = R.
Motion (c, theta) of the camera at a row: X = Exp(-theta) (R (P - C) - c).

For one point let J be its rays' Jacobian rows by images, B those by the border, P by the point,
and V = P'P (with damping and control) = L L'. With Y = L^-1 P'J, Z = L^-1 P'B, n = L^-1 P'e the
reduced equations are

    J'J - Y'Y    J'B - Y'Z    and right    J'e - Y'n
                 B'B - Z'Z                 B'e - Z'n

Where the time goes: J'J and Y'Y are gathered over up to `GROUP` points that the same images see
and only then added to the matrix; J'B - Y'Z is (B - T Z)'J with T = P L^-T, ray by ray.

Indices are unsigned and arrays flat where it is hot: the compiler then vectorises (no test for a
negative index, no view to count references of). It takes four numbers at a time where they are
written out side by side and all are read before the first is written: it cannot know which
arrays overlap.

Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 4.3 and 6.
"""

import numba
import numpy as np
from numba import njit
from scipy.linalg.blas import dtbsv

from corridor.camera import SCALAR, bend, interior_change

# Numba leaves straight-line code scalar unless told otherwise; here it is worth a factor of two.
numba.config.SLP_VECTORIZE = 1
# Kernels proper: as the scalar functions, and they let other threads run.
KERNEL = {key: SCALAR[key] for key in ("_nrt", "error_model", "fastmath")}
KERNEL |= {"cache": True, "nogil": True}

SQUARES, HUBER, CAUCHY = 0, 1, 2
# Border columns are handled in panels of this many; the number of columns is rounded up to it.
PANEL = 4
# Points seen by the same images that are gathered before they are added to the matrix.
GROUP = 8
# Numbers that `_see` leaves about a ray: R (P - C) - c; root of the weight; u, v; the same
# distorted; weighted derivative of x and of y by the first three; weighted residual (16). With
# motion also its turn theta (3), the place of the row in the motion's polynomial, and what the
# row puts before the pixel's derivatives (4, see `_slope`); the rest is room.
SEEN = 32
U = np.uint64


@njit(**SCALAR)
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


@njit(**SCALAR)
def _sines(t0, t1, t2):
    """sin(a) / a and (1 - cos(a)) / a^2 of the angle a = |t|."""
    a2 = t0 * t0 + t1 * t1 + t2 * t2
    if a2 > 0.01:
        a = np.sqrt(a2)
        h = np.sin(0.5 * a)
        return np.sin(a) / a, 2.0 * h * h / a2
    # Nearly always, and ten times faster; the next terms are below 1e-17.
    s = 1.0 - a2 * (1 / 6 - a2 * (1 / 120 - a2 * (1 / 5040 - a2 * (1 / 362880))))
    q = 0.5 - a2 * (1 / 24 - a2 * (1 / 720 - a2 * (1 / 40320 - a2 * (1 / 3628800))))
    return s, q


@njit(**SCALAR)
def _turn(s, q, t0, t1, t2, x, y, z):
    """Exp(t) applied to (x, y, z); s, q: `_sines` of t."""
    cx, cy, cz = t1 * z - t2 * y, t2 * x - t0 * z, t0 * y - t1 * x
    return (
        x + s * cx + q * (t1 * cz - t2 * cy),
        y + s * cy + q * (t2 * cx - t0 * cz),
        z + s * cz + q * (t0 * cy - t1 * cx),
    )


@njit(**SCALAR)
def _left(t0, t1, t2, q0, q1, q2):
    """Left Jacobian of Exp(t), to second order, applied to q: Exp(t + q) = Exp(Left q) Exp(t)."""
    e0, e1, e2 = t1 * q2 - t2 * q1, t2 * q0 - t0 * q2, t0 * q1 - t1 * q0
    f0, f1, f2 = t1 * e2 - t2 * e1, t2 * e0 - t0 * e2, t0 * e1 - t1 * e0
    return q0 + 0.5 * e0 + f0 / 6.0, q1 + 0.5 * e1 + f1 / 6.0, q2 + 0.5 * e2 + f2 / 6.0


# --- one ray ----------------------------------------------------------------------------------


@njit(**SCALAR)
def _times_rotation(pose, i, x, y, z):
    """R (x, y, z) of image i."""
    return (
        pose[i, U(3)] * x + pose[i, U(4)] * y + pose[i, U(5)] * z,
        pose[i, U(6)] * x + pose[i, U(7)] * y + pose[i, U(8)] * z,
        pose[i, U(9)] * x + pose[i, U(10)] * y + pose[i, U(11)] * z,
    )


@njit(**SCALAR)
def _before_rotation(pose, i, g0, g1, g2):
    """The row g R of image i."""
    return (
        g0 * pose[i, U(3)] + g1 * pose[i, U(6)] + g2 * pose[i, U(9)],
        g0 * pose[i, U(4)] + g1 * pose[i, U(7)] + g2 * pose[i, U(10)],
        g0 * pose[i, U(5)] + g1 * pose[i, U(8)] + g2 * pose[i, U(11)],
    )


@njit(**SCALAR)
def _motion(s, i, motion):
    """Motion of image i at the place s of a row: centre (3) and turn (3), and their slope by s.

    motion: (images, 6 (degree + 1)), coefficients of s^0 first, the centre in the camera frame.
    """
    c0, c1, c2, c3, c4, c5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    n = U(motion.shape[1] - 6)
    m0, m1, m2 = motion[i, n], motion[i, n + U(1)], motion[i, n + U(2)]
    t0, t1, t2 = motion[i, n + U(3)], motion[i, n + U(4)], motion[i, n + U(5)]
    while n > U(0):
        n -= U(6)
        c0, c1, c2 = c0 * s + m0, c1 * s + m1, c2 * s + m2
        c3, c4, c5 = c3 * s + t0, c4 * s + t1, c5 * s + t2
        m0 = m0 * s + motion[i, n]
        m1 = m1 * s + motion[i, n + U(1)]
        m2 = m2 * s + motion[i, n + U(2)]
        t0 = t0 * s + motion[i, n + U(3)]
        t1 = t1 * s + motion[i, n + U(4)]
        t2 = t2 * s + motion[i, n + U(5)]
    return m0, m1, m2, t0, t1, t2, c0, c1, c2, c3, c4, c5


@njit(**SCALAR)
def _see(first, m, base, img, px, py, pz, xy, weight, pose, interior, radials, loss, width, row_of,
         at_row, image_shift, motion, modelled, seen):  # fmt: skip
    """Where images see a point, and how far that is from the observations first..first + m.

    base: the observation that is the first in image_shift. image_shift: (n, 2) px, or (n, 6) with
    the derivative (4) of the shifted pixel by the one that is not: a shift that looks at where
    the point is shifted to. modelled: (n, 4) or (0, 4); receives pixel and u, v. Fills `seen`
    (m, SEEN); its third number is not positive where the point is behind the camera. Returns the
    cost.

    While the rows are read the camera moves: the row of the modelled pixel decides where the
    camera is, and the camera where the pixel is. One step of Newton from `at_row`, the row found
    last time, finds both: where the row has moved on by a pixel since, a millionth of that is
    left, and nothing once the adjustment is at rest. Derivatives by what moves the camera are
    taken at the row found; at the measured one they would go with its error.

    Each of the three loops is short: a ray is a chain of operations that wait for each other,
    and only if the next rays are near does the processor work on several at once.
    """
    moves = motion.shape[1] > 0
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(img[o])
        x, y, z = _times_rotation(
            pose, i, px - pose[i, U(0)], py - pose[i, U(1)], pz - pose[i, U(2)]
        )
        if moves:
            row = at_row[o]
            s = row_of[i, U(1)] * row + row_of[i, U(2)]
            m0, m1, m2, t0, t1, t2, c0, c1, c2, c3, c4, c5 = _motion(s, i, motion)
            x, y, z = x - m0, y - m1, z - m2
            _set(seen, at, x, y, z, row)
            _set(seen, at + U(16), t0, t1, t2, s)
            # Slope of X before its turn: -dc/ds + X x dtheta/ds.
            c0, c1, c2 = c5 * y - c4 * z - c0, c3 * z - c5 * x - c1, c4 * x - c3 * y - c2
            sine, cosine = _sines(t0, t1, t2)
            _set(seen, at + U(24), c0, c1, c2, sine)
            seen[at + U(28)] = cosine
            x, y, z = _turn(sine, cosine, -t0, -t1, -t2, x, y, z)
        else:
            _set(seen, at, x, y, z, 0.0)
        _set(seen, at + U(4), x, y, z, 0.0)
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(img[o])
        z = seen[at + U(6)]
        iz = 1.0 / z if z > 0.0 else 0.0
        u, v = seen[at + U(4)] * iz, seen[at + U(5)] * iz
        a, b, au, av, bu, bv = bend(u, v, interior, i, radials)
        iz *= interior[i, U(0)]
        g0, g1, h0, h1 = iz * au, iz * av, iz * bu, iz * bv
        _set(seen, at + U(4), u, v, a, b)
        _set(seen, at + U(8), g0, g1, -(g0 * u + g1 * v), h0)
        _set(seen, at + U(12), h1, -(h0 * u + h1 * v), iz, 0.0)
    cost = 0.0
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(img[o])
        if not seen[at + U(14)] > 0.0:
            seen[at + U(2)] = -1.0
            continue
        u, v, a, b = _panel(seen, at + U(4))
        g0, g1, g2, h0 = _panel(seen, at + U(8))
        h1, h2 = seen[at + U(12)], seen[at + U(13)]
        f = interior[i, U(0)]
        mx, my = interior[i, U(1)] + f * a, interior[i, U(2)] + f * b
        if image_shift.shape[0] > 0:
            e = o - U(base)
            mx += image_shift[e, U(0)]
            my += image_shift[e, U(1)]
        s00, s01, s10, s11 = 1.0, 0.0, 0.0, 1.0
        if image_shift.shape[1] > 2:
            e = o - U(base)
            s00, s01 = image_shift[e, U(2)], image_shift[e, U(3)]
            s10, s11 = image_shift[e, U(4)], image_shift[e, U(5)]
            if modelled.shape[0] > 0:
                # The shift is that of the pixel modelled last time: one step of Newton from there.
                x, y = modelled[o, U(0)], modelled[o, U(1)]
                mx, my = x + s00 * (mx - x) + s01 * (my - y), y + s10 * (mx - x) + s11 * (my - y)
            g0, h0 = s00 * g0 + s01 * h0, s10 * g0 + s11 * h0
            g1, h1 = s00 * g1 + s01 * h1, s10 * g1 + s11 * h1
            g2, h2 = s00 * g2 + s01 * h2, s10 * g2 + s11 * h2
            _set(seen, at + U(20), s00, s01, s10, s11)
        if moves:
            row = seen[at + U(3)]
            t0, t1, t2, s = _panel(seen, at + U(16))
            c0, c1, c2, sine = _panel(seen, at + U(24))
            cosine = seen[at + U(28)]
            g0, g1, g2 = _turn(sine, cosine, t0, t1, t2, g0, g1, g2)
            h0, h1, h2 = _turn(sine, cosine, t0, t1, t2, h0, h1, h2)
            factor = row_of[i, U(1)]
            slope_x = factor * (g0 * c0 + g1 * c1 + g2 * c2)
            slope_y = factor * (h0 * c0 + h1 * c1 + h2 * c2)
            k00, k01, k10, k11 = 1.0, 0.0, 0.0, 1.0
            if row_of[i, U(0)] > 0.0:
                k11 = 1.0 / (1.0 - slope_y)
                k01 = slope_x * k11
                missed = (my - row) * k11
            else:
                k00 = 1.0 / (1.0 - slope_x)
                k10 = slope_y * k00
                missed = (mx - row) * k00
            mx += slope_x * missed
            my += slope_y * missed
            g0, h0 = k00 * g0 + k01 * h0, k10 * g0 + k11 * h0
            g1, h1 = k00 * g1 + k01 * h1, k10 * g1 + k11 * h1
            g2, h2 = k00 * g2 + k01 * h2, k10 * g2 + k11 * h2
            seen[at + U(19)] = s + factor * missed
            at_row[o] = row + missed
            _set(
                seen, at + U(20), k00 * s00 + k01 * s10, k00 * s01 + k01 * s11,
                k10 * s00 + k11 * s10, k10 * s01 + k11 * s11,
            )  # fmt: skip
        if modelled.shape[0] > 0:
            modelled[o, U(0)], modelled[o, U(1)] = mx, my
            modelled[o, U(2)], modelled[o, U(3)] = u, v
        root = weight[o if weight.shape[0] > 1 else U(0)]
        rx, ry = root * (xy[o, U(0)] - mx), root * (xy[o, U(1)] - my)
        square = rx * rx + ry * ry
        if loss != SQUARES:
            square, soft = _robust(loss, width, square)
            root *= soft
            rx *= soft
            ry *= soft
        cost += square
        seen[at + U(3)] = root
        _set(seen, at + U(8), root * g0, root * g1, root * g2, root * h0)
        _set(seen, at + U(12), root * h1, root * h2, rx, ry)
    return cost


@njit(**SCALAR)
def _slope(seen, at):
    """Of a camera that moves or an effect on the image: matrix (4) before the pixel's derivatives.

    What moves the pixel moves its row, and the row moves the camera; and effects look at where
    the pixel is. `seen` has it in the derivatives by X, Y, Z already.
    """
    return _panel(seen, at + U(20))


@njit(**SCALAR)
def _put(column, gx, gy, jb, b0, b1, jc, j0, j1):
    """Add to a border column, or to the image's own unknown 4 - column where it is <= -2."""
    if column >= 0:
        jb[b0 + U(column)] += gx
        jb[b1 + U(column)] += gy
    elif column <= -2:
        jc[j0 + U(4 - column)] += gx
        jc[j1 + U(4 - column)] += gy


@njit(**SCALAR)
def _rows(i, e, seen, at, pose, interior, radials, camera_column, slot_column, motion, d_interior,
          d_image, d_motion, low, high, jc, j0, j1, d, jb, b0, b1):  # fmt: skip
    """Weighted Jacobian rows of a ray that `_see` has left in `seen` at `at`.

    i: image, e: row of the observation in d_image. Fills d numbers of jc from j0 (x) and j1 (y)
    on: by the image; jb from b0 and b1 on, in the panels low..high: by the border. By the point:
    the image's first three, negative. A ray from behind has rows of zeros.
    """
    for c in range(low, high, PANEL):
        _set(jb, b0 + U(c), 0.0, 0.0, 0.0, 0.0)
        _set(jb, b1 + U(c), 0.0, 0.0, 0.0, 0.0)
    x, y, z = seen[at], seen[at + U(1)], seen[at + U(2)]
    for c in range(6 if z > 0.0 else 0, d):
        jc[j0 + U(c)] = 0.0
        jc[j1 + U(c)] = 0.0
    if not z > 0.0:
        return
    root, u, v, a, b = (
        seen[at + U(3)], seen[at + U(4)], seen[at + U(5)], seen[at + U(6)], seen[at + U(7)]
    )  # fmt: skip
    g0, g1, g2 = seen[at + U(8)], seen[at + U(9)], seen[at + U(10)]
    h0, h1, h2 = seen[at + U(11)], seen[at + U(12)], seen[at + U(13)]
    p0, p1, p2 = _before_rotation(pose, i, g0, g1, g2)
    q0, q1, q2 = _before_rotation(pose, i, h0, h1, h2)
    # g . (dr x X) = dr . (X x g)
    a0, a1, a2 = y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0
    c0, c1, c2 = y * h2 - z * h1, z * h0 - x * h2, x * h1 - y * h0
    jc[j0], jc[j0 + U(1)], jc[j0 + U(2)] = -p0, -p1, -p2
    jc[j0 + U(3)], jc[j0 + U(4)], jc[j0 + U(5)] = a0, a1, a2
    jc[j1], jc[j1 + U(1)], jc[j1 + U(2)] = -q0, -q1, -q2
    jc[j1 + U(3)], jc[j1 + U(4)], jc[j1 + U(5)] = c0, c1, c2

    f = interior[i, U(0)]
    if high > low:
        column = camera_column[i, U(0)]
        if column >= 0:
            jb[b0 + U(column)] = root * a
            jb[b1 + U(column)] = root * b
        column = camera_column[i, U(1)]
        if column >= 0:
            jb[b0 + U(column)] = root
        column = camera_column[i, U(2)]
        if column >= 0:
            jb[b1 + U(column)] = root
        square = u * u + v * v
        bu, bv = root * f * u, root * f * v
        column = camera_column[i, U(3)]
        if column >= 0:
            jb[b0 + U(column)] = root * f * (square + 2.0 * u * u)
            jb[b1 + U(column)] = 2.0 * u * bv
        column = camera_column[i, U(4)]
        if column >= 0:
            jb[b0 + U(column)] = 2.0 * u * bv
            jb[b1 + U(column)] = root * f * (square + 2.0 * v * v)
        column = camera_column[i, U(5)]
        if column >= 0:
            jb[b0 + U(column)] = bu
        column = camera_column[i, U(6)]
        if column >= 0:
            jb[b0 + U(column)] = bv
        for n in range(radials):
            bu *= square
            bv *= square
            column = camera_column[i, U(7 + n)]
            if column >= 0:
                jb[b0 + U(column)] = bu
                jb[b1 + U(column)] = bv
    slot = U(0)
    for n in range(d_interior.shape[2]):
        dx, dy = interior_change(u, v, a, b, f, 8, d_interior, i, U(n))
        _put(slot_column[i, slot], root * dx, root * dy, jb, b0, b1, jc, j0, j1)
        slot += U(1)
    for n in range(d_image.shape[2]):
        dx, dy = root * d_image[e, U(0), U(n)], root * d_image[e, U(1), U(n)]
        _put(slot_column[i, slot], dx, dy, jb, b0, b1, jc, j0, j1)
        slot += U(1)
    if motion.shape[1] == 0 and d_image.shape[2] == 0:
        return
    k00, k01, k10, k11 = _slope(seen, at)
    for c in range(low, high, PANEL):
        x0, x1, x2, x3 = _panel(jb, b0 + U(c))
        y0, y1, y2, y3 = _panel(jb, b1 + U(c))
        _set(
            jb, b0 + U(c), k00 * x0 + k01 * y0, k00 * x1 + k01 * y1, k00 * x2 + k01 * y2,
            k00 * x3 + k01 * y3,
        )  # fmt: skip
        _set(
            jb, b1 + U(c), k10 * x0 + k11 * y0, k10 * x1 + k11 * y1, k10 * x2 + k11 * y2,
            k10 * x3 + k11 * y3,
        )  # fmt: skip
    for c in range(6, d):
        dx, dy = jc[j0 + U(c)], jc[j1 + U(c)]
        jc[j0 + U(c)], jc[j1 + U(c)] = k00 * dx + k01 * dy, k10 * dx + k11 * dy
    if motion.shape[1] == 0:
        return
    t0, t1, t2, place = _panel(seen, at + U(16))
    for n in range(d_motion.shape[1]):
        m0, m1, m2, m3, m4, m5 = _polynomial(place, d_motion, i, U(n))
        dx, dy, dz = 0.0, 0.0, 0.0
        if m3 != 0.0 or m4 != 0.0 or m5 != 0.0:
            m3, m4, m5 = _left(t0, t1, t2, m3, m4, m5)
            dx, dy, dz = m5 * y - m4 * z, m3 * z - m5 * x, m4 * x - m3 * y
        dx, dy = (
            g0 * (dx - m0) + g1 * (dy - m1) + g2 * (dz - m2),
            h0 * (dx - m0) + h1 * (dy - m1) + h2 * (dz - m2),
        )
        _put(slot_column[i, slot], dx, dy, jb, b0, b1, jc, j0, j1)
        slot += U(1)


@njit(**SCALAR)
def _polynomial(s, motion, i, k):
    """Centre (3) and turn (3) at s; motion (images, k, 6 (degree + 1)) as of `_motion`."""
    n = U(motion.shape[2] - 6)
    m0, m1, m2 = motion[i, k, n], motion[i, k, n + U(1)], motion[i, k, n + U(2)]
    m3, m4, m5 = motion[i, k, n + U(3)], motion[i, k, n + U(4)], motion[i, k, n + U(5)]
    while n > U(0):
        n -= U(6)
        m0 = m0 * s + motion[i, k, n]
        m1 = m1 * s + motion[i, k, n + U(1)]
        m2 = m2 * s + motion[i, k, n + U(2)]
        m3 = m3 * s + motion[i, k, n + U(3)]
        m4 = m4 * s + motion[i, k, n + U(4)]
        m5 = m5 * s + motion[i, k, n + U(5)]
    return m0, m1, m2, m3, m4, m5


@njit(**SCALAR)
def _ray(o, e, i, k, px, py, pz, xy, weight, pose, interior, radials, loss, width, camera_column,
         slot_column, row_of, at_row, image_shift, motion, d_interior, d_image, d_motion, low, high,
         wide, modelled, jc, jb, d, img, seen):  # fmt: skip
    """`_see` and `_rows` of one observation, the k-th of its point.

    Returns whether the point is ahead, the two weighted residuals and the cost.
    """
    cost = _see(
        o, 1, o - e, img, px, py, pz, xy, weight, pose, interior, radials, loss, width, row_of,
        at_row, image_shift, motion, modelled, seen,
    )  # fmt: skip
    j0, b0 = k * U(2 * d), k * U(2) * wide
    _rows(
        i, e, seen, U(0), pose, interior, radials, camera_column, slot_column, motion, d_interior,
        d_image, d_motion, low, high, jc, j0, j0 + U(d), d, jb, b0, b0 + wide,
    )  # fmt: skip
    ahead = seen[U(2)] > 0.0
    return ahead, seen[U(14)] if ahead else 0.0, seen[U(15)] if ahead else 0.0, cost


@njit(**KERNEL)
def _residuals(first, last, ptr, img, xy, points, pose, interior, radials, row_of, at_row, motion,
               image_shift, base, out, modelled, weight, seen):  # fmt: skip
    behind = 0
    for p in range(first, last):
        start = ptr[p]
        m = ptr[p + 1] - start
        _see(
            start, m, base, img, points[p, 0], points[p, 1], points[p, 2], xy, weight, pose,
            interior, radials, SQUARES, 0.0, row_of, at_row, image_shift, motion, modelled, seen,
        )  # fmt: skip
        for k in range(m):
            at = U(k * SEEN)
            ahead = seen[at + U(2)] > 0.0
            behind += 0 if ahead else 1
            out[start + k, 0] = seen[at + U(14)] if ahead else np.nan
            out[start + k, 1] = seen[at + U(15)] if ahead else np.nan
    return behind


def residuals(first, last, ptr, img, xy, points, pose, interior, radials, row_of, at_row, motion,
              image_shift, base, out, modelled):  # fmt: skip
    """Residuals (pixels, measured minus modelled) of the observations of points first..last.

    modelled: (n, 4) or (0, 4); receives x, y, u, v of each. at_row: where the camera moves, the
    row of each, px, as modelled last time, and then as modelled now. Returns how many are behind
    a camera (their residual is NaN).
    """
    longest = int(np.diff(ptr[first : last + 1]).max(initial=1))
    return _residuals(
        first, last, ptr, img, xy, points, pose, interior, radials, row_of, at_row, motion,
        image_shift, base, out, modelled, np.ones(1), np.zeros(longest * SEEN),
    )  # fmt: skip


@njit(**KERNEL)
def cost(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss, width, row_of,
         at_row, motion, image_shift, base, modelled, seen):  # fmt: skip
    """Sum of rho over the observations of points first..last, and how many are behind a camera.

    seen: (most rays of a point * SEEN,) to work in.
    """
    total = 0.0
    behind = 0
    for p in range(first, last):
        start = ptr[p]
        m = ptr[p + 1] - start
        total += _see(
            start, m, base, img, points[p, 0], points[p, 1], points[p, 2], xy, weight, pose,
            interior, radials, loss, width, row_of, at_row, image_shift, motion, modelled, seen,
        )  # fmt: skip
        for k in range(m):
            behind += 0 if seen[U(k * SEEN + 2)] > 0.0 else 1
    return total, behind


# --- four numbers at a time -------------------------------------------------------------------


@njit(**SCALAR)
def _panel(x, at):
    """The PANEL numbers from `at` on."""
    return x[at], x[at + U(1)], x[at + U(2)], x[at + U(3)]


@njit(**SCALAR)
def _set(x, at, x0, x1, x2, x3):
    """x[at:at + PANEL] = ..."""
    x[at] = x0
    x[at + U(1)] = x1
    x[at + U(2)] = x2
    x[at + U(3)] = x3


@njit(**SCALAR)
def _add(out, at, f, x0, x1, x2, x3, g, y0, y1, y2, y3):
    """out[at:at + PANEL] += f x + g y."""
    s0 = out[at] + f * x0 + g * y0
    s1 = out[at + U(1)] + f * x1 + g * y1
    s2 = out[at + U(2)] + f * x2 + g * y2
    s3 = out[at + U(3)] + f * x3 + g * y3
    _set(out, at, s0, s1, s2, s3)


@njit(**SCALAR)
def _less(x, at, a0, a1, a2, y, y0, y1, y2):
    """x[at:at + PANEL] - a0 y[y0:] - a1 y[y1:] - a2 y[y2:]."""
    return (
        x[at] - a0 * y[y0] - a1 * y[y1] - a2 * y[y2],
        x[at + U(1)] - a0 * y[y0 + U(1)] - a1 * y[y1 + U(1)] - a2 * y[y2 + U(1)],
        x[at + U(2)] - a0 * y[y0 + U(2)] - a1 * y[y1 + U(2)] - a2 * y[y2 + U(2)],
        x[at + U(3)] - a0 * y[y0 + U(3)] - a1 * y[y1 + U(3)] - a2 * y[y2 + U(3)],
    )


@njit(**SCALAR)
def _by_point(jc, at, apart, rays, row, x, x_at, x_apart, x_row):
    """-P'x of a point: three panels, one a coordinate; x two rows a ray, like P (jc from at on)."""
    w00, w01, w02, w03 = 0.0, 0.0, 0.0, 0.0
    w10, w11, w12, w13 = 0.0, 0.0, 0.0, 0.0
    w20, w21, w22, w23 = 0.0, 0.0, 0.0, 0.0
    for _ in range(rays):
        for half in range(2):
            n = at + U(half) * row
            x0, x1, x2, x3 = _panel(x, x_at + U(half) * x_row)
            f = jc[n]
            w00 += f * x0
            w01 += f * x1
            w02 += f * x2
            w03 += f * x3
            f = jc[n + U(1)]
            w10 += f * x0
            w11 += f * x1
            w12 += f * x2
            w13 += f * x3
            f = jc[n + U(2)]
            w20 += f * x0
            w21 += f * x1
            w22 += f * x2
            w23 += f * x3
        at += apart
        x_at += x_apart
    return w00, w01, w02, w03, w10, w11, w12, w13, w20, w21, w22, w23


@njit(**SCALAR)
def _gram(x, start, rows, width, first, last, at, columns, out, to):
    """out[c, r] = sum of x[:, at + c] x[:, r]: the rows r of first..last of `columns` columns.

    x: (rows, width) from start on; out: rows of `width`, from `to` on. first: a multiple of PANEL.
    Six columns are made at once, the last six whole.
    """
    for c in range(0, columns, 6):
        for r in range(first, last, PANEL):
            a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
            b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
            c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
            d0, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
            e0, e1, e2, e3 = 0.0, 0.0, 0.0, 0.0
            f0, f1, f2, f3 = 0.0, 0.0, 0.0, 0.0
            row = start
            for _ in range(rows):
                x0, x1, x2, x3 = _panel(x, row + U(r))
                n = row + U(at + c)
                f = x[n]
                a0 += f * x0
                a1 += f * x1
                a2 += f * x2
                a3 += f * x3
                f = x[n + U(1)]
                b0 += f * x0
                b1 += f * x1
                b2 += f * x2
                b3 += f * x3
                f = x[n + U(2)]
                c0 += f * x0
                c1 += f * x1
                c2 += f * x2
                c3 += f * x3
                f = x[n + U(3)]
                d0 += f * x0
                d1 += f * x1
                d2 += f * x2
                d3 += f * x3
                f = x[n + U(4)]
                e0 += f * x0
                e1 += f * x1
                e2 += f * x2
                e3 += f * x3
                f = x[n + U(5)]
                f0 += f * x0
                f1 += f * x1
                f2 += f * x2
                f3 += f * x3
                row += U(width)
            n = to + U(c * width + r)
            _set(out, n, a0, a1, a2, a3)
            _set(out, n + U(width), b0, b1, b2, b3)
            _set(out, n + U(2 * width), c0, c1, c2, c3)
            _set(out, n + U(3 * width), d0, d1, d2, d3)
            _set(out, n + U(4 * width), e0, e1, e2, e3)
            _set(out, n + U(5 * width), f0, f1, f2, f3)


@njit(**SCALAR)
def _subtract(out, at, x, n):
    """out[at:at + 6] -= x[n:n + 6]."""
    s0, s1, s2 = out[at] - x[n], out[at + U(1)] - x[n + U(1)], out[at + U(2)] - x[n + U(2)]
    s3, s4 = out[at + U(3)] - x[n + U(3)], out[at + U(4)] - x[n + U(4)]
    s5 = out[at + U(5)] - x[n + U(5)]
    _set(out, at, s0, s1, s2, s3)
    out[at + U(4)] = s4
    out[at + U(5)] = s5


@njit(**SCALAR)
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


@njit(**SCALAR)
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


# --- the kernels --------------------------------------------------------------------------------


@njit(**SCALAR)
def _same_images(img, start, m, following):
    """Whether the next point, of `following` rays, is seen by the same m images."""
    if m != following:
        return False
    for k in range(m):
        if img[U(start + k)] != img[U(start + m + k)]:
            return False
    return True


def make_assemble(d):
    """The assembly for images with `d` unknowns (6 and the effects of their own)."""
    # A ray's row in jc: its residual, then d unknowns, in whole panels.
    row = -(-(d + 1) // PANEL) * PANEL
    sixes = -(-d // 6) * 6  # as many columns as _gram makes
    # Behind Y's last image its last panel runs over, and n needs a column.
    behind_y = max(-(-d // PANEL) * PANEL - d, 1)

    @njit(**KERNEL)
    def core(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss, width,
             camera_column, slot_column, low, high, row_of, at_row, image_shift, motion,
             d_interior, d_image, d_motion, base, control, control_weight, control_residual,
             d_ground, ground_column, wide, damping, split, extra, matrix, stride,
             neighbour_start, neighbour, gradient, diagonal, border, corner, corner_gradient,
             corner_diagonal, modelled, totals, used, seen, jc, jb, res, y, z, stripe,
             own):  # fmt: skip
        q = U(wide)
        ray, apart = U(2 * row), U(GROUP * 2 * row)  # from a point's ray to the next, in jc
        cost = 0.0
        behind = 0
        waiting = 0
        for p in range(first, last):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            start = ptr[p]
            m = ptr[p + 1] - start
            lo, hi = wide, 0
            for k in range(m):
                i = U(img[U(start + k)])
                lo, hi = min(lo, low[i]), max(hi, high[i])
            given = control[p]
            if given >= 0:
                for s in range(d_ground.shape[2]):
                    c = ground_column[given, s]
                    if c >= 0:
                        lo, hi = min(lo, c // PANEL * PANEL), max(hi, c // PANEL * PANEL + PANEL)

            cost += _see(
                start, m, base, img, px, py, pz, xy, weight, pose, interior, radials, loss, width,
                row_of, at_row, image_shift, motion, modelled, seen,
            )  # fmt: skip
            j_first = U(waiting) * ray
            for k in range(m):
                o = U(start + k)
                at = U(k * SEEN)
                j0 = j_first + U(k) * apart
                j1 = j0 + U(row)
                b0 = U(2 * k) * q
                _rows(
                    U(img[o]), o - U(base), seen, at, pose, interior, radials, camera_column,
                    slot_column, motion, d_interior, d_image, d_motion, lo, hi, jc, j0 + U(1),
                    j1 + U(1), d, jb, b0, b0 + q,
                )  # fmt: skip
                ahead = seen[at + U(2)] > 0.0
                behind += 0 if ahead else 1
                jc[j0] = seen[at + U(14)] if ahead else 0.0
                jc[j1] = seen[at + U(15)] if ahead else 0.0

            # With the residual before the unknowns one panel gives P'e and V.
            gp0, v0, _, _, gp1, v1, v2, _, gp2, v3, v4, v5 = _by_point(
                jc, j_first + U(1), apart, m, U(row), jc, j_first, apart, U(row)
            )
            gp0, gp1, gp2 = -gp0, -gp1, -gp2
            c0, c1, c2 = 0.0, 0.0, 0.0
            if given >= 0:
                # Three more rows, one a coordinate: by the point a unit vector, by the border
                # what the effects on ground control say.
                c0 = np.sqrt(control_weight[given, 0])
                c1 = np.sqrt(control_weight[given, 1])
                c2 = np.sqrt(control_weight[given, 2])
                v0 += c0 * c0
                v2 += c1 * c1
                v5 += c2 * c2
                for axis in range(3):
                    root = np.sqrt(control_weight[given, axis])
                    res[U(axis)] = root * control_residual[given, axis]
                    b0 = U(2 * m + axis) * q
                    for c in range(lo, hi):
                        jb[b0 + U(c)] = 0.0
                    for s in range(d_ground.shape[2]):
                        c = ground_column[given, s]
                        if c >= 0:
                            jb[b0 + U(c)] += root * d_ground[given, axis, s]
                gp0 += c0 * res[U(0)]
                gp1 += c1 * res[U(1)]
                gp2 += c2 * res[U(2)]
            grown = 1.0 + damping
            i0, i1, i2, i3, i4, i5, weak = _invert_cholesky(
                v0 * grown, v1, v2 * grown, v3, v4, v5 * grown
            )
            totals[2] += weak
            n0 = i0 * gp0
            n1 = i1 * gp0 + i2 * gp1
            n2 = i3 * gp0 + i4 * gp1 + i5 * gp2
            for x in range(lo, hi, PANEL):
                n = U(x)
                w00, w01, w02, w03, w10, w11, w12, w13, w20, w21, w22, w23 = _by_point(
                    jc, j_first + U(1), apart, m, U(row), jb, n, q + q, q
                )
                if given >= 0:
                    b0 = U(2 * m) * q + n
                    f0, f1, f2, f3 = _panel(jb, b0)
                    w00, w01, w02, w03 = w00 - c0 * f0, w01 - c0 * f1, w02 - c0 * f2, w03 - c0 * f3
                    f0, f1, f2, f3 = _panel(jb, b0 + q)
                    w10, w11, w12, w13 = w10 - c1 * f0, w11 - c1 * f1, w12 - c1 * f2, w13 - c1 * f3
                    f0, f1, f2, f3 = _panel(jb, b0 + q + q)
                    w20, w21, w22, w23 = w20 - c2 * f0, w21 - c2 * f1, w22 - c2 * f2, w23 - c2 * f3
                _set(z, n, -i0 * w00, -i0 * w01, -i0 * w02, -i0 * w03)
                _set(
                    z, q + n, -i1 * w00 - i2 * w10, -i1 * w01 - i2 * w11, -i1 * w02 - i2 * w12,
                    -i1 * w03 - i2 * w13,
                )  # fmt: skip
                _set(
                    z, q + q + n, -i3 * w00 - i4 * w10 - i5 * w20, -i3 * w01 - i4 * w11 - i5 * w21,
                    -i3 * w02 - i4 * w12 - i5 * w22, -i3 * w03 - i4 * w13 - i5 * w23,
                )  # fmt: skip

            # Y of this point: three rows of d m columns, and n as one more.
            n_y = U(-(-(d * m + behind_y) // PANEL) * PANEL)
            y_first = U(3 * waiting) * n_y
            for k in range(m):
                j0 = j_first + U(k) * apart + U(1)
                j1 = j0 + U(row)
                i = img[U(start + k)]
                t = i if i < split else i + extra
                # T of both rows: P L^-T
                a0, a1, a2 = -jc[j0], -jc[j0 + U(1)], -jc[j0 + U(2)]
                a2 = i3 * a0 + i4 * a1 + i5 * a2
                a1 = i1 * a0 + i2 * a1
                a0 = i0 * a0
                c0, c1, c2 = -jc[j1], -jc[j1 + U(1)], -jc[j1 + U(2)]
                c2 = i3 * c0 + i4 * c1 + i5 * c2
                c1 = i1 * c0 + i2 * c1
                c0 = i0 * c0
                # The last panel runs into the next image's columns, which are filled after it.
                for x in range(0, d, PANEL):
                    f0, f1, f2, f3 = _panel(jc, j0 + U(x))
                    h0, h1, h2, h3 = _panel(jc, j1 + U(x))
                    n = y_first + U(k * d + x)
                    _set(
                        y, n, f0 * a0 + h0 * c0, f1 * a0 + h1 * c0, f2 * a0 + h2 * c0,
                        f3 * a0 + h3 * c0,
                    )  # fmt: skip
                    n += n_y
                    _set(
                        y, n, f0 * a1 + h0 * c1, f1 * a1 + h1 * c1, f2 * a1 + h2 * c1,
                        f3 * a1 + h3 * c1,
                    )  # fmt: skip
                    n += n_y
                    _set(
                        y, n, f0 * a2 + h0 * c2, f1 * a2 + h1 * c2, f2 * a2 + h2 * c2,
                        f3 * a2 + h3 * c2,
                    )  # fmt: skip
                e0 = jc[j0 - U(1)] - (a0 * n0 + a1 * n1 + a2 * n2)
                e1 = jc[j1 - U(1)] - (c0 * n0 + c1 * n1 + c2 * n2)
                b0 = U(2 * k) * q
                b1 = b0 + q
                for x in range(lo, hi, PANEL):
                    n = U(x)
                    s0, s1, s2, s3 = _less(jb, b0 + n, a0, a1, a2, z, n, q + n, q + q + n)
                    u0, u1, u2, u3 = _less(jb, b1 + n, c0, c1, c2, z, n, q + n, q + q + n)
                    at = U(t * d) * q + n
                    for r in range(d):
                        f, g = jc[j0 + U(r)], jc[j1 + U(r)]
                        _add(border, at, f, s0, s1, s2, s3, g, u0, u1, u2, u3)
                        at += q
                    for r in range(x, min(hi, used)):
                        f, g = jb[b0 + U(r)], jb[b1 + U(r)]
                        _add(corner, U(r) * q + n, f, s0, s1, s2, s3, g, u0, u1, u2, u3)
                    s0, s1, s2, s3 = _panel(jb, b0 + n)
                    u0, u1, u2, u3 = _panel(jb, b1 + n)
                    _add(corner_gradient, n, e0, s0, s1, s2, s3, e1, u0, u1, u2, u3)
                    s0, s1, s2, s3 = s0 * s0, s1 * s1, s2 * s2, s3 * s3
                    u0, u1, u2, u3 = u0 * u0, u1 * u1, u2 * u2, u3 * u3
                    _add(corner_diagonal, n, 1.0, s0, s1, s2, s3, 1.0, u0, u1, u2, u3)
            if given >= 0 and d_ground.shape[2] > 0:
                for axis in range(3):
                    root = np.sqrt(control_weight[given, axis])
                    a0, a1, a2 = 0.0, 0.0, i5 * root
                    if axis == 0:
                        a0, a1, a2 = i0 * root, i1 * root, i3 * root
                    elif axis == 1:
                        a1, a2 = i2 * root, i4 * root
                    e0 = res[U(axis)] - (a0 * n0 + a1 * n1 + a2 * n2)
                    b0 = U(2 * m + axis) * q
                    for x in range(lo, hi, PANEL):
                        n = U(x)
                        s0, s1, s2, s3 = _less(jb, b0 + n, a0, a1, a2, z, n, q + n, q + q + n)
                        for r in range(x, hi):
                            f = jb[b0 + U(r)]
                            _add(corner, U(r) * q + n, f, s0, s1, s2, s3, 0.0, 0.0, 0.0, 0.0, 0.0)
                    for r in range(lo, hi):
                        f = jb[b0 + U(r)]
                        corner_gradient[U(r)] += f * e0
                        corner_diagonal[U(r)] += f * f
            n = y_first + U(d * m)
            y[n] = n0
            y[n + n_y] = n1
            y[n + n_y + n_y] = n2
            waiting += 1
            if (
                waiting < GROUP
                and p + 1 < last
                and _same_images(img, start, m, ptr[p + 2] - ptr[p + 1])
            ):
                continue

            # J'J and Y'Y of all points that wait, image by image: first gathered, one image
            # later added to the matrix. What has just been written in fours cannot be read in
            # sixes before it has reached the cache.
            for turn in range(m + 1):
                if turn < m:
                    k = turn
                    _gram(
                        y, U(0), 3 * waiting, n_y, k * d // PANEL * PANEL, n_y, k * d, d, stripe,
                        U((k & 1) * sixes) * n_y,
                    )  # fmt: skip
                    _gram(
                        jc, U(k) * apart, 2 * waiting, row, 0, row, 1, d, own,
                        U((k & 1) * sixes * row),
                    )  # fmt: skip
                if turn == 0:
                    continue
                k = turn - 1
                i = img[U(start + k)]
                t = i if i < split else i + extra
                ys = U((k & 1) * sixes) * n_y
                js = U((k & 1) * sixes * row)
                at = U(t * d)
                offset = block_offset(i, i, t, d, stride, neighbour_start, neighbour)
                for c in range(d):
                    gradient[at + U(c)] += own[js] - stripe[ys + U(d * m)]
                    diagonal[at + U(c)] += own[js + U(1 + c)]
                    for r in range(c, d):
                        matrix[offset + U(r)] += own[js + U(1 + r)] - stripe[ys + U(k * d + r)]
                    js += U(row)
                    ys += n_y
                    offset += U(stride)
                for n in range(k + 1, m):
                    j = img[U(start + n)]
                    offset = block_offset(i, j, t, d, stride, neighbour_start, neighbour)
                    at = U((k & 1) * sixes) * n_y + U(n * d)
                    for _ in range(d):
                        _subtract(matrix, offset, stripe, at)
                        for r in range(6, d):
                            matrix[offset + U(r)] -= stripe[at + U(r)]
                        at += n_y
                        offset += U(stride)
            waiting = 0
        totals[0] += cost
        totals[1] += behind

    def assemble(*arguments):
        """Add the reduced normal equations of points first..last.

        Arguments as of `core` up to totals, and longest, the most rays of a point.
        matrix: flat, see `block_offset`; columns of images >= split go `extra` images later, so
        that two threads do not meet. Flat as well: gradient, diagonal (images, d), border
        (images, d, wide), corner (wide, wide, lower half), corner_gradient, corner_diagonal
        (wide,). low, high: panels of the border that an image touches. control: (points,) row of
        the control arrays or -1. totals: cost, behind, weak directions.
        """
        *arguments, longest = arguments
        wide = arguments[29]
        # The last panel's columns that no ray touches are left out where it is easy.
        touched = (arguments[12], arguments[13], arguments[28])  # columns by camera, slot, ground
        used = 1 + max(int(columns.max(initial=-1)) for columns in touched)
        n_y = -(-(d * longest + behind_y) // PANEL) * PANEL
        core(
            *arguments,
            used,
            np.zeros(longest * SEEN),
            np.zeros(longest * GROUP * 2 * row + PANEL),
            np.zeros((2 * longest + 3) * wide),
            np.zeros(3),
            np.zeros(GROUP * 3 * n_y + 2 * sixes),
            np.zeros(3 * wide),
            np.zeros(2 * sixes * n_y),
            np.zeros(2 * sixes * row),
        )

    assemble.core = core
    return assemble


def make_substitute(d):
    """The way back to the points for images with `d` unknowns."""

    @njit(**KERNEL)
    def core(first, last, ptr, img, xy, weight, points, pose, interior, radials, loss, width,
             camera_column, slot_column, low, high, row_of, at_row, image_shift, motion,
             d_interior, d_image, d_motion, base, control, control_weight, control_residual,
             d_ground, ground_column, wide, damping, step, shared, interior_step, image_step,
             motion_step, moved, totals, modelled, seen):  # fmt: skip
        moves = motion.shape[1] > 0
        most = radials if d_interior.shape[2] == 0 else 8
        down = 0.0
        square = 0.0
        for p in range(first, last):
            px, py, pz = points[p, 0], points[p, 1], points[p, 2]
            v0, v1, v2, v3, v4, v5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            g0, g1, g2 = 0.0, 0.0, 0.0
            t0, t1, t2 = 0.0, 0.0, 0.0
            start = ptr[p]
            m = ptr[p + 1] - start
            _see(
                start, m, base, img, px, py, pz, xy, weight, pose, interior, radials, loss, width,
                row_of, at_row, image_shift, motion, modelled, seen,
            )  # fmt: skip
            for k in range(m):
                o, at = U(start + k), U(k * SEEN)
                i = U(img[o])
                x, y, z, root = _panel(seen, at)
                if not z > 0.0:
                    continue
                u, v, a, b = _panel(seen, at + U(4))
                # How far the step moves the pixel, weighted: first by the interior and the image
                # effects, then by centre, turn and motion, by way of X.
                f = interior[i, U(0)]
                sx, sy = interior_change(u, v, a, b, f, most, interior_step, i, U(0))
                for n in range(d_image.shape[2]):
                    e = o - U(base)
                    sx += d_image[e, U(0), U(n)] * image_step[i, U(n)]
                    sy += d_image[e, U(1), U(n)] * image_step[i, U(n)]
                sx *= root
                sy *= root
                n = i * U(d)
                q0, q1, q2 = step[n + U(3)], step[n + U(4)], step[n + U(5)]
                w0, w1, w2 = 0.0, 0.0, 0.0
                if moves or d_image.shape[2] > 0:
                    k00, k01, k10, k11 = _slope(seen, at)
                    sx, sy = k00 * sx + k01 * sy, k10 * sx + k11 * sy
                if moves:
                    r0, r1, r2, place = _panel(seen, at + U(16))
                    w0, w1, w2, w3, w4, w5 = _polynomial(place, motion_step, i, U(0))
                    w3, w4, w5 = _left(r0, r1, r2, w3, w4, w5)
                    q0, q1, q2 = q0 - w3, q1 - w4, q2 - w5
                dx, dy, dz = q1 * z - q2 * y - w0, q2 * x - q0 * z - w1, q0 * y - q1 * x - w2
                q0, q1, q2 = step[n], step[n + U(1)], step[n + U(2)]
                f0, f1, f2, h0 = _panel(seen, at + U(8))
                h1, h2, e0, e1 = _panel(seen, at + U(12))
                a0, a1, a2 = _before_rotation(pose, i, f0, f1, f2)
                sx += f0 * dx + f1 * dy + f2 * dz - (a0 * q0 + a1 * q1 + a2 * q2)
                c0, c1, c2 = _before_rotation(pose, i, h0, h1, h2)
                sy += h0 * dx + h1 * dy + h2 * dz - (c0 * q0 + c1 * q1 + c2 * q2)
                g0 += a0 * e0 + c0 * e1
                g1 += a1 * e0 + c1 * e1
                g2 += a2 * e0 + c2 * e1
                e0 -= sx
                e1 -= sy
                t0 += a0 * e0 + c0 * e1
                t1 += a1 * e0 + c1 * e1
                t2 += a2 * e0 + c2 * e1
                v0 += a0 * a0 + c0 * c0
                v1 += a1 * a0 + c1 * c0
                v2 += a1 * a1 + c1 * c1
                v3 += a2 * a0 + c2 * c0
                v4 += a2 * a1 + c2 * c1
                v5 += a2 * a2 + c2 * c2
            given = control[p]
            if given >= 0:
                w0 = control_weight[given, 0]
                w1 = control_weight[given, 1]
                w2 = control_weight[given, 2]
                e0 = control_residual[given, 0]
                e1 = control_residual[given, 1]
                e2 = control_residual[given, 2]
                v0 += w0
                v2 += w1
                v5 += w2
                g0 += w0 * e0
                g1 += w1 * e1
                g2 += w2 * e2
                for s in range(d_ground.shape[2]):
                    c = ground_column[given, s]
                    if c >= 0:
                        e0 -= d_ground[given, 0, s] * shared[c]
                        e1 -= d_ground[given, 1, s] * shared[c]
                        e2 -= d_ground[given, 2, s] * shared[c]
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

    def substitute(*arguments):
        """Move points first..last by the step of the images (flat) and the border (wide,).

        interior_step (m, 15, 1), image_step (m, k), motion_step (m, 1, 6 (degree + 1)): what that
        step does to each image's interior, image effects and motion. moved: (points, 3) receives
        the new points. totals: the points' part of step . gradient and of step . diagonal . step.
        """
        longest = int(np.diff(arguments[2][arguments[0] : arguments[1] + 1]).max(initial=1))
        core(*arguments, np.zeros((0, 4)), np.zeros(longest * SEEN))

    substitute.core = core
    return substitute


# --- triangular solutions with the band ---------------------------------------------------------


def forward(band, ld, n, right):
    """Solve L X = right in place; L (n) in LAPACK lower band storage, right (n, m) row by row."""
    if right.shape[1] == 1:
        right[:, 0] = dtbsv(ld - 1, band[: n * ld].reshape(n, ld).T, right[:, 0], lower=1)
    else:
        _forward(band, ld, n, right)


def backward(band, ld, n, right):
    """Solve L' X = right in place; L (n) in LAPACK lower band storage, right (n, m) row by row."""
    if right.shape[1] == 1:
        lower = band[: n * ld].reshape(n, ld).T
        right[:, 0] = dtbsv(ld - 1, lower, right[:, 0], lower=1, trans=1)
    else:
        _backward(band, ld, n, right)


@njit(**KERNEL)
def _forward(band, ld, n, right):
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


@njit(**KERNEL)
def _backward(band, ld, n, right):
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
