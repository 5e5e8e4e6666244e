"""One pass over the points: residual, Jacobian, Schur complement, straight into band storage.

No Jacobian is stored. Points are sorted by their images, images along the corridor, so that a
point touches a few neighbouring columns of a band matrix and few shared unknowns. Each image has
`d` unknowns (centre 3, rotation 3, effects of its own); cameras, effects and lever arms are shared.

Increments of image i: C += dC; R <- Exp(dr) R, so that dX/ddr = -[X]x, dX/dC = -R, dX/dP = R.
Motion (c, theta) of the camera at a row: X = Exp(-theta) (R (P - C) - c).

For one point let J be its rays' Jacobian rows by images, B those by what is shared, P by the point,
and V = P'P (with damping and control) = L L'. With Y = L^-1 P'J, Z = L^-1 P'B, n = L^-1 P'e the
reduced equations are

    J'J - Y'Y    J'B - Y'Z    and right    J'e - Y'n
                 B'B - Z'Z                 B'e - Z'n

Where the time goes: J'J and Y'Y are gathered over up to `GROUP` points that the same images see
and only then added to the matrix; J'B - Y'Z is (B - T Z)'J with T = P L^-T, ray by ray.

Indices are unsigned and arrays flat where it is hot: the compiler then vectorises (no test for a
negative index, no view to count references of). It takes four numbers at a time, a panel, where
all are read before the first is written: it cannot know which arrays overlap.

Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 4.3 and 6.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg.blas import dtbsv

from corridor.camera import distort_normalised, interior_change, interior_derivatives_at
from corridor.compiled import KERNEL, SCALAR, compiled
from corridor.geometry import cross, dot, left_jacobian, rotated, sines

SQUARES, HUBER, CAUCHY = 0, 1, 2
# Shared unknowns are handled in panels of this many; their number is rounded up to it.
PANEL = 4
# Points seen by the same images that are gathered before they are added to the matrix.
GROUP = 8
# A row that is not found after so many steps never is.
PASSES = 8
# Numbers that `see` leaves about a ray: R (P - C) - c; root of the weight; u, v; the same
# distorted; weighted derivative of x and of y by the first three; weighted residual (16). With
# motion also its turn theta (3), the place of the row in the motion's polynomial, and what the
# row puts before the pixel's derivatives (4, see `_slope`); the modelled pixel at 29. From 32 on
# the derivative by the interior.
SEEN, INNER = 64, 32
U = np.uint64


# --- what the kernels are given ---------------------------------------------------------------


class Observations(NamedTuple):
    """start (points + 1,): where the rays of a point begin; of each ray image (n,), xy (n, 2) px
    and weight (n,) or (1,), the root of it."""

    start: np.ndarray
    image: np.ndarray
    xy: np.ndarray
    weight: np.ndarray


class Cameras(NamedTuple):
    """Of each image: pose (m, 12), centre and rotation; interior (m, 15), of which `radials` radial
    coefficients count; row_of (m, 3) as in `Images.row_of`; motion (m, 1, 6 (degree + 1)), or
    (m, 1, 0) where no camera moves. turns: whether it, or its derivatives, turn any."""

    pose: np.ndarray
    interior: np.ndarray
    radials: int
    row_of: np.ndarray
    motion: np.ndarray
    turns: bool


class Looked(NamedTuple):
    """What effects say of the rays of some points, the first of which is the ray `base`.

    shift (k, 2) px by effects on the image, or (k, 6) with the derivative of the shifted pixel by
    the one that is not; (0, 2) without. Of all rays, and moved on to what is found now:
    row (n,), the row that a moving camera reads it in, and modelled (n, 4), the pixel at which
    effects looked and its u, v; (0,) and (0, 4) where nothing needs them. Rows are looked for
    anew until they were missed by less than `near`, px.
    """

    base: int
    shift: np.ndarray
    row: np.ndarray
    modelled: np.ndarray
    near: float


class Derivatives(NamedTuple):
    """By the effects' parameters: of the interior (m, 15, k), of the image (rays, 2, k), of the
    motion (m, k, 6 (degree + 1)), of the ground control (c, 3, k). sight (rays, 2, 9): of effects
    on the image that see object points, by centre, turn and point; (0, 2, 9) without."""

    interior: np.ndarray
    image: np.ndarray
    motion: np.ndarray
    ground: np.ndarray
    sight: np.ndarray


class Columns(NamedTuple):
    """Number of the unknown behind each derivative: >= 0 shared, -1 held, <= -2 the image's own
    4 - number. camera (m, 15), slot (m, effects on camera, image, motion), ground (c, k);
    low, high (m,): the panels of shared unknowns that an image touches; wide: how many there are,
    in whole panels."""

    camera: np.ndarray
    slot: np.ndarray
    ground: np.ndarray
    low: np.ndarray
    high: np.ndarray
    wide: int


class Control(NamedTuple):
    """row (points,) of a point in the next, or -1; weight and residual (c, 3), 1/m^2 and m."""

    row: np.ndarray
    weight: np.ndarray
    residual: np.ndarray


class Scene(NamedTuple):
    """A problem at a state, as far as some of its points need it. points (n, 3) m; loss: its kind
    and width, on the length of an image residual in sigmas."""

    points: np.ndarray
    observations: Observations
    cameras: Cameras
    looked: Looked
    derivatives: Derivatives
    columns: Columns
    control: Control
    loss: tuple


class Storage(NamedTuple):
    """The matrix of the images: flat, see `block_offset`."""

    flat: np.ndarray
    stride: int
    neighbour_start: np.ndarray
    neighbour: np.ndarray


class Equations(NamedTuple):
    """Where the assembly adds to, all flat.

    Of images: storage, gradient and diagonal (m, d), cross (m, d, wide) to what is shared; of the
    shared: block (wide, wide, lower half), shared_gradient, shared_diagonal (wide,). Columns of
    images >= split go `extra` images later, so that two threads do not meet. matrix: whether more
    than the gradients is wanted.
    """

    storage: Storage
    gradient: np.ndarray
    diagonal: np.ndarray
    cross: np.ndarray
    block: np.ndarray
    shared_gradient: np.ndarray
    shared_diagonal: np.ndarray
    split: int
    extra: int
    matrix: bool


class Work(NamedTuple):
    """Room to work in: rays as seen, Jacobian rows by images, by points (where they are not those
    by the centre, negative; residuals before them) and by the shared, residuals of control, Y, Z,
    and the last two images' part of Y'Y and J'J. used: shared columns that any ray touches."""

    seen: np.ndarray
    jc: np.ndarray
    jp: np.ndarray
    jb: np.ndarray
    residual: np.ndarray
    y: np.ndarray
    z: np.ndarray
    stripe: np.ndarray
    own: np.ndarray
    used: int


