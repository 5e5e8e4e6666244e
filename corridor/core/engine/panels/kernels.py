"""One pass over the points: residual, Jacobian, Schur complement, straight into band storage.

No Jacobian is stored. Points are sorted by their images, images along the corridor, so that a
point touches a few neighbouring columns of a band matrix and few shared unknowns. Each image has
`d` unknowns (centre 3, rotation 3, effects of its own); cameras, effects and lever arms are shared.
Images of one exposure of a rig have the same unknowns, and stand here as one.

For one point let J be its rays' Jacobian rows by images, B those by what is shared, P by the point,
and V = P'P (with damping and control) = L L'. With Y = L^-1 P'J, Z = L^-1 P'B, n = L^-1 P'e the
reduced equations are

    J'J - Y'Y    J'B - Y'Z    and right    J'e - Y'n
                 B'B - Z'Z                 B'e - Z'n

where J'B - Y'Z = J'(B - T Z) with T = P L^-T, ray by ray, and so with B for J. Up to `GROUP` points
that the same images see are gathered before anything is added to the matrix.

Source: Triggs et al. 2000, "Bundle adjustment: a modern synthesis", sections 4.3 and 6.
"""

from typing import NamedTuple

import numpy as np

from corridor.core.camera import interior_columns
from corridor.core.engine.compiled import KERNEL, UNWRAPPED, compiled, njit
from corridor.core.engine.panels.lanes import (
    add_some,
    from_lane,
    lane,
    panel,
    plus,
    put,
    same,
    total,
    with_lane,
    zeros,
)
from corridor.core.engine.panels.rays import (
    SPARE,
    Strided,
    U,
    add_point,
    affinity,
    aligned,
    before,
    camera_course,
    fill_rows,
    fill_up,
    hidden,
    inner_row_length,
    less,
    make_room,
    of_images,
    of_rays,
    put_rows,
    row_length,
    see,
    sighted_points,
    sloped,
    three,
)
from corridor.core.engine.scene import INNER, PANEL
from corridor.core.geometry import cross, dot, left_jacobian

# Points seen by the same images that are gathered before they are added to the matrix.
GROUP = 8
# Rays that are seen before points are eliminated: few enough for the cache.
BLOCK = 64


class Work(NamedTuple):
    """Room to work in. Of the rays of one point T and what the point leaves of the residuals (8
    numbers). Of points that wait B - T Z, as the rows by the shared, and Y with n behind, image by
    image. Besides rows by the shared and residuals of control, and Z."""

    part: np.ndarray
    left: np.ndarray
    y: np.ndarray
    control: np.ndarray
    residual: np.ndarray
    z: np.ndarray


# --- residuals --------------------------------------------------------------------------------


@compiled(**KERNEL)
def look(first, last, scene, out, room):
    """Sum of rho over the rays of points first..last, and how many are behind a camera.

    out (n, 2), or (0, 2): receives the residuals times the root of their weight, NaN of those
    behind. room: for `BLOCK` rays and those of a point more.
    """
    start = scene.observations.start
    sum_of_rho = 0.0
    behind = 0
    p = first
    while p < last:
        begin, n = p, np.int64(0)
        while p < last and n < BLOCK:
            n = add_point(p, n, scene, room)
            p += 1
        fill_up(n, room)
        cost = zeros()
        for at in range(0, n, PANEL):
            seen, square = see(at, start[begin], n, scene, room)
            cost = cost + square
            behind += hidden(seen, at, n)
            for k in range(min(PANEL, n - at) if out.shape[0] > 0 else 0):
                o, ahead = U(start[begin] + at + k), lane(seen.ahead, U(k)) > 0.0
                out[o, U(0)] = lane(seen.left[0], U(k)) if ahead else np.nan
                out[o, U(1)] = lane(seen.left[1], U(k)) if ahead else np.nan
        sum_of_rho += total(cost)
    return sum_of_rho, behind


# --- parts of the assembly --------------------------------------------------------------------


@njit(**UNWRAPPED)
def _no_products():
    return zeros(), zeros(), zeros(), zeros(), zeros(), zeros()


