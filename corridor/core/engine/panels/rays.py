"""Rays, eight at a time: where images see points, and the derivatives of that.

Increments of image i: C += dC; R <- Exp(dr) R, so that dX/ddr = -[X]x, dX/dC = -R, dX/dP = R.
Motion (c, theta) of the camera at a row: X = Exp(-theta) (R (P - C) - c).

While the rows are read the camera moves: the row of the modelled pixel decides where the camera
is, and the camera where the pixel is. A step of Newton from the row last found finds both; it is
repeated until it is short. Derivatives by what moves the camera are taken at the row found; at the
measured one they would go with its error.

The rays of some points lie one behind the other in `Room`, filled up to a whole panel with rays of
no weight. Indices are unsigned and arrays flat where it is hot: no test for a negative index.
"""

from typing import NamedTuple

import numpy as np

from corridor.core.camera import (
    affine_after,
    distorted,
    equidistant,
    interior_columns,
    is_fisheye,
    through_lens,
)
from corridor.core.engine.compiled import UNWRAPPED, njit
from corridor.core.engine.panels.lanes import (
    lane,
    largest,
    panel,
    put,
    root,
    same,
    total,
    transposed,
    where_positive,
    with_lane,
    zeros,
)
from corridor.core.engine.scene import HUBER, INNER, PANEL, PASSES, SQUARES
from corridor.core.geometry import cross, dot, few_sines, left_jacobian, rotated, sines

U = np.uint64
# Where two panels more find room behind the derivatives of eight rays.
SPARE = U(2 * INNER * PANEL)


class Room(NamedTuple):
    """Rays of some points: image (n,); given (18, n), flat: x, y, root of the weight, point (3),
    row, shift and slope (6), modelled pixel (2), skewed (3). Jacobian rows, two a ray: own
    (n, 2, row), by the image and behind it the weighted residual, point (n, 2, 8), shared
    (n, 2, wide); work: the derivatives of eight rays."""

    image: np.ndarray
    given: np.ndarray
    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    work: np.ndarray


class Seen(NamedTuple):
    """Of eight rays, panels all: X, rotation R (three rows); positive where the point is ahead of
    the camera; root of the weight, 0 behind it; lens, ray u, v before its distortion (of a
    fisheye shortened) and after it; weighted derivatives of x and y by X; weighted residuals;
    focal length. Of moving cameras turn and place of the row. slope: matrix before the pixel's
    derivatives: what moves the pixel moves its row, and the row moves the camera; effects on the
    image look at where the pixel is; and x and y may be skewed."""

    x: tuple
    rotation: tuple
    ahead: tuple
    root: tuple
    lens: tuple
    by_x: tuple
    by_y: tuple
    left: tuple
    focal: tuple
    turn: tuple
    place: tuple
    slope: tuple


class Strided(NamedTuple):
    """Rows of numbers: the first from `at` on, the next `apart` behind."""

    values: np.ndarray
    at: int
    apart: int


def row_length(d: int) -> int:
    """Numbers of a Jacobian row by an image of `d` unknowns with its residual: whole panels."""
    return (d + PANEL) // PANEL * PANEL


inner_row_length = njit(**UNWRAPPED)(row_length)


def make_room(rays: int, d: int, wide: int) -> Room:
    """Room for so many rays of images with `d` unknowns."""
    n = rays + PANEL
    return Room(
        np.zeros(n, dtype=np.int64),
        aligned(18 * n),
        aligned(n * 2 * row_length(d)),
        aligned(n * 2 * PANEL),
        aligned(n * 2 * wide),
        aligned(2 * INNER * PANEL + 2 * PANEL),
    )


def aligned(count: int) -> np.ndarray:
    """Zeros whose panels lie in one line of the cache each."""
    room = np.zeros(count + 2 * PANEL)
    first = -room.ctypes.data // room.itemsize % PANEL
    return room[first : first + count + PANEL]


# --- vectors and rows ----------------------------------------------------------------------------