class Step(NamedTuple):
    """A step of the unknowns, and what it does to each image.

    poses (m d,), shared (wide,); interior (m, 15), image (m, k), motion (m, 1, 6 (degree + 1)).
    """

    poses: np.ndarray
    shared: np.ndarray
    interior: np.ndarray
    image: np.ndarray
    motion: np.ndarray


class Rows(NamedTuple):
    """Where the Jacobian rows of a ray go: by the image, x from j0 and y from j1 on; by what is
    shared, from b0 and b1 on."""

    jc: np.ndarray
    j0: int
    j1: int
    jb: np.ndarray
    b0: int
    b1: int


class Strided(NamedTuple):
    """Two rows a ray, `row` numbers apart, from `at` on; the next ray is `apart` behind."""

    values: np.ndarray
    at: int
    apart: int
    row: int


# --- vectors of three and panels of four ------------------------------------------------------


@njit(**SCALAR)
def _less(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**SCALAR)
def _three(x, at):
    return x[at], x[at + U(1)], x[at + U(2)]


@njit(**SCALAR)
def panel(x, at):
    """The PANEL numbers from `at` on."""
    return x[at], x[at + U(1)], x[at + U(2)], x[at + U(3)]


@njit(**SCALAR)
def put(x, at, p):
    """x[at:at + PANEL] = p."""
    x[at] = p[0]
    x[at + U(1)] = p[1]
    x[at + U(2)] = p[2]
    x[at + U(3)] = p[3]


@njit(**SCALAR)
def plus(p, f, q):
    """p + f q."""
    return p[0] + f * q[0], p[1] + f * q[1], p[2] + f * q[2], p[3] + f * q[3]


@njit(**SCALAR)
def _two(f, p, g, q):
    """f p + g q."""
    return (
        f * p[0] + g * q[0],
        f * p[1] + g * q[1],
        f * p[2] + g * q[2],
        f * p[3] + g * q[3],
    )


@njit(**SCALAR)
def _add(out, at, f, p, g, q):
    """out[at:at + PANEL] += f p + g q."""
    put(out, at, plus(plus(panel(out, at), f, p), g, q))


@njit(**SCALAR)
def zeros():
    """A panel of zeros."""
    return 0.0, 0.0, 0.0, 0.0


# --- one ray ----------------------------------------------------------------------------------


@njit(**SCALAR)
def _robust(loss, s):
    """Cost rho(s) and root of the weight rho'(s); s = |r|^2.

    The weight alone makes the step (iteratively reweighted least squares): slower than with the
    second derivative, but it never overshoots, and a point with two outlying rays stays put.
    """
    k2 = loss.width * loss.width
    if loss.kind == HUBER:
        if s <= k2:
            return s, 1.0
        length = np.sqrt(s)
        return 2.0 * loss.width * length - k2, np.sqrt(loss.width / length)
    return k2 * np.log1p(s / k2), 1.0 / np.sqrt(1.0 + s / k2)


@njit(**SCALAR)
def _times_rotation(pose, i, x):
    """R x of image i."""
    return (
        pose[i, U(3)] * x[0] + pose[i, U(4)] * x[1] + pose[i, U(5)] * x[2],
        pose[i, U(6)] * x[0] + pose[i, U(7)] * x[1] + pose[i, U(8)] * x[2],
        pose[i, U(9)] * x[0] + pose[i, U(10)] * x[1] + pose[i, U(11)] * x[2],
    )


@njit(**SCALAR)
def _before_rotation(pose, i, g):
    """The row g R of image i."""
    return (
        g[0] * pose[i, U(3)] + g[1] * pose[i, U(6)] + g[2] * pose[i, U(9)],
        g[0] * pose[i, U(4)] + g[1] * pose[i, U(7)] + g[2] * pose[i, U(10)],
        g[0] * pose[i, U(5)] + g[1] * pose[i, U(8)] + g[2] * pose[i, U(11)],
    )


@njit(**SCALAR)
def _course(s, motion, i, k, what):
    """Centre (what 0) or turn (3) of image i at the place s of a row, and its slope by s.

    motion: (images, k, 6 (degree + 1)), coefficients of s^0 first, the centre in the camera frame.
    """
    n = U(motion.shape[2] - 6) + what
    slope = (0.0, 0.0, 0.0)
    x = motion[i, k, n], motion[i, k, n + U(1)], motion[i, k, n + U(2)]
    while n > what:
        n -= U(6)
        slope = slope[0] * s + x[0], slope[1] * s + x[1], slope[2] * s + x[2]
        x = (
            x[0] * s + motion[i, k, n],
            x[1] * s + motion[i, k, n + U(1)],
            x[2] * s + motion[i, k, n + U(2)],
        )
    return x, slope


@njit(**SCALAR)
def see(first, m, point, observations, cameras, looked, loss, seen):
    """Where images see a point, and how far that is from the observations first..first + m.

    point: (3). Fills `seen` (m, SEEN); its third number is not positive where the point is behind
    the camera. Returns the cost.

    While the rows are read the camera moves: the row of the modelled pixel decides where the
    camera is, and the camera where the pixel is. A step of Newton from the row last found finds
    both; it is repeated until it is short. Derivatives by what moves the camera are taken at the
    row found; at the measured one they would go with its error.
    """
    moves = cameras.motion.shape[2] > 0
    cost = 0.0
    for _ in range(PASSES if moves else 1):
        cost, missed = _see_once(first, m, point, observations, cameras, looked, loss, seen)
        if not missed > looked.near:
            break
    if looked.modelled.shape[0] > 0:
        for k in range(m):
            o, at = U(first + k), U(k * SEEN)
            if seen[at + U(2)] > 0.0:
                looked.modelled[o, U(0)] = seen[at + U(29)]
                looked.modelled[o, U(1)] = seen[at + U(30)]
                looked.modelled[o, U(2)] = seen[at + U(4)]
                looked.modelled[o, U(3)] = seen[at + U(5)]
    return cost