@njit(**UNWRAPPED)
def _products(sums, a, x, rows):
    """Add a[:, c] x[:, :PANEL] to sum c of six, over as many rows; a, x: `Strided`."""
    s0, s1, s2, s3, s4, s5 = sums
    n, at = a.at, x.at
    for _ in range(rows):
        p = panel(x.values, at)
        s0 = plus(s0, a.values[n], p)
        s1 = plus(s1, a.values[n + U(1)], p)
        s2 = plus(s2, a.values[n + U(2)], p)
        s3 = plus(s3, a.values[n + U(3)], p)
        s4 = plus(s4, a.values[n + U(4)], p)
        s5 = plus(s5, a.values[n + U(5)], p)
        n += a.apart
        at += x.apart
    return s0, s1, s2, s3, s4, s5


@njit(**UNWRAPPED)
def _products_of_pairs(sums, a, x, apart, points):
    """As `_products`, over two rows, as far apart as `a` and `x` say, of so many points.

    apart: numbers from one point's to the next one's, of a and of x.
    """
    n, at = a.at, x.at
    for _ in range(points):
        pair = Strided(a.values, n, a.apart), Strided(x.values, at, x.apart)
        sums = _products(sums, pair[0], pair[1], 2)
        n += apart[0]
        at += apart[1]
    return sums


@njit(**UNWRAPPED)
def _add_products(out, at, apart, sums, columns, count, sign):
    """Add sign times the first `count` numbers of `columns` (at most six) of the sums to out."""
    s0, s1, s2, s3, s4, s5 = sums
    add_some(out, at, plus(zeros(), sign, s0), count)
    if columns > 1:
        add_some(out, at + apart, plus(zeros(), sign, s1), count)
    if columns > 2:
        add_some(out, at + U(2) * apart, plus(zeros(), sign, s2), count)
    if columns > 3:
        add_some(out, at + U(3) * apart, plus(zeros(), sign, s3), count)
    if columns > 4:
        add_some(out, at + U(4) * apart, plus(zeros(), sign, s4), count)
    if columns > 5:
        add_some(out, at + U(5) * apart, plus(zeros(), sign, s5), count)


@njit(**UNWRAPPED)
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


@njit(**UNWRAPPED)
def three_of(x, row):
    """The three numbers of a row of x (n, 3)."""
    return x[row, 0], x[row, 1], x[row, 2]


@njit(**UNWRAPPED)
def root_rows(root, row):
    """Three rows of the lower triangle in a row of root (n, 6)."""
    return (
        (root[row, 0], 0.0, 0.0),
        (root[row, 1], root[row, 2], 0.0),
        (root[row, 3], root[row, 4], root[row, 5]),
    )


@njit(**UNWRAPPED)
def _add_own(equations, n, at, own, less, count, place):
    """Add `count` columns (at most six) of J'J - Y'Y of one image, and J'e - Y'n.

    n: number of the first of these unknowns; at: where the image's block begins. own, less: their
    products with the panel x of unknowns, place = (c, x, d): c the first of them in their image.
    """
    c, x, d = place
    storage = equations.storage
    for number in range(6):
        if number >= count:
            break
        if number == 0:
            mine, other = own[0], less[0]
        elif number == 1:
            mine, other = own[1], less[1]
        elif number == 2:
            mine, other = own[2], less[2]
        elif number == 3:
            mine, other = own[3], less[3]
        elif number == 4:
            mine, other = own[4], less[4]
        else:
            mine, other = own[5], less[5]
        column = c + number
        rest = mine - other
        if x <= d < x + PANEL:
            equations.gradient[U(n + number)] += lane(rest, U(d - x))
        if x <= column < x + PANEL:
            equations.diagonal[U(n + number)] += lane(mine, U(column - x))
        if x < d and column < x + PANEL:
            below = from_lane(rest, U(max(column - x, 0)))
            to = at + U(column * storage.stride + x)
            add_some(storage.flat, to, below, U(min(PANEL, d - x)))


@njit(**UNWRAPPED)
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


@njit(**UNWRAPPED)
def exposure_of(o, scene):
    """The exposure of the image of ray o."""
    return scene.columns.exposure[U(scene.observations.image[U(o)])]


@njit(**UNWRAPPED)
def leads(k, start, scene):
    """Whether ray k of those from `start` on is the first of its exposure: others follow it."""
    return k == 0 or exposure_of(start + k, scene) != exposure_of(start + k - 1, scene)