@njit(**UNWRAPPED)
def less(a, b):
    """a - b, of three."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(**UNWRAPPED)
def three(x, at):
    """Three numbers of x."""
    return x[at], x[at + U(1)], x[at + U(2)]


@njit(**UNWRAPPED)
def times(r, x):
    """R x; r: three rows."""
    return dot(r[0], x), dot(r[1], x), dot(r[2], x)


@njit(**UNWRAPPED)
def before(g, r):
    """The row g R; r: three rows."""
    return (
        g[0] * r[0][0] + g[1] * r[1][0] + g[2] * r[2][0],
        g[0] * r[0][1] + g[1] * r[1][1] + g[2] * r[2][1],
        g[0] * r[0][2] + g[1] * r[1][2] + g[2] * r[2][2],
    )


@njit(**UNWRAPPED)
def _minus(a):
    return -a[0], -a[1], -a[2]


@njit(**UNWRAPPED)
def sloped(slope, x, y):
    """The matrix (4) before x and y."""
    return slope[0] * x + slope[1] * y, slope[2] * x + slope[3] * y


@njit(**UNWRAPPED)
def sloped_rows(slope, g, h):
    """The matrix (4) before the rows g and h."""
    (g0, h0), (g1, h1) = sloped(slope, g[0], h[0]), sloped(slope, g[1], h[1])
    g2, h2 = sloped(slope, g[2], h[2])
    return (g0, g1, g2), (h0, h1, h2)


@njit(**UNWRAPPED)
def of_images(x, apart, at, image, n):
    """Eight panels: the numbers at, at + 1 ... of the rows of eight rays' images, from ray n on."""
    return transposed(
        (
            panel(x, U(image[n]) * apart + at),
            panel(x, U(image[n + U(1)]) * apart + at),
            panel(x, U(image[n + U(2)]) * apart + at),
            panel(x, U(image[n + U(3)]) * apart + at),
            panel(x, U(image[n + U(4)]) * apart + at),
            panel(x, U(image[n + U(5)]) * apart + at),
            panel(x, U(image[n + U(6)]) * apart + at),
            panel(x, U(image[n + U(7)]) * apart + at),
        )
    )


@njit(**UNWRAPPED)
def put_rows(out, at, apart, columns):
    """Rows of eight numbers, `apart` numbers from each other; columns: eight panels."""
    rows = transposed(columns)
    for k in range(PANEL):
        put(out, at + U(k) * apart, rows[k])


# --- rays -----------------------------------------------------------------------------------------


@njit(**UNWRAPPED)
def add_point(p, n, scene, room):
    """Put the rays of point p behind n others; returns how many there are now."""
    observations, looked = scene.observations, scene.looked
    given, apart = room.given, U(room.image.shape[0])
    moves, looks = looked.row.shape[0] > 0, looked.modelled.shape[0] > 0
    shifts = looked.shift.shape[1] if looked.shift.shape[0] > 0 else 0
    start = observations.start[p]
    m = observations.start[p + 1] - start
    one, skewed = observations.weight.shape[0] == 1, observations.skewed.shape[0] > 0
    x, y, z = scene.points[p, 0], scene.points[p, 1], scene.points[p, 2]
    for k in range(m):
        o, at = U(start + k), U(n + k)
        room.image[at] = observations.image[o]
        given[at] = observations.xy[o, U(0)]
        at += apart
        given[at] = observations.xy[o, U(1)]
        at += apart
        given[at] = observations.weight[U(0) if one else o]
        at += apart
        given[at] = x
        at += apart
        given[at] = y
        at += apart
        given[at] = z
        at += apart
        if moves:
            given[at] = looked.row[o]
        for c in range(shifts):
            at += apart
            given[at] = looked.shift[o - U(looked.base), U(c)]
        if looks:
            at = U(13) * apart + U(n + k)
            given[at] = looked.modelled[o, U(0)]
            given[at + apart] = looked.modelled[o, U(1)]
        if skewed:
            at = U(15) * apart + U(n + k)
            for c in range(3):
                given[at] = observations.skewed[o, U(c)]
                at += apart
    return n + m