@njit(**SCALAR)
def _see_once(first, m, point, observations, cameras, looked, loss, seen):
    """One step of `see`, and by how much rows were missed, px.

    Each of the three loops is short: a ray is a chain of operations that wait for each other,
    and only if the next rays are near does the processor work on several at once.
    """
    pose, interior, row_of = cameras.pose, cameras.interior, cameras.row_of
    moves, turns = cameras.motion.shape[2] > 0, cameras.turns
    shift = looked.shift
    farthest = 0.0
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(observations.image[o])
        centre = pose[i, U(0)], pose[i, U(1)], pose[i, U(2)]
        x = _times_rotation(pose, i, _less(point, centre))
        if moves:
            row = looked.row[o]
            s = row_of[i, U(1)] * row + row_of[i, U(2)]
            c, dc = _course(s, cameras.motion, i, U(0), U(0))
            x = _less(x, c)
            put(seen, at, (x[0], x[1], x[2], row))
            if turns:
                t, dt = _course(s, cameras.motion, i, U(0), U(3))
                put(seen, at + U(16), (t[0], t[1], t[2], s))
                # Slope of X before its turn: -dc/ds + X x dtheta/ds.
                slope = _less(cross(x, dt), dc)
                sine, cosine = sines(t)
                put(seen, at + U(24), (slope[0], slope[1], slope[2], sine))
                seen[at + U(28)] = cosine
                x = rotated(sine, cosine, (-t[0], -t[1], -t[2]), x)
            else:
                put(seen, at + U(16), (0.0, 0.0, 0.0, s))
                put(seen, at + U(24), (-dc[0], -dc[1], -dc[2], 0.0))
        else:
            put(seen, at, (x[0], x[1], x[2], 0.0))
        put(seen, at + U(4), (x[0], x[1], x[2], 0.0))
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(observations.image[o])
        z = seen[at + U(6)]
        iz = 1.0 / z if z > 0.0 else 0.0
        u, v = seen[at + U(4)] * iz, seen[at + U(5)] * iz
        a, b, au, av, bu, bv = distort_normalised(u, v, interior, i, cameras.radials)
        iz *= interior[i, U(0)]
        g0, g1, h0, h1 = iz * au, iz * av, iz * bu, iz * bv
        put(seen, at + U(4), (u, v, a, b))
        put(seen, at + U(8), (g0, g1, -(g0 * u + g1 * v), h0))
        put(seen, at + U(12), (h1, -(h0 * u + h1 * v), iz, 0.0))
    cost = 0.0
    for k in range(m):
        o, at = U(first + k), U(k * SEEN)
        i = U(observations.image[o])
        if not seen[at + U(14)] > 0.0:
            seen[at + U(2)] = -1.0
            continue
        f = interior[i, U(0)]
        mx = interior[i, U(1)] + f * seen[at + U(6)]
        my = interior[i, U(2)] + f * seen[at + U(7)]
        g, h = _three(seen, at + U(8)), _three(seen, at + U(11))
        if shift.shape[0] > 0:
            e = o - U(looked.base)
            mx += shift[e, U(0)]
            my += shift[e, U(1)]
        s00, s01, s10, s11 = 1.0, 0.0, 0.0, 1.0
        if shift.shape[1] > 2:
            e = o - U(looked.base)
            s00, s01, s10, s11 = shift[e, U(2)], shift[e, U(3)], shift[e, U(4)], shift[e, U(5)]
            # The shift is that of the pixel modelled last time: one step of Newton from there.
            x, y = looked.modelled[o, U(0)], looked.modelled[o, U(1)]
            mx, my = x + s00 * (mx - x) + s01 * (my - y), y + s10 * (mx - x) + s11 * (my - y)
            g, h = _rows_before(s00, s01, s10, s11, g, h)
            put(seen, at + U(20), (s00, s01, s10, s11))
        if moves:
            row = seen[at + U(3)]
            t0, t1, t2, s = panel(seen, at + U(16))
            slope = _three(seen, at + U(24))
            if turns:
                t, sine, cosine = (t0, t1, t2), seen[at + U(27)], seen[at + U(28)]
                g, h = rotated(sine, cosine, t, g), rotated(sine, cosine, t, h)
            factor = row_of[i, U(1)]
            slope_x, slope_y = factor * dot(g, slope), factor * dot(h, slope)
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
            g, h = _rows_before(k00, k01, k10, k11, g, h)
            seen[at + U(19)] = s + factor * missed
            looked.row[o] = row + missed
            farthest = max(farthest, abs(missed))
            top = k00 * s00 + k01 * s10, k00 * s01 + k01 * s11
            put(seen, at + U(20), (top[0], top[1], k10 * s00 + k11 * s10, k10 * s01 + k11 * s11))
        if looked.modelled.shape[0] > 0:
            seen[at + U(29)], seen[at + U(30)] = mx, my
        root = observations.weight[o if observations.weight.shape[0] > 1 else U(0)]
        rx = root * (observations.xy[o, U(0)] - mx)
        ry = root * (observations.xy[o, U(1)] - my)
        square = rx * rx + ry * ry
        if loss.kind != SQUARES:
            square, soft = _robust(loss, square)
            root *= soft
            rx *= soft
            ry *= soft
        cost += square
        seen[at + U(3)] = root
        put(seen, at + U(8), (root * g[0], root * g[1], root * g[2], root * h[0]))
        put(seen, at + U(12), (root * h[1], root * h[2], rx, ry))
    return cost, farthest


@njit(**SCALAR)
def _rows_before(k00, k01, k10, k11, g, h):
    """The rows g and h, after the matrix k was put before them."""
    return (
        (k00 * g[0] + k01 * h[0], k00 * g[1] + k01 * h[1], k00 * g[2] + k01 * h[2]),
        (k10 * g[0] + k11 * h[0], k10 * g[1] + k11 * h[1], k10 * g[2] + k11 * h[2]),
    )