@njit(**UNWRAPPED)
def group_size(p, last, scene):
    """How many points from p on, `GROUP` at most, the same images see; a given one stands alone."""
    start, img, given = scene.observations.start, scene.observations.image, scene.control.row
    m, count = start[p + 1] - start[p], 1
    if given[p] >= 0:
        return count
    while (
        count < GROUP
        and p + count < last
        and given[p + count] < 0
        and same_images(img, start[p], m, start[p + count], start[p + count + 1])
    ):
        count += 1
    return count


@njit(**UNWRAPPED)
def same_images(img, start, m, other, end):
    """Whether the rays other..end are those of the same m images as those from start on."""
    if m != end - other:
        return False
    for k in range(m):
        if img[U(start + k)] != img[U(other + k)]:
            return False
    return True


@njit(**UNWRAPPED)
def _span(p, scene, lo, hi):
    """Panels lo..hi of shared unknowns, and those that point p touches."""
    columns = scene.columns
    for o in range(scene.observations.start[p], scene.observations.start[p + 1]):
        i = U(scene.observations.image[U(o)])
        lo, hi = min(lo, columns.low[i]), max(hi, columns.high[i])
    given = scene.control.row[p]
    if given >= 0:
        for s in range(columns.ground.shape[1]):
            c = columns.ground[given, s]
            if c >= 0:
                lo, hi = min(lo, c // PANEL * PANEL), max(hi, c // PANEL * PANEL + PANEL)
    return lo, hi


@njit(**UNWRAPPED)
def _eliminate(p, place, span, scene, damping, equations, totals, room, work, kind):
    """Eliminate point p.

    place: its first ray in the room, how many there are, its number in its group; span: the panels
    of shared unknowns; kind: unknowns of an image, and whether image effects see points.
    """
    d, sighted = kind
    row, last_panel = inner_row_length(d), d // PANEL * PANEL
    # Where the residual stands, and n in Y.
    at_e = U(d - last_panel)
    n, m, waiting = place
    lo, hi = span
    columns, control = scene.columns, scene.control
    img, d_ground = scene.observations.image, scene.derivatives.ground
    own, shared, z, part = room.own, room.shared, work.z, work.part
    q = U(columns.wide)
    start = scene.observations.start[p]
    j_first, b_first = U(2 * n * row), U(2 * n) * q
    # Rows by the point, negative.
    by_point, p_first, p_next = own, j_first, U(row)
    if sighted:
        by_point, p_first, p_next = room.point, U(2 * n * PANEL), U(PANEL)
    w0, w1, w2, g0, g1, g2 = _no_products()
    for k in range(2 * m):
        at = p_first + U(k) * p_next
        a, x = three(by_point, at), panel(by_point, at)
        w0, w1, w2 = plus(w0, a[0], x), plus(w1, a[1], x), plus(w2, a[2], x)
        if sighted or last_panel > 0:
            x = panel(own, j_first + U(k * row + last_panel))
            g0, g1, g2 = plus(g0, a[0], x), plus(g1, a[1], x), plus(g2, a[2], x)
    if not (sighted or last_panel > 0):
        g0, g1, g2 = w0, w1, w2
    gp0, gp1, gp2 = -lane(g0, at_e), -lane(g1, at_e), -lane(g2, at_e)
    v0, v1, v2 = lane(w0, U(0)), lane(w0, U(1)), lane(w1, U(1))
    v3, v4, v5 = lane(w0, U(2)), lane(w1, U(2)), lane(w2, U(2))
    c0 = c1 = c2 = (0.0, 0.0, 0.0)
    given = control.row[p]
    if given >= 0:
        # Three more rows, one a coordinate: by the point those of G, by what is shared what the
        # effects on ground control say, after G.
        c0, c1, c2 = root_rows(control.root, given)
        w = control.weight
        v0, v1, v2 = v0 + w[given, 0], v1 + w[given, 1], v2 + w[given, 2]
        v3, v4, v5 = v3 + w[given, 3], v4 + w[given, 4], v5 + w[given, 5]
        for axis in range(3):
            c = c0 if axis == 0 else c1 if axis == 1 else c2
            work.residual[U(axis)] = dot(c, three_of(control.residual, given))
            b0 = U(axis) * q
            for r in range(lo, hi):
                work.control[b0 + U(r)] = 0.0
            for s in range(d_ground.shape[2]):
                r = columns.ground[given, s]
                if r >= 0:
                    by = d_ground[given, 0, s], d_ground[given, 1, s], d_ground[given, 2, s]
                    work.control[b0 + U(r)] += dot(c, by)
        e = work.residual[U(0)], work.residual[U(1)], work.residual[U(2)]
        gp0 += c0[0] * e[0] + c1[0] * e[1] + c2[0] * e[2]
        gp1 += c1[1] * e[1] + c2[1] * e[2]
        gp2 += c2[2] * e[2]
    grown = 1.0 + damping
    i0, i1, i2, i3, i4, i5, weak = invert_cholesky((v0 * grown, v1, v2 * grown, v3, v4, v5 * grown))
    totals[2] += weak
    right = i0 * gp0, i1 * gp0 + i2 * gp1, i3 * gp0 + i4 * gp1 + i5 * gp2

    # T = P L^-T of each ray, what the point leaves of its residuals, and Y, which rays of one
    # exposure have together.
    lead = np.int64(0)
    for k in range(m):
        j0, at = j_first + U(2 * k * row), p_first + U(2 * k) * p_next
        j1 = j0 + U(row)
        a, b = three(by_point, at), three(by_point, at + p_next)
        a = -i0 * a[0], -i1 * a[0] - i2 * a[1], -i3 * a[0] - i4 * a[1] - i5 * a[2]
        b = -i0 * b[0], -i1 * b[0] - i2 * b[1], -i3 * b[0] - i4 * b[1] - i5 * b[2]
        e0, e1 = own[j0 + U(d)] - dot(a, right), own[j1 + U(d)] - dot(b, right)
        at = U(8 * k)
        part[at], part[at + U(1)], part[at + U(2)], part[at + U(3)] = a[0], a[1], a[2], e0
        at += U(4)
        part[at], part[at + U(1)], part[at + U(2)], part[at + U(3)] = b[0], b[1], b[2], e1
        if not equations.matrix:
            i = exposure_of(start + k, scene)
            t = i if i < equations.split else i + equations.extra
            for r in range(d):
                more = own[j0 + U(r)] * e0 + own[j1 + U(r)] * e1
                equations.gradient[U(t * d + r)] += more
            continue
        follows = not leads(k, start, scene)
        lead = lead if follows else k
        at = U((lead * GROUP + waiting) * 3 * row)
        for x in range(0, row, PANEL):
            f, g = panel(own, j0 + U(x)), panel(own, j1 + U(x))
            y0, y1, y2 = a[0] * f + b[0] * g, a[1] * f + b[1] * g, a[2] * f + b[2] * g
            if follows:
                y0, y1 = y0 + panel(work.y, at + U(x)), y1 + panel(work.y, at + U(row + x))
                y2 = y2 + panel(work.y, at + U(2 * row + x))
            if x == last_panel:
                y0 = with_lane(y0, at_e, right[0])
                y1 = with_lane(y1, at_e, right[1])
                y2 = with_lane(y2, at_e, right[2])
            put(work.y, at + U(x), y0)
            put(work.y, at + U(row + x), y1)
            put(work.y, at + U(2 * row + x), y2)

    for x in range(lo, hi, PANEL):
        gradient, squares = zeros(), zeros()
        w0, w1, w2 = zeros(), zeros(), zeros()
        for k in range(2 * m):
            i = U(img[U(start + k // 2)])
            if x + PANEL <= columns.low[i] or x >= columns.high[i]:
                continue
            s = panel(shared, b_first + U(k) * q + U(x))
            gradient = plus(gradient, part[U(4 * k + 3)], s)
            squares = squares + s * s
            a = three(by_point, p_first + U(k) * p_next)
            w0, w1, w2 = plus(w0, a[0], s), plus(w1, a[1], s), plus(w2, a[2], s)
        add_some(equations.shared_gradient, U(x), gradient, U(PANEL))
        if not equations.matrix:
            continue
        add_some(equations.shared_diagonal, U(x), squares, U(PANEL))
        at = U(x)
        if given >= 0:
            s0, s1 = panel(work.control, at), panel(work.control, at + q)
            s2 = panel(work.control, at + q + q)
            w0 = plus(plus(plus(w0, -c0[0], s0), -c1[0], s1), -c2[0], s2)
            w1 = plus(plus(w1, -c1[1], s1), -c2[1], s2)
            w2 = plus(w2, -c2[2], s2)
        put(z, at, -i0 * w0)
        put(z, at + q, -i1 * w0 - i2 * w1)
        put(z, at + q + q, -i3 * w0 - i4 * w1 - i5 * w2)
        z0, z1, z2 = panel(z, at), panel(z, at + q), panel(z, at + q + q)
        for k in range(2 * m):
            b0, a = b_first + U(k) * q + at, three(part, U(4 * k))
            s = plus(panel(shared, b0), -a[0], z0)
            put(work.left, b0, plus(plus(s, -a[1], z1), -a[2], z2))
    if given >= 0 and d_ground.shape[2] > 0:
        for axis in range(3):
            c = c0 if axis == 0 else c1 if axis == 1 else c2
            a = i0 * c[0], i1 * c[0] + i2 * c[1], i3 * c[0] + i4 * c[1] + i5 * c[2]
            e0 = work.residual[U(axis)] - dot(a, right)
            b0 = U(axis) * q
            for r in range(lo, hi):
                f = work.control[b0 + U(r)]
                equations.shared_gradient[U(r)] += f * e0
                if equations.matrix:
                    equations.shared_diagonal[U(r)] += f * f
            if not equations.matrix:
                continue
            for x in range(lo, hi, PANEL):
                at = U(x)
                s = plus(panel(work.control, b0 + at), -a[0], panel(z, at))
                s = plus(plus(s, -a[1], panel(z, at + q)), -a[2], panel(z, at + q + q))
                for r in range(x, hi):
                    more = work.control[b0 + U(r)] * s
                    add_some(equations.block, U(r) * q + at, more, U(PANEL))


@njit(**UNWRAPPED)
def _add_group(p, place, span, scene, equations, room, work, d):
    """Add what a group's points have gathered; place: its first ray, rays of each, points."""
    first, m, points = place
    row = inner_row_length(d)
    lo, hi = span
    start, img, columns = scene.observations.start[p], scene.observations.image, scene.columns
    storage, matrix = equations.storage, equations.storage.flat
    own, y, left = room.own, work.y, work.left
    q, stride = U(scene.columns.wide), U(storage.stride)
    j_next, y_next = U(row), U(row)
    apart_j = U(2 * m * row), U(2 * m * row)
    apart_s = U(2 * m * row), U(2 * m) * q
    rows = 3 * points
    for k in range(m):
        i, led = exposure_of(start + k, scene), leads(k, start, scene)
        t = i if i < equations.split else i + equations.extra
        jk, sk = U(2 * (first + k) * row), U(2 * (first + k)) * q
        yk = U(k * GROUP * 3 * row)
        at = block_offset(i, i, t, d, storage)
        for c in range(0, d, 6):
            these = min(6, d - c)
            j_c, y_c = Strided(own, jk + U(c), j_next), Strided(y, yk + U(c), y_next)
            for x in range(0, row, PANEL):
                j_x, y_x = Strided(own, jk + U(x), j_next), Strided(y, yk + U(x), y_next)
                mine = _products_of_pairs(_no_products(), j_c, j_x, apart_j, points)
                gone = _no_products()
                if led:
                    gone = _products(gone, y_c, y_x, rows)
                _add_own(equations, t * d + c, at, mine, gone, these, (c, x, d))
            for x in range(lo, hi, PANEL):
                s_x = Strided(left, sk + U(x), q)
                sums = _products_of_pairs(_no_products(), j_c, s_x, apart_s, points)
                to = U(t * d + c) * q + U(x)
                _add_products(equations.cross, to, q, sums, these, U(PANEL), 1.0)
        for n in range(k + 1, m if led else k):
            if not leads(n, start, scene):
                continue
            at = block_offset(i, exposure_of(start + n, scene), t, d, storage)
            yn = U(n * GROUP * 3 * row)
            for c in range(0, d, 6):
                y_c = Strided(y, yk + U(c), y_next)
                for x in range(0, d, PANEL):
                    y_x = Strided(y, yn + U(x), y_next)
                    sums = _products(_no_products(), y_c, y_x, rows)
                    to = at + U(c) * stride + U(x)
                    these = min(6, d - c)
                    _add_products(matrix, to, stride, sums, these, U(min(PANEL, d - x)), -1.0)
    b_first = U(2 * first) * q
    # Whether all rays touch the same columns: mountings are each of one camera of a rig alone.
    alike = True
    for k in range(m):
        i, j = U(img[U(start + k)]), U(img[U(start)])
        alike = (
            alike and columns.first[i] == columns.first[j] and columns.last[i] == columns.last[j]
        )
    for c in range(lo, min(hi, scene.columns.used), 6):
        b_c = Strided(room.shared, b_first + U(c), q)
        for x in range(lo, min(hi, c + 6), PANEL):
            s_x = Strided(left, b_first + U(x), q)
            if alike:
                sums = _products(_no_products(), b_c, s_x, 2 * m * points)
            else:
                sums = _no_products()
                for k in range(m):
                    i, at = U(img[U(start + k)]), U(2 * k) * q
                    if columns.first[i] < c + 6 and columns.last[i] >= c:
                        b_k = Strided(room.shared, b_c.at + at, q)
                        s_k = Strided(left, s_x.at + at, q)
                        sums = _products_of_pairs(sums, b_k, s_k, (apart_s[1], apart_s[1]), points)
            _add_products(
                equations.block, U(c) * q + U(x), q, sums, min(6, hi - c), U(PANEL), 1.0
            )  # fmt: skip


def make_assemble(plain):
    """The assembly.

    plain: of images with six unknowns, whose effects see no object point: known when it is
    compiled, that makes it a third faster.
    """

    @compiled(**KERNEL)
    def core(first, last, scene, damping, equations, totals, room, work, kind):
        # No literals: all that takes them would be compiled once for each. LLVM knows them anyway.
        size, sighted = (np.int64(6), False) if plain else kind
        columns = scene.columns
        start = scene.observations.start
        p = first
        while p < last:
            # Whole groups of points that the same images see, until there are enough rays.
            stop, rays = p, np.int64(0)
            lo, hi = columns.wide, np.int64(0)
            while stop < last and rays < BLOCK:
                count = group_size(stop, last, scene)
                lo, hi = _span(stop, scene, lo, hi)
                rays += count * (start[stop + 1] - start[stop])
                stop += count
            cost, behind = fill_rows(p, stop, scene, room, (lo, hi), size)
            totals[0] += cost
            totals[1] += behind
            n = np.int64(0)
            while p < stop:
                m, count = start[p + 1] - start[p], group_size(p, last, scene)
                # No literal 0: what takes it would be compiled once more for that.
                lo, hi = _span(p, scene, columns.wide, np.int64(0))
                for k in range(count):
                    _eliminate(
                        p + k, (n + k * m, m, k), (lo, hi), scene, damping, equations, totals,
                        room, work, (size, sighted),
                    )  # fmt: skip
                if equations.matrix:
                    _add_group(p, (n, m, count), (lo, hi), scene, equations, room, work, size)
                p += count
                n += count * m

    def assemble(first, last, scene, damping, equations, totals, longest, kind):
        """Add the reduced normal equations of points first..last.

        totals (3,): cost, behind, weak directions. longest: the most rays of a point. kind: how
        many unknowns an image has (6 and the effects of its own), and whether effects on the image
        see object points.
        """
        wide, d = scene.columns.wide, kind[0]
        room = make_room(BLOCK + GROUP * longest, d, wide)
        work = Work(
            part=aligned(longest * 8),
            left=aligned(len(room.image) * 2 * wide),
            y=aligned(longest * GROUP * 3 * row_length(d)),
            control=aligned(3 * wide),
            residual=np.zeros(3),
            z=aligned(3 * wide),
        )
        core(first, last, scene, damping, equations, totals, room, work, kind)

    return assemble


@njit(**UNWRAPPED)
def _ray_sums(seen, n, first, count, scene, step, room, sums, kind):
    """What eight rays add to V, P'e and P'(e - the step's part), a row of 16 numbers each."""
    d, sighted = kind
    image, at = room.image, U(n)
    sx, sy = _interior_step(seen, scene.cameras, step, image, at)
    sx, sy = sloped(seen.slope, seen.root * sx, seen.root * sy)
    for c in range(step.image.shape[1]):
        dx, dy = of_rays(scene.derivatives.image, seen, n, first, count, scene, room, U(c))
        for k in range(PANEL):
            room.work[SPARE + U(k)] = step.image[U(image[U(n + k)]), U(c)]
        change = panel(room.work, SPARE)
        sx, sy = sx + change * dx, sy + change * dy
    c0, c1, c2, t0, t1, t2, _, _ = of_images(step.poses, U(d), U(0), image, at)
    turn, away = (t0, t1, t2), (zeros(), zeros(), zeros())
    if step.motion.shape[1] > 0:
        degree = step.motion.shape[1] - 1
        where = degree, U((degree + 1) * PANEL), U(0)
        away, theta, _, _ = camera_course(seen.place, step.motion, where, image, at)
        if scene.cameras.turns:
            turn = less(turn, left_jacobian(seen.turn, theta))
    away = less(cross(turn, seen.x), away)
    a, b = before(seen.by_x, seen.rotation), before(seen.by_y, seen.rotation)
    sx = sx + (dot(seen.by_x, away) - dot(a, (c0, c1, c2)))
    sy = sy + (dot(seen.by_y, away) - dot(b, (c0, c1, c2)))
    if sighted:
        for c in range(6):
            dx, dy = of_rays(scene.derivatives.sight, seen, n, first, count, scene, room, U(c))
            by = c0
            if c == 1:
                by = c1
            elif c == 2:
                by = c2
            elif c == 3:
                by = t0
            elif c == 4:
                by = t1
            elif c == 5:
                by = t2
            sx, sy = sx + dx * by, sy + dy * by
        a, b = sighted_points(seen, n, first, count, scene, room)
    e0, e1 = seen.left
    f0, f1 = e0 - sx, e1 - sy
    put_rows(
        sums, U(2 * n * PANEL), U(2 * PANEL),
        (
            a[0] * a[0] + b[0] * b[0],
            a[1] * a[0] + b[1] * b[0],
            a[1] * a[1] + b[1] * b[1],
            a[2] * a[0] + b[2] * b[0],
            a[2] * a[1] + b[2] * b[1],
            a[2] * a[2] + b[2] * b[2],
            a[0] * f0 + b[0] * f1,
            a[1] * f0 + b[1] * f1,
        ),
    )  # fmt: skip
    zero = zeros()
    put_rows(
        sums, U((2 * n + 1) * PANEL), U(2 * PANEL),
        (
            a[2] * f0 + b[2] * f1,
            a[0] * e0 + b[0] * e1,
            a[1] * e0 + b[1] * e1,
            a[2] * e0 + b[2] * e1,
            zero, zero, zero, zero,
        ),
    )  # fmt: skip


@compiled(late=True, **KERNEL)
def _substitute(first, last, scene, damping, step, moved, totals, room, sums, kind):
    start = scene.observations.start
    p = first
    while p < last:
        begin, n = p, np.int64(0)
        while p < last and n < BLOCK:
            n = add_point(p, n, scene, room)
            p += 1
        fill_up(n, room)
        for at in range(0, n, PANEL):
            seen, _ = see(at, start[begin], n, scene, room)
            _ray_sums(seen, at, start[begin], n, scene, step, room, sums, kind)
        at = U(0)
        for point in range(begin, p):
            a, b = zeros(), zeros()
            for _ in range(start[point + 1] - start[point]):
                a, b = a + panel(sums, at), b + panel(sums, at + U(PANEL))
                at += U(2 * PANEL)
            down, square = _move(point, a, b, scene, damping, step, moved)
            totals[0] += down
            totals[1] += square


def substitute(first, last, scene, damping, step, moved, totals, longest, kind):
    """The way back: move points first..last by a step.

    moved: (points, 3) receives the new points. totals (2,): the points' part of step . gradient and
    of step . diagonal . step. longest: the most rays of a point. kind: as of the assembly.
    """
    room = make_room(BLOCK + longest, kind[0], scene.columns.wide)
    sums = aligned(len(room.image) * 2 * PANEL)
    _substitute(first, last, scene, damping, step, moved, totals, room, sums, kind)


@njit(**UNWRAPPED)
def _interior_step(seen, cameras, step, image, n):
    """By how much a step of the interior moves the pixels of eight rays."""
    u, v, a, b = seen.lens
    f = seen.focal
    lower = of_images(step.interior, U(INNER), U(0), image, n)
    c0, c1, c2, c3, c4, c5, c6, c7 = lower
    by = interior_columns(u, v, a, b, f, same(1.0), zeros())
    sx, sy = c0 * by[0][0] + c1, c0 * by[0][1] + c2
    k2, k3, k4, k5, k6, k7, k8, _ = of_images(step.interior, U(INNER), U(PANEL), image, n)
    r2 = u * u + v * v
    radial = ((((((k8 * r2 + k7) * r2 + k6) * r2 + k5) * r2 + k4) * r2 + k3) * r2 + k2) * r2 + c7
    radial = radial * r2 * f
    bent_x = c3 * by[3][0] + c4 * by[4][0] + radial * u
    bent_y = c3 * by[3][1] + c4 * by[4][1] + radial * v
    if cameras.fisheye:
        b1, b2, u, v = affinity(seen, cameras, image, n)
        bent_x += b1 * bent_x + b2 * bent_y
    return sx + bent_x + f * (c5 * u + c6 * v), sy + bent_y


@njit(**UNWRAPPED)
def _move(p, a, b, scene, damping, step, moved):
    """Move one point; a, b: what its rays have added up (`ray_sums`).

    Returns its part of step . gradient and of step . diagonal . step.
    """
    control, d_ground = scene.control, scene.derivatives.ground
    v0, v1, v2, v3 = lane(a, U(0)), lane(a, U(1)), lane(a, U(2)), lane(a, U(3))
    v4, v5, t0, t1 = lane(a, U(4)), lane(a, U(5)), lane(a, U(6)), lane(a, U(7))
    t2, g0, g1, g2 = lane(b, U(0)), lane(b, U(1)), lane(b, U(2)), lane(b, U(3))
    given = control.row[p]
    if given >= 0:
        w = control.weight
        w0, w1, w2 = w[given, 0], w[given, 1], w[given, 2]
        w3, w4, w5 = w[given, 3], w[given, 4], w[given, 5]
        e0, e1, e2 = three_of(control.residual, given)
        v0, v1, v2, v3, v4, v5 = v0 + w0, v1 + w1, v2 + w2, v3 + w3, v4 + w4, v5 + w5
        g0 += w0 * e0 + w1 * e1 + w3 * e2
        g1 += w1 * e0 + w2 * e1 + w4 * e2
        g2 += w3 * e0 + w4 * e1 + w5 * e2
        for s in range(d_ground.shape[2]):
            c = scene.columns.ground[given, s]
            if c >= 0:
                e0 -= d_ground[given, 0, s] * step.shared[c]
                e1 -= d_ground[given, 1, s] * step.shared[c]
                e2 -= d_ground[given, 2, s] * step.shared[c]
        t0 += w0 * e0 + w1 * e1 + w3 * e2
        t1 += w1 * e0 + w2 * e1 + w4 * e2
        t2 += w3 * e0 + w4 * e1 + w5 * e2
    grown = 1.0 + damping
    i0, i1, i2, i3, i4, i5, _ = invert_cholesky((v0 * grown, v1, v2 * grown, v3, v4, v5 * grown))
    n0, n1, n2 = i0 * t0, i1 * t0 + i2 * t1, i3 * t0 + i4 * t1 + i5 * t2
    s0, s1, s2 = i0 * n0 + i1 * n1 + i3 * n2, i2 * n1 + i4 * n2, i5 * n2
    moved[p, 0] = scene.points[p, 0] + s0
    moved[p, 1] = scene.points[p, 1] + s1
    moved[p, 2] = scene.points[p, 2] + s2
    # With the reduced gradients this adds up to step . gradient of the whole system.
    n0, n1, n2 = i0 * g0, i1 * g0 + i2 * g1, i3 * g0 + i4 * g1 + i5 * g2
    return n0 * n0 + n1 * n1 + n2 * n2, s0 * v0 * s0 + s1 * v2 * s1 + s2 * v5 * s2