@njit(**UNWRAPPED)
def fill_up(n, room):
    """Repeat the last of n rays, without weight, to the end of its panel."""
    given, apart = room.given, U(room.image.shape[0])
    last = U(n - 1)
    for k in range(n, -(-n // PANEL) * PANEL):
        room.image[U(k)] = room.image[last]
        for c in range(18):
            given[U(c) * apart + U(k)] = given[U(c) * apart + last] if c != 2 else 0.0


@njit(**UNWRAPPED)
def see(n, first, count, scene, room):
    """Eight rays from the n-th on as their images see them, and their cost (a panel).

    first: number of the room's first ray; count: how many rays there are. Moves on what the scene
    knows of rows and modelled pixels.
    """
    given, apart, looked = room.given, U(room.image.shape[0]), scene.looked
    moves, looks = scene.cameras.motion.shape[1] > 0, looked.modelled.shape[0] > 0
    for _ in range(PASSES if moves else 1):
        seen, cost, row, missed, mx, my = _see_once(U(n), scene, room)
        if moves:
            # Rays that are near enough stay as they are, whoever is beside them.
            far = where_positive(missed, missed, -missed) - looked.near
            at = U(6) * apart + U(n)
            put(given, at, where_positive(far, row, panel(given, at)))
            if not largest(far) > 0.0:
                break
    if moves or looks:
        for k in range(min(PANEL, count - n)):
            o = U(first + n + k)
            if lane(seen.ahead, U(k)) > 0.0:
                if moves:
                    looked.row[o] = lane(row, U(k))
                if looks:
                    looked.modelled[o, U(0)], looked.modelled[o, U(1)] = (
                        lane(mx, U(k)),
                        lane(my, U(k)),
                    )
                    u, v = lane(seen.lens[0], U(k)), lane(seen.lens[1], U(k))
                    theta = np.sqrt(u * u + v * v)
                    if theta > 0.0 and is_fisheye(scene.cameras.interior, U(room.image[U(n + k)])):
                        u, v = u * np.tan(theta) / theta, v * np.tan(theta) / theta
                    looked.modelled[o, U(2)], looked.modelled[o, U(3)] = u, v
    return seen, cost


@njit(**UNWRAPPED)
def _see_once(n, scene, room):
    """One step of `see`: also the rows found and by how much they were missed, px, and pixels."""
    cameras, looked = scene.cameras, scene.looked
    given, image, apart = room.given, room.image, U(room.image.shape[0])
    moves = cameras.motion.shape[1] > 0
    zero, one = zeros(), same(1.0)
    c0, c1, c2, r0, r1, r2, r3, r4 = of_images(cameras.pose, U(16), U(0), image, n)
    r5, r6, r7, r8, down, factor, offset, _ = of_images(cameras.pose, U(16), U(8), image, n)
    rotation = (r0, r1, r2), (r3, r4, r5), (r6, r7, r8)
    at = n + U(3) * apart
    point = panel(given, at), panel(given, at + apart), panel(given, at + apart + apart)
    x = times(rotation, less(point, (c0, c1, c2)))
    bent = x
    turn = slope = zero, zero, zero
    row, place, missed, sine, cosine = zero, zero, zero, zero, zero
    if moves:
        row = panel(given, n + U(6) * apart)
        place = factor * row + offset
        degree = cameras.motion.shape[1] - 1
        where = degree, U((degree + 1) * PANEL), U(0)
        c, turn, dc, dt = camera_course(place, cameras.motion, where, image, n)
        x = bent = less(x, c)
        slope = _minus(dc)
        if cameras.turns:
            # Slope of X before its turn: -dc/ds + X x dtheta/ds.
            slope = less(cross(x, dt), dc)
            sine, cosine = _sines(turn)
            bent = rotated(sine, cosine, _minus(turn), x)
    f, cx, cy, p1, p2, b1, b2, k1 = of_images(cameras.interior, U(16), U(0), image, n)
    k2, k3, k4, k5, k6, k7, k8, fisheye = zero, zero, zero, zero, zero, zero, zero, zero
    if cameras.radials > 1:
        k2, k3, k4, k5, k6, k7, k8, fisheye = of_images(cameras.interior, U(16), U(8), image, n)
    iz = where_positive(bent[2], 1.0 / bent[2], zero)
    u, v = bent[0] * iz, bent[1] * iz
    flat, radial = (p1, p2, b1, b2), (k1, k2, k3, k4, k5, k6, k7, k8)
    if cameras.fisheye:
        lens, seen = _through_fisheyes(u, v, flat, radial, fisheye)
    else:
        lens, seen = (u, v), _bent(u, v, flat, radial, cameras.radials)
    a, b, au, av, bu, bv = seen
    iz *= f
    g0, g1, h0, h1 = iz * au, iz * av, iz * bu, iz * bv
    g, h = (g0, g1, -(g0 * u + g1 * v)), (h0, h1, -(h0 * u + h1 * v))
    mx, my = cx + f * a, cy + f * b
    before_it = one, zero, zero, one
    if looked.shift.shape[0] > 0:
        at = n + U(7) * apart
        mx, my = mx + panel(given, at), my + panel(given, at + apart)
        if looked.shift.shape[1] > 2:
            at += apart + apart
            before_it = (
                panel(given, at),
                panel(given, at + apart),
                panel(given, at + U(2) * apart),
                panel(given, at + U(3) * apart),
            )
            # The shift is that of the pixel modelled last time: one step of Newton from there.
            px, py = panel(given, at + U(4) * apart), panel(given, at + U(5) * apart)
            ex, ey = sloped(before_it, mx - px, my - py)
            mx, my = px + ex, py + ey
            g, h = sloped_rows(before_it, g, h)
    if moves:
        if cameras.turns:
            g, h = rotated(sine, cosine, turn, g), rotated(sine, cosine, turn, h)
        slope_x, slope_y = factor * dot(g, slope), factor * dot(h, slope)
        inverse = 1.0 / where_positive(down, one - slope_y, one - slope_x)
        across = (
            where_positive(down, one, inverse),
            where_positive(down, slope_x * inverse, zero),
            where_positive(down, zero, slope_y * inverse),
            where_positive(down, inverse, one),
        )
        missed = where_positive(iz, where_positive(down, my - row, mx - row) * inverse, zero)
        mx, my = mx + slope_x * missed, my + slope_y * missed
        g, h = sloped_rows(across, g, h)
        place += factor * missed
        row += missed
        s00, s10 = sloped(across, before_it[0], before_it[2])
        s01, s11 = sloped(across, before_it[1], before_it[3])
        before_it = s00, s01, s10, s11
    weight = where_positive(iz, panel(given, n + apart + apart), zero)
    ex = weight * (panel(given, n) - mx)
    ey = weight * (panel(given, n + apart) - my)
    if scene.observations.skewed.shape[0] > 0:
        at = n + U(15) * apart
        skew = panel(given, at), zero, panel(given, at + apart), panel(given, at + apart + apart)
        ex, ey = sloped(skew, ex, ey)
        g, h = sloped_rows(skew, g, h)
        s00, s10 = sloped(skew, before_it[0], before_it[2])
        s01, s11 = sloped(skew, before_it[1], before_it[3])
        before_it = s00, s01, s10, s11
    cost = ex * ex + ey * ey
    if scene.loss.kind != SQUARES:
        cost, soft = _robust(scene.loss, cost)
        weight, ex, ey = weight * soft, ex * soft, ey * soft
    by_x = weight * g[0], weight * g[1], weight * g[2]
    by_y = weight * h[0], weight * h[1], weight * h[2]
    seen = Seen(
        x, rotation, iz, weight, (lens[0], lens[1], a, b), by_x, by_y, (ex, ey), f, turn,
        place, before_it,
    )  # fmt: skip
    return seen, cost, row, missed, mx, my


@njit(**UNWRAPPED)
def _bent(u, v, flat, k, radials):
    """`distorted` of eight rays; k: their eight radial coefficients, of which so many count."""
    r2, radial, by_r2 = u * u + v * v, k[0], zeros()
    if radials > 1:
        radial, by_r2 = _next(k[7], by_r2, r2, k[6])
        radial, by_r2 = _next(radial, by_r2, r2, k[5])
        radial, by_r2 = _next(radial, by_r2, r2, k[4])
        radial, by_r2 = _next(radial, by_r2, r2, k[3])
        radial, by_r2 = _next(radial, by_r2, r2, k[2])
        radial, by_r2 = _next(radial, by_r2, r2, k[1])
        radial, by_r2 = _next(radial, by_r2, r2, k[0])
    radial, by_r2 = _next(radial, by_r2, r2, same(1.0))
    return distorted(u, v, radial, by_r2, flat)


@njit(**UNWRAPPED)
def _through_fisheyes(u, v, flat, k, fisheye):
    """Where fisheyes among eight rays' lenses have them before their distortion, and `_bent`."""
    scale, slope, r2 = same(1.0), zeros(), u * u + v * v
    for i in range(PANEL):
        if lane(fisheye, U(i)) > 0.0:
            s, by = equidistant(lane(r2, U(i)))
            scale, slope = with_lane(scale, U(i), s), with_lane(slope, U(i), by)
    p1, p2, b1, b2 = flat
    c1, c2 = where_positive(fisheye, b1, zeros()), where_positive(fisheye, b2, zeros())
    lens = u * scale, v * scale
    bent = _bent(lens[0], lens[1], (p1, p2, b1 - c1, b2 - c2), k, 8)
    return lens, through_lens(u, v, scale, slope, affine_after(c1, c2, bent))


@njit(**UNWRAPPED)
def _next(value, slope, x, coefficient):
    """A polynomial and its derivative by x, one coefficient further."""
    return value * x + coefficient, slope * x + value


@njit(**UNWRAPPED)
def _sines(turn):
    """`sines` of eight turns."""
    square = dot(turn, turn)
    sine, cosine = few_sines(square)
    for k in range(PANEL):
        if lane(square, U(k)) > 0.01:
            t = lane(turn[0], U(k)), lane(turn[1], U(k)), lane(turn[2], U(k))
            s, c = sines(t)
            sine, cosine = with_lane(sine, U(k), s), with_lane(cosine, U(k), c)
    return sine, cosine


@njit(**UNWRAPPED)
def camera_course(s, motion, where, image, n):
    """Centre and turn of eight rays' cameras at the places s of their rows, and the slopes by s.

    motion: coefficients of s^0 first, eight numbers each. where: degree, numbers from an image to
    the next, and where the first image's begin.
    """
    degree, step, at = where
    c0, c1, c2, t0, t1, t2, _, _ = of_images(motion, step, at + U(degree * PANEL), image, n)
    c, t = (c0, c1, c2), (t0, t1, t2)
    dc = dt = zeros(), zeros(), zeros()
    for g in range(degree - 1, -1, -1):
        c0, c1, c2, t0, t1, t2, _, _ = of_images(motion, step, at + U(g * PANEL), image, n)
        dc = dc[0] * s + c[0], dc[1] * s + c[1], dc[2] * s + c[2]
        dt = dt[0] * s + t[0], dt[1] * s + t[1], dt[2] * s + t[2]
        c = c[0] * s + c0, c[1] * s + c1, c[2] * s + c2
        t = t[0] * s + t0, t[1] * s + t1, t[2] * s + t2
    return c, t, dc, dt


@njit(**UNWRAPPED)
def _robust(loss, s):
    """Cost rho(s) and root of the weight rho'(s); s = |r|^2.

    The weight alone makes the step (iteratively reweighted least squares): slower than with the
    second derivative, but it never overshoots, and a point with two outlying rays stays put.
    """
    k2 = loss.width * loss.width
    if loss.kind == HUBER:
        far, length = s - k2, root(s)
        return (
            where_positive(far, 2.0 * loss.width * length - k2, s),
            where_positive(far, root(loss.width / length), same(1.0)),
        )
    cost = zeros()
    for k in range(PANEL):
        cost = with_lane(cost, U(k), k2 * np.log1p(lane(s, U(k)) / k2))
    return cost, 1.0 / root(1.0 + s / k2)


# --- Jacobian rows ------------------------------------------------------------------------------


@njit(**UNWRAPPED)
def ray_rows(seen, n, first, count, scene, room, span, d):
    """Weighted Jacobian rows of eight rays, from the n-th on, into the room.

    Arguments as of `see`; span: the panels of shared columns to fill; d: unknowns of an image. By
    the point: the image's first three, negative, but where effects on the image see points: then
    they stand in room.point. Rays from behind have rows of zeros.
    """
    derivatives, row = scene.derivatives, U(inner_row_length(d))
    zero = zeros()
    apart, at = row + row, U(2 * n) * row
    # g . (dr x X) = dr . (X x g)
    for half in range(2):
        g = seen.by_x if half == 0 else seen.by_y
        p, t = before(g, seen.rotation), cross(seen.x, g)
        left = seen.left[0] if half == 0 else seen.left[1]
        e = left if d == 6 else zero
        put_rows(room.own, at, apart, (-p[0], -p[1], -p[2], t[0], t[1], t[2], e, zero))
        if d > 6:
            for k in range(PANEL):
                for x in range(PANEL, row, PANEL):
                    put(room.own, at + U(k) * apart + U(x), zero)
                room.own[at + U(k) * apart + U(d)] = lane(left, U(k))
        at += row
    low, high = span
    if derivatives.interior.shape[1] == 0 and high <= low and derivatives.motion.shape[1] == 0:
        if derivatives.image.shape[2] == 0 and derivatives.sight.shape[0] == 0:
            return
    _interior(seen, n, scene, room)
    if high > low:
        _shared_rows(n, scene, room, span)
    slot = 0
    for c in range(derivatives.interior.shape[1]):
        dx, dy = zero, zero
        step, at = U(derivatives.interior.shape[1] * INNER), U(c * INNER)
        for part in range(2):
            change = of_images(derivatives.interior, step, at + U(8 * part), room.image, U(n))
            for k in range(PANEL):
                inner = U(2 * (8 * part + k) * PANEL)
                dx += change[k] * panel(room.work, inner)
                dy += change[k] * panel(room.work, inner + U(PANEL))
        _add_slot(slot, dx, dy, n, count, scene, room, d)
        slot += 1
    for c in range(derivatives.image.shape[2]):
        dx, dy = of_rays(derivatives.image, seen, n, first, count, scene, room, U(c))
        _add_slot(slot, dx, dy, n, count, scene, room, d)
        slot += 1
    for c in range(derivatives.motion.shape[1]):
        degree, size = derivatives.motion.shape[2] - 1, derivatives.motion.shape[2] * PANEL
        where = degree, U(derivatives.motion.shape[1] * size), U(c * size)
        centre, theta, _, _ = camera_course(seen.place, derivatives.motion, where, room.image, U(n))
        away = _minus(centre)
        if scene.cameras.turns:
            away = less(cross(seen.x, left_jacobian(seen.turn, theta)), centre)
        dx, dy = dot(seen.by_x, away), dot(seen.by_y, away)
        _add_slot(slot, dx, dy, n, count, scene, room, d)
        slot += 1
    if derivatives.sight.shape[0] > 0:
        _add_sight(seen, n, first, count, scene, room, row)


@njit(**UNWRAPPED)
def _interior(seen, n, scene, room):
    """Weighted derivatives of x and y by the interior parameters, after the slope."""
    u, v, a, b = seen.lens
    f, r, work = seen.focal, seen.root, room.work
    moved = scene.cameras.motion.shape[1] > 0 or scene.looked.shift.shape[0] > 0
    moved = moved or scene.observations.skewed.shape[0] > 0
    by_f, by_cx, by_cy, by_p1, by_p2, by_b1, by_b2 = interior_columns(
        u, v, a, b, f, same(1.0), zeros()
    )  # fmt: skip
    to = bent = work, seen.slope, r, moved
    if scene.cameras.fisheye:
        b1, b2, x, y = affinity(seen, scene.cameras, room.image, U(n))
        s = seen.slope
        slope = s[0] + b1 * s[0], b2 * s[0] + s[1], s[2] + b1 * s[2], b2 * s[2] + s[3]
        bent = work, slope, r, True
        by_b1, by_b2 = (f * x, zeros()), (f * y, zeros())
    _put_inner(to, U(0), by_f)
    _put_inner(to, U(1), by_cx)
    _put_inner(to, U(2), by_cy)
    _put_inner(bent, U(3), by_p1)
    _put_inner(bent, U(4), by_p2)
    _put_inner(to, U(5), by_b1)
    _put_inner(to, U(6), by_b2)
    power, r2 = f, u * u + v * v
    radials = scene.cameras.radials if scene.derivatives.interior.shape[1] == 0 else 8
    for k in range(7, 7 + radials):
        power *= r2
        _put_inner(bent, U(k), (power * u, power * v))


@njit(**UNWRAPPED)
def affinity(seen, cameras, image, n):
    """b1 and b2 of the fisheyes among eight rays' lenses, 0 of others, and what they multiply."""
    u, v, a, b = seen.lens
    _, _, _, _, _, b1, b2, _ = of_images(cameras.interior, U(16), U(0), image, n)
    _, _, _, _, _, _, _, fisheye = of_images(cameras.interior, U(16), U(8), image, n)
    b1, b2 = where_positive(fisheye, b1, zeros()), where_positive(fisheye, b2, zeros())
    before = (a - b2 * b) / (same(1.0) + b1)
    return b1, b2, where_positive(fisheye, before, u), where_positive(fisheye, b, v)


@njit(**UNWRAPPED)
def _put_inner(to, k, derivative):
    work, slope, weight, moved = to
    dx, dy = weight * derivative[0], weight * derivative[1]
    if moved:
        dx, dy = sloped(slope, dx, dy)
    put(work, k * U(2 * PANEL), dx)
    put(work, k * U(2 * PANEL) + U(PANEL), dy)


@njit(**UNWRAPPED)
def _shared_rows(n, scene, room, span):
    """Fill the shared columns of the interior; all others of the span with zeros."""
    columns, work, out = scene.columns, room.work, room.shared
    wide, source = U(columns.wide), columns.source
    apart = wide + wide
    camera = columns.camera[U(room.image[U(n)])]
    one = True
    for k in range(1, PANEL):
        one = one and columns.camera[U(room.image[U(n + k)])] == camera
    i = U(room.image[U(n)])
    for x in range(span[0], span[1], PANEL):
        at = U(2 * n) * wide + U(x)
        if one:
            for half in range(2):
                to = U(half * PANEL)
                put_rows(
                    out, at, apart,
                    (
                        panel(work, U(source[i, U(x)]) + to),
                        panel(work, U(source[i, U(x + 1)]) + to),
                        panel(work, U(source[i, U(x + 2)]) + to),
                        panel(work, U(source[i, U(x + 3)]) + to),
                        panel(work, U(source[i, U(x + 4)]) + to),
                        panel(work, U(source[i, U(x + 5)]) + to),
                        panel(work, U(source[i, U(x + 6)]) + to),
                        panel(work, U(source[i, U(x + 7)]) + to),
                    ),
                )  # fmt: skip
                at += wide
            continue
        for k in range(PANEL):
            i_k = U(room.image[U(n + k)])
            for c in range(PANEL):
                inner = U(source[i_k, U(x + c)]) + U(k)
                out[at + U(c)] = work[inner]
                out[at + wide + U(c)] = work[inner + U(PANEL)]
            at += apart


@njit(**UNWRAPPED)
def _add_slot(slot, dx, dy, n, count, scene, room, d):
    """Add derivatives by an effect's parameter to the columns of each ray's image."""
    row, wide, work = inner_row_length(d), scene.columns.wide, room.work
    put(work, SPARE, dx)
    put(work, SPARE + U(PANEL), dy)
    for k in range(min(PANEL, count - n)):
        column, x = scene.columns.slot[U(room.image[U(n + k)]), U(slot)], SPARE + U(k)
        if column >= 0:
            at = U(2 * (n + k) * wide + column)
            room.shared[at] += work[x]
            room.shared[at + U(wide)] += work[x + U(PANEL)]
        elif column <= -2:
            at = U(2 * (n + k) * row + 4 - column)
            room.own[at] += work[x]
            room.own[at + U(row)] += work[x + U(PANEL)]


@njit(**UNWRAPPED)
def of_rays(values, seen, n, first, count, scene, room, c):
    """Derivative c of effects on the image, weighted and after the slope: x and y.

    values: (rays, 2, k) of `Derivatives`; other arguments as of `ray_rows`.
    """
    work = room.work
    for k in range(min(PANEL, count - n)):
        e, x = U(first + n + k - scene.looked.base), SPARE + U(k)
        work[x], work[x + U(PANEL)] = values[e, U(0), c], values[e, U(1), c]
    dx, dy = panel(work, SPARE), panel(work, SPARE + U(PANEL))
    return sloped(seen.slope, seen.root * dx, seen.root * dy)


@njit(**UNWRAPPED)
def sighted_points(seen, n, first, count, scene, room):
    """Weighted rows of x and y by the point, where effects on the image see it."""
    g, h = before(seen.by_x, seen.rotation), before(seen.by_y, seen.rotation)
    for c in range(3):
        dx, dy = of_rays(scene.derivatives.sight, seen, n, first, count, scene, room, U(6 + c))
        if c == 0:
            g, h = (g[0] + dx, g[1], g[2]), (h[0] + dy, h[1], h[2])
        elif c == 1:
            g, h = (g[0], g[1] + dx, g[2]), (h[0], h[1] + dy, h[2])
        else:
            g, h = (g[0], g[1], g[2] + dx), (h[0], h[1], h[2] + dy)
    return g, h


@njit(**UNWRAPPED)
def _add_sight(seen, n, first, count, scene, room, row):
    """What effects on the image see: in the rows by the image, and those by the point."""
    work = room.work
    for c in range(6):
        dx, dy = of_rays(scene.derivatives.sight, seen, n, first, count, scene, room, U(c))
        put(work, SPARE, dx)
        put(work, SPARE + U(PANEL), dy)
        for k in range(min(PANEL, count - n)):
            at, x = U(2 * (n + k)) * row + U(c), SPARE + U(k)
            room.own[at] += work[x]
            room.own[at + row] += work[x + U(PANEL)]
    g, h = sighted_points(seen, n, first, count, scene, room)
    zero, apart, at = zeros(), U(2 * PANEL), U(2 * n * PANEL)
    # Negative, as the rows by the centre are.
    put_rows(room.point, at, apart, (-g[0], -g[1], -g[2], zero, zero, zero, zero, zero))
    at += U(PANEL)
    put_rows(room.point, at, apart, (-h[0], -h[1], -h[2], zero, zero, zero, zero, zero))


@njit(**UNWRAPPED)
def fill_rows(first, last, scene, room, span, d):
    """Jacobian rows of the rays of points first..last; returns cost and how many are behind."""
    start = scene.observations.start
    n = np.int64(0)
    for p in range(first, last):
        n = add_point(p, n, scene, room)
    fill_up(n, room)
    cost, behind = zeros(), 0
    for at in range(0, n, PANEL):
        seen, square = see(at, start[first], n, scene, room)
        cost += square
        ray_rows(seen, at, start[first], n, scene, room, span, d)
        if scene.columns.hung.shape[0] > 0:
            _hang(at, n, scene, room, d)
        behind += hidden(seen, at, n)
    return total(cost), behind


@njit(**UNWRAPPED)
def _hang(n, count, scene, room, d):
    """Make of eight rays' derivatives by the poses of their images those by their exposures'."""
    own, hung, row = room.own, scene.columns.hung, inner_row_length(d)
    for k in range(min(PANEL, count - n)):
        i = U(room.image[U(n + k)])
        for half in range(2):
            at = U((2 * (n + k) + half) * row)
            (c0, c1, c2), (t0, t1, t2) = three(own, at), three(own, at + U(3))
            for c in range(3):
                lever = c0 * hung[i, U(c)] + c1 * hung[i, U(c + 3)] + c2 * hung[i, U(c + 6)]
                turn = t0 * hung[i, U(c + 9)] + t1 * hung[i, U(c + 12)] + t2 * hung[i, U(c + 15)]
                own[at + U(c + 3)] = lever + turn


@njit(**UNWRAPPED)
def hidden(seen, n, count):
    """How many of eight rays, from the n-th of so many on, come from behind."""
    behind = 0
    if total(where_positive(seen.ahead, zeros(), same(1.0))) > 0.0:
        for k in range(min(PANEL, count - n)):
            behind += 0 if lane(seen.ahead, U(k)) > 0.0 else 1
    return behind