@njit(**SCALAR)
def _slope(seen, at):
    """Of a camera that moves or an effect on the image: matrix (4) before the pixel's derivatives.

    What moves the pixel moves its row, and the row moves the camera; and effects look at where
    the pixel is. `seen` has it in the derivatives by X, Y, Z already.
    """
    return panel(seen, at + U(20))


@njit(**SCALAR)
def _add_column(column, gx, gy, to):
    """Add to a shared column, or to the image's own unknown 4 - column where it is <= -2."""
    if column >= 0:
        to.jb[to.b0 + U(column)] += gx
        to.jb[to.b1 + U(column)] += gy
    elif column <= -2:
        to.jc[to.j0 + U(4 - column)] += gx
        to.jc[to.j1 + U(4 - column)] += gy


@njit(**SCALAR)
def jacobian_rows(i, e, seen, at, scene, span, d, to):
    """Weighted Jacobian rows of a ray that `see` has left in `seen` at `at`.

    i: image, e: row of the observation in the derivatives of the image. span: the panels of shared
    columns to fill. By the point: the image's first three, negative. A ray from behind has rows of
    zeros.
    """
    jc, jb = to.jc, to.jb
    cameras, derivatives, columns = scene.cameras, scene.derivatives, scene.columns
    low, high = span
    for c in range(low, high, PANEL):
        put(jb, to.b0 + U(c), zeros())
        put(jb, to.b1 + U(c), zeros())
    x = _three(seen, at)
    ahead = x[2] > 0.0
    for c in range(6 if ahead else 0, d):
        jc[to.j0 + U(c)] = 0.0
        jc[to.j1 + U(c)] = 0.0
    if not ahead:
        return
    root = seen[at + U(3)]
    u, v, a, b = panel(seen, at + U(4))
    g, h = _three(seen, at + U(8)), _three(seen, at + U(11))
    p, q = _before_rotation(cameras.pose, i, g), _before_rotation(cameras.pose, i, h)
    # g . (dr x X) = dr . (X x g)
    by_turn, by_turn_y = cross(x, g), cross(x, h)
    jc[to.j0], jc[to.j0 + U(1)], jc[to.j0 + U(2)] = -p[0], -p[1], -p[2]
    jc[to.j0 + U(3)], jc[to.j0 + U(4)], jc[to.j0 + U(5)] = by_turn
    jc[to.j1], jc[to.j1 + U(1)], jc[to.j1 + U(2)] = -q[0], -q[1], -q[2]
    jc[to.j1 + U(3)], jc[to.j1 + U(4)], jc[to.j1 + U(5)] = by_turn_y

    f = cameras.interior[i, U(0)]
    own = derivatives.interior.shape[2] > 0
    inner = at + U(INNER)
    if high > low or own:
        interior_derivatives_at(u, v, a, b, f, 8 if own else cameras.radials, seen, inner)
        for k in range(7 + cameras.radials):
            column = columns.camera[i, U(k)]
            if column >= 0:
                jb[to.b0 + U(column)] = root * seen[inner + U(2 * k)]
                jb[to.b1 + U(column)] = root * seen[inner + U(2 * k + 1)]
    slot = U(0)
    for n in range(derivatives.interior.shape[2]):
        dx, dy = 0.0, 0.0
        for k in range(15):
            change = derivatives.interior[i, U(k), U(n)]
            dx += seen[inner + U(2 * k)] * change
            dy += seen[inner + U(2 * k + 1)] * change
        _add_column(columns.slot[i, slot], root * dx, root * dy, to)
        slot += U(1)
    for n in range(derivatives.image.shape[2]):
        dx = root * derivatives.image[e, U(0), U(n)]
        dy = root * derivatives.image[e, U(1), U(n)]
        _add_column(columns.slot[i, slot], dx, dy, to)
        slot += U(1)
    moves = cameras.motion.shape[2] > 0
    if not moves and derivatives.image.shape[2] == 0:
        return
    k00, k01, k10, k11 = _slope(seen, at)
    if derivatives.sight.shape[0] > 0:
        for c in range(6):
            dx = root * derivatives.sight[e, U(0), U(c)]
            dy = root * derivatives.sight[e, U(1), U(c)]
            jc[to.j0 + U(c)] += k00 * dx + k01 * dy
            jc[to.j1 + U(c)] += k10 * dx + k11 * dy
    for c in range(low, high, PANEL):
        by_x, by_y = panel(jb, to.b0 + U(c)), panel(jb, to.b1 + U(c))
        put(jb, to.b0 + U(c), _two(k00, by_x, k01, by_y))
        put(jb, to.b1 + U(c), _two(k10, by_x, k11, by_y))
    for c in range(6, d):
        dx, dy = jc[to.j0 + U(c)], jc[to.j1 + U(c)]
        jc[to.j0 + U(c)], jc[to.j1 + U(c)] = k00 * dx + k01 * dy, k10 * dx + k11 * dy
    if not moves:
        return
    t = _three(seen, at + U(16))
    place = seen[at + U(19)]
    for n in range(derivatives.motion.shape[1]):
        c, _ = _course(place, derivatives.motion, i, U(n), U(0))
        away = (-c[0], -c[1], -c[2])
        if cameras.turns:
            theta, _ = _course(place, derivatives.motion, i, U(n), U(3))
            away = _less(cross(x, left_jacobian(t, theta)), c)
        _add_column(columns.slot[i, slot], dot(g, away), dot(h, away), to)
        slot += U(1)


@njit(**SCALAR)
def point_rows(i, e, seen, at, scene):
    """Weighted Jacobian rows of a ray by its point, where effects on the image see the point.

    i, e, seen, at: as for `jacobian_rows`.
    """
    p = _before_rotation(scene.cameras.pose, i, _three(seen, at + U(8)))
    q = _before_rotation(scene.cameras.pose, i, _three(seen, at + U(11)))
    if not seen[at + U(2)] > 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    k00, k01, k10, k11 = _slope(seen, at)
    root, sight = seen[at + U(3)], scene.derivatives.sight
    x = sight[e, U(0), U(6)], sight[e, U(0), U(7)], sight[e, U(0), U(8)]
    y = sight[e, U(1), U(6)], sight[e, U(1), U(7)], sight[e, U(1), U(8)]
    x, y = _rows_before(k00, k01, k10, k11, x, y)
    return (
        (p[0] + root * x[0], p[1] + root * x[1], p[2] + root * x[2]),
        (q[0] + root * y[0], q[1] + root * y[1], q[2] + root * y[2]),
    )


# --- residuals --------------------------------------------------------------------------------


@compiled(vectorised=True, **KERNEL)
def look(first, last, scene, out, seen):
    """Sum of rho over the rays of points first..last, and how many are behind a camera.

    out (n, 2), or (0, 2): receives the residuals times the root of their weight, NaN of those
    behind. seen: (most rays of a point * SEEN,) to work in.
    """
    observations = scene.observations
    total = 0.0
    behind = 0
    for p in range(first, last):
        start = observations.start[p]
        m = observations.start[p + 1] - start
        point = scene.points[p, 0], scene.points[p, 1], scene.points[p, 2]
        total += see(start, m, point, observations, scene.cameras, scene.looked, scene.loss, seen)
        for k in range(m):
            at = U(k * SEEN)
            ahead = seen[at + U(2)] > 0.0
            behind += 0 if ahead else 1
            if out.shape[0] > 0:
                out[start + k, 0] = seen[at + U(14)] if ahead else np.nan
                out[start + k, 1] = seen[at + U(15)] if ahead else np.nan
    return total, behind


# --- parts of the assembly --------------------------------------------------------------------


@njit(**SCALAR)
def _reduced(x, at, a, y, n, q):
    """x[at:at + PANEL] - a0 y[n:] - a1 y[n + q:] - a2 y[n + 2 q:]."""
    left = plus(panel(x, at), -a[0], panel(y, n))
    left = plus(left, -a[1], panel(y, q + n))
    return plus(left, -a[2], panel(y, q + q + n))


@njit(**SCALAR)
def _by_point(p, x, rays):
    """-P'x of a point: three panels, one a coordinate; p, x: `Strided`."""
    w0, w1, w2 = zeros(), zeros(), zeros()
    n, at = p.at, x.at
    for _ in range(rays):
        for half in range(2):
            j = n + U(half) * p.row
            row = panel(x.values, at + U(half) * x.row)
            w0 = plus(w0, p.values[j], row)
            w1 = plus(w1, p.values[j + U(1)], row)
            w2 = plus(w2, p.values[j + U(2)], row)
        n += p.apart
        at += x.apart
    return w0, w1, w2


@njit(**SCALAR)
def _gram(x, start, rows, width, span, columns, out, to):
    """out[c, r] = sum of x[:, at + c] x[:, r]: rows r of a span of `columns` = (at, how many).

    x: (rows, width) from start on; out: rows of `width`, from `to` on. The span begins at a
    multiple of PANEL. Six columns are made at once, the last six whole. The sums stand apart and
    not in panels: those would cost the compiler's vectoriser 60 % of the whole assembly.
    """
    at, count = columns
    first, last = span
    for c in range(0, count, 6):
        for r in range(first, last, PANEL):
            a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
            b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
            c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
            d0, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
            e0, e1, e2, e3 = 0.0, 0.0, 0.0, 0.0
            f0, f1, f2, f3 = 0.0, 0.0, 0.0, 0.0
            row = start
            for _ in range(rows):
                x0, x1, x2, x3 = panel(x, row + U(r))
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
            put(out, n, (a0, a1, a2, a3))
            put(out, n + U(width), (b0, b1, b2, b3))
            put(out, n + U(2 * width), (c0, c1, c2, c3))
            put(out, n + U(3 * width), (d0, d1, d2, d3))
            put(out, n + U(4 * width), (e0, e1, e2, e3))
            put(out, n + U(5 * width), (f0, f1, f2, f3))


@njit(**SCALAR)
def _subtract(out, at, x, n):
    """out[at:at + 6] -= x[n:n + 6]."""
    s0, s1, s2 = out[at] - x[n], out[at + U(1)] - x[n + U(1)], out[at + U(2)] - x[n + U(2)]
    s3, s4 = out[at + U(3)] - x[n + U(3)], out[at + U(4)] - x[n + U(4)]
    s5 = out[at + U(5)] - x[n + U(5)]
    put(out, at, (s0, s1, s2, s3))
    out[at + U(4)] = s4
    out[at + U(5)] = s5


@njit(**SCALAR)
def invert_cholesky(v):
    """Inverse of the lower Cholesky factor of (00 10 11 20 21 22), in the same order.

    A direction without information (rays that are parallel) gets a zero: it does not move.
    Returns also how many such directions there are.
    """
    v0, v1, v2, v3, v4, v5 = v
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
def block_offset(i, j, t, d, storage):
    """Where the block (rows of image j, columns of image i <= j) begins in the flat matrix.

    Entry (r, c) of the block lies at offset + c stride + r. Band: LAPACK lower storage with
    leading dimension stride + 1, t is the column image. Sparse: dense d x d blocks in the order
    of each image's sorted neighbours (itself first).
    """
    if storage.neighbour.shape[0] == 0:
        return U(t * d * (storage.stride + 1) + (j - i) * d)
    lower = storage.neighbour_start[i]
    upper = storage.neighbour_start[i + 1] - 1
    while lower < upper:
        middle = (lower + upper) // 2
        if storage.neighbour[middle] < j:
            lower = middle + 1
        else:
            upper = middle
    return U(lower * d * d)


@njit(**SCALAR)
def same_images(img, start, m, following):
    """Whether the next point, of `following` rays, is seen by the same m images."""
    if m != following:
        return False
    for k in range(m):
        if img[U(start + k)] != img[U(start + m + k)]:
            return False
    return True


def make_assemble(d, sighted=False):
    """The assembly for images with `d` unknowns (6 and the effects of their own).

    sighted: effects on the image see object points; known when it is compiled, it costs the
    others nothing.
    """
    # A ray's row in jc: its residual, then d unknowns, in whole panels.
    row = -(-(d + 1) // PANEL) * PANEL
    sixes = -(-d // 6) * 6  # as many columns as _gram makes
    # Behind Y's last image its last panel runs over, and n needs a column.
    behind_y = max(-(-d // PANEL) * PANEL - d, 1)

    @compiled(vectorised=True, **KERNEL)
    def core(first, last, scene, damping, equations, totals, work):
        observations, columns, control = scene.observations, scene.columns, scene.control
        img = observations.image
        d_ground = scene.derivatives.ground
        seen, jc, jb, res, y, z = work.seen, work.jc, work.jb, work.residual, work.y, work.z
        jp = work.jp
        stripe, own = work.stripe, work.own
        storage, matrix = equations.storage, equations.storage.flat
        wide = columns.wide
        q = U(wide)
        ray, apart = U(2 * row), U(GROUP * 2 * row)  # from a point's ray to the next, in jc
        cost = 0.0
        behind = 0
        waiting = 0
        for p in range(first, last):
            point = scene.points[p, 0], scene.points[p, 1], scene.points[p, 2]
            start = observations.start[p]
            m = observations.start[p + 1] - start
            # No literal 0: what takes it would be compiled once more for that.
            lo, hi = wide, np.int64(0)
            for k in range(m):
                i = U(img[U(start + k)])
                lo, hi = min(lo, columns.low[i]), max(hi, columns.high[i])
            given = control.row[p]
            if given >= 0:
                for s in range(d_ground.shape[2]):
                    c = columns.ground[given, s]
                    if c >= 0:
                        lo, hi = min(lo, c // PANEL * PANEL), max(hi, c // PANEL * PANEL + PANEL)

            cost += see(
                start, m, point, observations, scene.cameras, scene.looked, scene.loss, seen
            )
            j_first = U(waiting) * ray
            for k in range(m):
                o = U(start + k)
                at = U(k * SEEN)
                j0 = j_first + U(k) * apart
                j1 = j0 + U(row)
                b0 = U(2 * k) * q
                jacobian_rows(
                    U(img[o]), o - U(scene.looked.base), seen, at, scene, (lo, hi), d,
                    Rows(jc, j0 + U(1), j1 + U(1), jb, b0, b0 + q),
                )  # fmt: skip
                ahead = seen[at + U(2)] > 0.0
                behind += 0 if ahead else 1
                jc[j0] = seen[at + U(14)] if ahead else 0.0
                jc[j1] = seen[at + U(15)] if ahead else 0.0
                if sighted:
                    a, b = point_rows(U(img[o]), o - U(scene.looked.base), seen, at, scene)
                    put(jp, U(8 * k), (jc[j0], -a[0], -a[1], -a[2]))
                    put(jp, U(8 * k + 4), (jc[j1], -b[0], -b[1], -b[2]))

            # With the residual before the unknowns one panel gives P'e and V.
            if sighted:
                by_p = Strided(jp, U(1), U(8), U(4))
                w0, w1, w2 = _by_point(by_p, Strided(jp, U(0), U(8), U(4)), m)
            else:
                by_p = Strided(jc, j_first + U(1), apart, U(row))
                w0, w1, w2 = _by_point(by_p, Strided(jc, j_first, apart, U(row)), m)
            gp0, gp1, gp2 = -w0[0], -w1[0], -w2[0]
            v0, v1, v2, v3, v4, v5 = w0[1], w1[1], w1[2], w2[1], w2[2], w2[3]
            c0, c1, c2 = 0.0, 0.0, 0.0
            if given >= 0:
                # Three more rows, one a coordinate: by the point a unit vector, by what is
                # shared what the effects on ground control say.
                c0 = np.sqrt(control.weight[given, 0])
                c1 = np.sqrt(control.weight[given, 1])
                c2 = np.sqrt(control.weight[given, 2])
                v0 += c0 * c0
                v2 += c1 * c1
                v5 += c2 * c2
                for axis in range(3):
                    root = np.sqrt(control.weight[given, axis])
                    res[U(axis)] = root * control.residual[given, axis]
                    b0 = U(2 * m + axis) * q
                    for c in range(lo, hi):
                        jb[b0 + U(c)] = 0.0
                    for s in range(d_ground.shape[2]):
                        c = columns.ground[given, s]
                        if c >= 0:
                            jb[b0 + U(c)] += root * d_ground[given, axis, s]
                gp0 += c0 * res[U(0)]
                gp1 += c1 * res[U(1)]
                gp2 += c2 * res[U(2)]
            grown = 1.0 + damping
            i0, i1, i2, i3, i4, i5, weak = invert_cholesky(
                (v0 * grown, v1, v2 * grown, v3, v4, v5 * grown)
            )
            totals[2] += weak
            right = i0 * gp0, i1 * gp0 + i2 * gp1, i3 * gp0 + i4 * gp1 + i5 * gp2
            for x in range(lo, hi if equations.matrix else lo, PANEL):
                n = U(x)
                w0, w1, w2 = _by_point(by_p, Strided(jb, n, q + q, q), m)
                if given >= 0:
                    b0 = U(2 * m) * q + n
                    w0 = plus(w0, -c0, panel(jb, b0))
                    w1 = plus(w1, -c1, panel(jb, b0 + q))
                    w2 = plus(w2, -c2, panel(jb, b0 + q + q))
                put(z, n, plus(zeros(), -i0, w0))
                put(z, q + n, _two(-i1, w0, -i2, w1))
                put(z, q + q + n, plus(_two(-i3, w0, -i4, w1), -i5, w2))

            # Y of this point: three rows of d m columns, and n as one more.
            n_y = U(-(-(d * m + behind_y) // PANEL) * PANEL)
            y_first = U(3 * waiting) * n_y
            for k in range(m):
                j0 = j_first + U(k) * apart + U(1)
                j1 = j0 + U(row)
                i = img[U(start + k)]
                t = i if i < equations.split else i + equations.extra
                # T of both rows: P L^-T
                if sighted:
                    a, b = _three(jp, U(8 * k + 1)), _three(jp, U(8 * k + 5))
                else:
                    a, b = _three(jc, j0), _three(jc, j1)
                a = -i0 * a[0], -i1 * a[0] - i2 * a[1], -i3 * a[0] - i4 * a[1] - i5 * a[2]
                b = -i0 * b[0], -i1 * b[0] - i2 * b[1], -i3 * b[0] - i4 * b[1] - i5 * b[2]
                e0 = jc[j0 - U(1)] - dot(a, right)
                e1 = jc[j1 - U(1)] - dot(b, right)
                b0 = U(2 * k) * q
                b1 = b0 + q
                if not equations.matrix:
                    for r in range(d):
                        equations.gradient[U(t * d + r)] += jc[j0 + U(r)] * e0 + jc[j1 + U(r)] * e1
                    for x in range(lo, hi, PANEL):
                        s, u = panel(jb, b0 + U(x)), panel(jb, b1 + U(x))
                        _add(equations.shared_gradient, U(x), e0, s, e1, u)
                    continue
                # The last panel runs into the next image's columns, which are filled after it.
                for x in range(0, d, PANEL):
                    f, g = panel(jc, j0 + U(x)), panel(jc, j1 + U(x))
                    n = y_first + U(k * d + x)
                    put(y, n, _two(a[0], f, b[0], g))
                    put(y, n + n_y, _two(a[1], f, b[1], g))
                    put(y, n + n_y + n_y, _two(a[2], f, b[2], g))
                for x in range(lo, hi, PANEL):
                    n = U(x)
                    s = _reduced(jb, b0 + n, a, z, n, q)
                    u = _reduced(jb, b1 + n, b, z, n, q)
                    at = U(t * d) * q + n
                    for r in range(d):
                        _add(equations.cross, at, jc[j0 + U(r)], s, jc[j1 + U(r)], u)
                        at += q
                    for r in range(x, min(hi, work.used)):
                        _add(equations.block, U(r) * q + n, jb[b0 + U(r)], s, jb[b1 + U(r)], u)
                    s, u = panel(jb, b0 + n), panel(jb, b1 + n)
                    _add(equations.shared_gradient, n, e0, s, e1, u)
                    s = s[0] * s[0], s[1] * s[1], s[2] * s[2], s[3] * s[3]
                    u = u[0] * u[0], u[1] * u[1], u[2] * u[2], u[3] * u[3]
                    _add(equations.shared_diagonal, n, 1.0, s, 1.0, u)
            if given >= 0 and d_ground.shape[2] > 0:
                for axis in range(3):
                    root = np.sqrt(control.weight[given, axis])
                    a = (0.0, 0.0, i5 * root)
                    if axis == 0:
                        a = (i0 * root, i1 * root, i3 * root)
                    elif axis == 1:
                        a = (0.0, i2 * root, i4 * root)
                    e0 = res[U(axis)] - dot(a, right)
                    b0 = U(2 * m + axis) * q
                    for x in range(lo, hi if equations.matrix else lo, PANEL):
                        n = U(x)
                        s = _reduced(jb, b0 + n, a, z, n, q)
                        for r in range(x, hi):
                            _add(equations.block, U(r) * q + n, jb[b0 + U(r)], s, 0.0, s)
                    for r in range(lo, hi):
                        f = jb[b0 + U(r)]
                        equations.shared_gradient[U(r)] += f * e0
                        if equations.matrix:
                            equations.shared_diagonal[U(r)] += f * f
            if not equations.matrix:
                continue
            n = y_first + U(d * m)
            y[n] = right[0]
            y[n + n_y] = right[1]
            y[n + n_y + n_y] = right[2]
            waiting += 1
            if (
                waiting < GROUP
                and p + 1 < last
                and same_images(img, start, m, observations.start[p + 2] - start - m)
            ):
                continue

            # J'J and Y'Y of all points that wait, image by image: first gathered, one image
            # later added to the matrix. What has just been written in fours cannot be read in
            # sixes before it has reached the cache.
            for turn in range(m + 1):
                if turn < m:
                    k = turn
                    _gram(
                        y, U(0), 3 * waiting, n_y, (k * d // PANEL * PANEL, n_y), (k * d, d),
                        stripe, U((k & 1) * sixes) * n_y,
                    )  # fmt: skip
                    _gram(
                        jc, U(k) * apart, 2 * waiting, row, (0, row), (1, d), own,
                        U((k & 1) * sixes * row),
                    )  # fmt: skip
                if turn == 0:
                    continue
                k = turn - 1
                i = img[U(start + k)]
                t = i if i < equations.split else i + equations.extra
                ys = U((k & 1) * sixes) * n_y
                js = U((k & 1) * sixes * row)
                at = U(t * d)
                offset = block_offset(i, i, t, d, storage)
                for c in range(d):
                    equations.gradient[at + U(c)] += own[js] - stripe[ys + U(d * m)]
                    equations.diagonal[at + U(c)] += own[js + U(1 + c)]
                    for r in range(c, d):
                        matrix[offset + U(r)] += own[js + U(1 + r)] - stripe[ys + U(k * d + r)]
                    js += U(row)
                    ys += n_y
                    offset += U(storage.stride)
                for n in range(k + 1, m):
                    j = img[U(start + n)]
                    offset = block_offset(i, j, t, d, storage)
                    at = U((k & 1) * sixes) * n_y + U(n * d)
                    for _ in range(d):
                        _subtract(matrix, offset, stripe, at)
                        for r in range(6, d):
                            matrix[offset + U(r)] -= stripe[at + U(r)]
                        at += n_y
                        offset += U(storage.stride)
            waiting = 0
        totals[0] += cost
        totals[1] += behind

    def assemble(first, last, scene, damping, equations, totals, longest):
        """Add the reduced normal equations of points first..last.

        totals (3,): cost, behind, weak directions. longest: the most rays of a point.
        """
        columns, wide = scene.columns, scene.columns.wide
        # The last panel's columns that no ray touches are left out where it is easy.
        touched = (columns.camera, columns.slot, columns.ground)
        n_y = -(-(d * longest + behind_y) // PANEL) * PANEL
        work = Work(
            seen=np.zeros(longest * SEEN),
            jc=np.zeros(longest * GROUP * 2 * row + PANEL),
            jp=np.zeros(longest * 8 if sighted else 0),
            jb=np.zeros((2 * longest + 3) * wide),
            residual=np.zeros(3),
            y=np.zeros(GROUP * 3 * n_y + 2 * sixes),
            z=np.zeros(3 * wide),
            stripe=np.zeros(2 * sixes * n_y),
            own=np.zeros(2 * sixes * row),
            used=1 + max(int(some.max(initial=-1)) for some in touched),
        )
        core(first, last, scene, damping, equations, totals, work)

    assemble.core = core
    return assemble


def make_substitute(d, sighted=False):
    """The way back to the points for images with `d` unknowns; sighted: as of `make_assemble`."""

    @compiled(vectorised=True, **KERNEL)
    def core(first, last, scene, damping, step, moved, totals, seen):
        observations, columns, control = scene.observations, scene.columns, scene.control
        d_ground = scene.derivatives.ground
        moves = scene.cameras.motion.shape[2] > 0
        radials = scene.cameras.radials if scene.derivatives.interior.shape[2] == 0 else 8
        down = 0.0
        square = 0.0
        for p in range(first, last):
            point = scene.points[p, 0], scene.points[p, 1], scene.points[p, 2]
            v0, v1, v2, v3, v4, v5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            g0, g1, g2 = 0.0, 0.0, 0.0
            t0, t1, t2 = 0.0, 0.0, 0.0
            start = observations.start[p]
            m = observations.start[p + 1] - start
            see(start, m, point, observations, scene.cameras, scene.looked, scene.loss, seen)
            for k in range(m):
                o, at = U(start + k), U(k * SEEN)
                i = U(observations.image[o])
                if not seen[at + U(2)] > 0.0:
                    continue
                # By how much the step moves the pixel, weighted: by the interior and the image
                # effects, then by centre, turn and motion, by way of X. Jacobian rows times the
                # step would be shorter here, and a fifth slower.
                x = _three(seen, at)
                root = seen[at + U(3)]
                f = scene.cameras.interior[i, U(0)]
                sx, sy = interior_change(panel(seen, at + U(4)), f, radials, step.interior, i)
                for n in range(step.image.shape[1]):
                    e = o - U(scene.looked.base)
                    sx += scene.derivatives.image[e, U(0), U(n)] * step.image[i, U(n)]
                    sy += scene.derivatives.image[e, U(1), U(n)] * step.image[i, U(n)]
                sx *= root
                sy *= root
                n = i * U(d)
                shift, turn = _three(step.poses, n), _three(step.poses, n + U(3))
                if moves or step.image.shape[1] > 0:
                    k00, k01, k10, k11 = _slope(seen, at)
                    sx, sy = k00 * sx + k01 * sy, k10 * sx + k11 * sy
                away = (0.0, 0.0, 0.0)
                if moves:
                    away, _ = _course(seen[at + U(19)], step.motion, i, U(0), U(0))
                    if scene.cameras.turns:
                        theta, _ = _course(seen[at + U(19)], step.motion, i, U(0), U(3))
                        turn = _less(turn, left_jacobian(_three(seen, at + U(16)), theta))
                away = _less(cross(turn, x), away)
                g, h = _three(seen, at + U(8)), _three(seen, at + U(11))
                e0, e1 = seen[at + U(14)], seen[at + U(15)]
                a0, a1, a2 = _before_rotation(scene.cameras.pose, i, g)
                sx += dot(g, away) - dot((a0, a1, a2), shift)
                c0, c1, c2 = _before_rotation(scene.cameras.pose, i, h)
                sy += dot(h, away) - dot((c0, c1, c2), shift)
                if sighted:
                    e = o - U(scene.looked.base)
                    dx, dy = 0.0, 0.0
                    for c in range(6):
                        dx += scene.derivatives.sight[e, U(0), U(c)] * step.poses[n + U(c)]
                        dy += scene.derivatives.sight[e, U(1), U(c)] * step.poses[n + U(c)]
                    k00, k01, k10, k11 = _slope(seen, at)
                    sx += root * (k00 * dx + k01 * dy)
                    sy += root * (k10 * dx + k11 * dy)
                    (a0, a1, a2), (c0, c1, c2) = point_rows(i, e, seen, at, scene)
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
            given = control.row[p]
            if given >= 0:
                w0 = control.weight[given, 0]
                w1 = control.weight[given, 1]
                w2 = control.weight[given, 2]
                e0 = control.residual[given, 0]
                e1 = control.residual[given, 1]
                e2 = control.residual[given, 2]
                v0 += w0
                v2 += w1
                v5 += w2
                g0 += w0 * e0
                g1 += w1 * e1
                g2 += w2 * e2
                for s in range(d_ground.shape[2]):
                    c = columns.ground[given, s]
                    if c >= 0:
                        e0 -= d_ground[given, 0, s] * step.shared[c]
                        e1 -= d_ground[given, 1, s] * step.shared[c]
                        e2 -= d_ground[given, 2, s] * step.shared[c]
                t0 += w0 * e0
                t1 += w1 * e1
                t2 += w2 * e2
            grown = 1.0 + damping
            i0, i1, i2, i3, i4, i5, _ = invert_cholesky(
                (v0 * grown, v1, v2 * grown, v3, v4, v5 * grown)
            )
            n0 = i0 * t0
            n1 = i1 * t0 + i2 * t1
            n2 = i3 * t0 + i4 * t1 + i5 * t2
            s0 = i0 * n0 + i1 * n1 + i3 * n2
            s1 = i2 * n1 + i4 * n2
            s2 = i5 * n2
            moved[p, 0] = point[0] + s0
            moved[p, 1] = point[1] + s1
            moved[p, 2] = point[2] + s2
            # With the reduced gradients this adds up to step . gradient of the whole system.
            n0 = i0 * g0
            n1 = i1 * g0 + i2 * g1
            n2 = i3 * g0 + i4 * g1 + i5 * g2
            down += n0 * n0 + n1 * n1 + n2 * n2
            square += s0 * v0 * s0 + s1 * v2 * s1 + s2 * v5 * s2
        totals[0] += down
        totals[1] += square

    def substitute(first, last, scene, damping, step, moved, totals, longest):
        """Move points first..last by a step.

        moved: (points, 3) receives the new points. totals (2,): the points' part of
        step . gradient and of step . diagonal . step. longest: the most rays of a point.
        """
        core(first, last, scene, damping, step, moved, totals, np.zeros(longest * SEEN))

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


@compiled(**KERNEL)
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


@compiled(**KERNEL)
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
