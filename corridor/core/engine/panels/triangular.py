"""Cholesky factor of a band, and solutions with it.

Matrices of a corridor are long and narrow: what LAPACK gains with large blocks is lost in them.
Here a panel of columns takes in all columns before it while they are in the cache, sixteen rows at
a time in registers. Source: Golub and Van Loan 2013, "Matrix computations", sections 4.2 and 4.3.

A band is stored as LAPACK stores a lower one: entry (i, j) as number j * ld + i - j.
"""

import numpy as np
from scipy.linalg.blas import dtbsv
from scipy.linalg.lapack import dpbtrf

from corridor.core.engine.compiled import KERNEL, UNWRAPPED, compiled, njit
from corridor.core.engine.panels.lanes import panel, plus, put, zeros
from corridor.core.engine.scene import PANEL

U = np.uint64
# Rows at a time, and how many columns the room takes before those that still count are moved.
_ROWS = 2 * PANEL
_COLUMNS = 256
# In wider bands the columns before a panel no longer fit the cache, and LAPACK's blocks gain.
_WIDE = 450


def factor(band, ld, n) -> int | None:
    """Cholesky factor of the first n columns in place.

    Returns the number of the first column that is not positive, None where all are.
    """
    if ld > _WIDE:
        whole = band[: n * ld].reshape(n, ld).T
        made, info = dpbtrf(whole, lower=1, overwrite_ab=1)
        if not np.shares_memory(made, band):
            whole[:] = made
        return info - 1 if info else None
    room = np.zeros((ld + PANEL + _COLUMNS) * (ld + _ROWS + PANEL))
    weak = _factor(band, ld, n, room, np.zeros(PANEL * PANEL))
    return weak if weak < n else None


@compiled(**KERNEL)
def _factor(band, ld, n, room, corner):
    # Columns in the room have zeros behind: rows beyond the band need no second look.
    apart = ld + _ROWS + PANEL
    step = U(apart - 1)
    base, fits = 0, len(room) // apart
    for j in range(0, n, PANEL):
        if j + PANEL - base > fits:
            # What is further away than the band is wide has done its part.
            kept = min(ld, j)
            copy(room, U((j - kept - base) * apart), room, U(0), U(kept * apart))
            base = j - kept
        here, width = U(j - base), min(PANEL, n - j)
        diagonal = here * U(apart)
        take_columns(band, ld, n, j, room, diagonal, apart)
        first = max(j - ld + 1, 0)
        at = U(first - base) * step + here
        sums = products(nothing(), nothing(), room, at, step, room, at, step, U(j - first))[0]
        keep(sums, corner, U(0), U(PANEL))
        weak = _factor_corner(room, diagonal, step, corner)
        if weak < PANEL:
            return j + weak
        for i in range(j + PANEL, min(j + PANEL + ld - 1, n), _ROWS):
            first = min(max(i - ld + 1, 0), j)
            at, of = U(first - base) * step, U(i - base)
            low, high = products(
                nothing(), nothing(), room, at + of, step, room, at + here, step, U(j - first)
            )
            of += here * step
            _finish(low, room, of, diagonal, step)
            _finish(high, room, of + U(PANEL), diagonal, step)
        for c in range(width):
            at, rows = U((j + c - base) * apart), U(min(ld, n - j - c))
            copy(room, at, band, U((j + c) * ld), rows)
    return n


@njit(**UNWRAPPED)
def take_columns(band, ld, n, j, room, at, apart):
    """Eight columns of the band, with zeros behind; beyond the last those of a unit matrix."""
    for c in range(PANEL):
        rows = U(max(min(ld, n - j - c), 0))
        copy(band, U((j + c) * ld), room, at, rows)
        for r in range(at + rows, at + U(apart)):
            room[r] = 0.0
        if j + c >= n:
            room[at] = 1.0
        at += U(apart)


@njit(**UNWRAPPED)
def copy(a, at, b, to, count):
    """b[to : to + count] = a[at : at + count]; `to` is not behind `at` where they are the same."""
    for _ in range(count // U(PANEL)):
        put(b, to, panel(a, at))
        at += U(PANEL)
        to += U(PANEL)
    for r in range(count % U(PANEL)):
        b[to + U(r)] = a[at + U(r)]


@njit(**UNWRAPPED)
def _factor_corner(room, diagonal, step, corner):
    """Factorise the eight rows and columns at a diagonal, less the sums in `corner` (columns).

    Returns the number of the first column that is not positive, else eight.
    """
    for c in range(PANEL):
        at = diagonal + U(c) * (step + U(1))
        for r in range(PANEL - c):
            room[at + U(r)] -= corner[U(c * PANEL + c + r)]
        for d in range(c):
            of = diagonal + U(d) * step + U(c)
            for r in range(PANEL - c):
                room[at + U(r)] -= room[of] * room[of + U(r)]
        if not room[at] > 0.0:
            return c
        inverse = 1.0 / np.sqrt(room[at])
        for r in range(PANEL - c):
            room[at + U(r)] *= inverse
    return PANEL


@njit(**UNWRAPPED)
def nothing():
    """Eight empty sums."""
    return zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros(), zeros()


@njit(**UNWRAPPED)
def products(low, high, a, at, apart, b, of, step, count):
    """Add a(i, k) b(k, c), over so many k, to sum c of eight, each of eight rows i.

    low, high: sums of the rows from `at` on, and of the next eight. at, of: where rows i and c
    begin for the first k; apart, step: how much further they do for the next.
    """
    s0, s1, s2, s3, s4, s5, s6, s7 = low
    t0, t1, t2, t3, t4, t5, t6, t7 = high
    for _ in range(count):
        p, q = panel(a, at), panel(a, at + U(PANEL))
        s0, t0 = plus(s0, b[of], p), plus(t0, b[of], q)
        s1, t1 = plus(s1, b[of + U(1)], p), plus(t1, b[of + U(1)], q)
        s2, t2 = plus(s2, b[of + U(2)], p), plus(t2, b[of + U(2)], q)
        s3, t3 = plus(s3, b[of + U(3)], p), plus(t3, b[of + U(3)], q)
        s4, t4 = plus(s4, b[of + U(4)], p), plus(t4, b[of + U(4)], q)
        s5, t5 = plus(s5, b[of + U(5)], p), plus(t5, b[of + U(5)], q)
        s6, t6 = plus(s6, b[of + U(6)], p), plus(t6, b[of + U(6)], q)
        s7, t7 = plus(s7, b[of + U(7)], p), plus(t7, b[of + U(7)], q)
        at += apart
        of += step
    return (s0, s1, s2, s3, s4, s5, s6, s7), (t0, t1, t2, t3, t4, t5, t6, t7)


@njit(**UNWRAPPED)
def keep(sums, out, at, apart):
    """out[at + k * apart :][:8] = sum k of eight."""
    for _ in range(PANEL):
        s0, s1, s2, s3, s4, s5, s6, s7 = sums
        put(out, at, s0)
        sums = s1, s2, s3, s4, s5, s6, s7, s0
        at += apart


@njit(**UNWRAPPED)
def _finish(sums, room, at, diagonal, step):
    """Make eight rows of the factor from what the columns before the panel sum up to.

    at, diagonal: where the rows begin in its first column, and that one's diagonal.
    """
    for _ in range(PANEL):
        s0, s1, s2, s3, s4, s5, s6, s7 = sums
        p = (panel(room, at) - s0) * (1.0 / room[diagonal])
        put(room, at, p)
        # The columns to come take this one in as well; what is behind the last is not looked at.
        s1 = plus(s1, room[diagonal + U(1)], p)
        s2 = plus(s2, room[diagonal + U(2)], p)
        s3 = plus(s3, room[diagonal + U(3)], p)
        s4 = plus(s4, room[diagonal + U(4)], p)
        s5 = plus(s5, room[diagonal + U(5)], p)
        s6 = plus(s6, room[diagonal + U(6)], p)
        s7 = plus(s7, room[diagonal + U(7)], p)
        sums = s1, s2, s3, s4, s5, s6, s7, s7
        at += step
        diagonal += step + U(1)


# --- solutions --------------------------------------------------------------------------------


class Factor:
    """See `corridor.core.engine.interface.Factor`."""

    def __init__(self, band, ld, n):
        self._of = band, ld, n
        self.weak = factor(*self._of)

    def half(self, right):
        return forward(*self._of, right)

    def other_half(self, right):
        return backward(*self._of, right)


def forward(band, ld, n, right):
    """L^-1 right (n, m) for a factor L (n, n)."""
    if right.shape[1] == 1:
        return dtbsv(ld - 1, band[: n * ld].reshape(n, ld).T, right[:, 0], lower=1)[:, None]
    wide = _wide(right)
    _forward(band, ld, n, wide.ravel(), wide.shape[1])
    return wide[:, : right.shape[1]]


def backward(band, ld, n, right):
    """L'^-1 right (n, m) for a factor L (n, n)."""
    if right.shape[1] == 1:
        lower = band[: n * ld].reshape(n, ld).T
        return dtbsv(ld - 1, lower, right[:, 0], lower=1, trans=1)[:, None]
    wide = _wide(right)
    _backward(band, ld, n, wide.ravel(), wide.shape[1])
    return wide[:, : right.shape[1]]


def _wide(right):
    """A copy in whole panels."""
    wide = np.zeros((len(right), -(-right.shape[1] // PANEL) * PANEL))
    wide[:, : right.shape[1]] = right
    return wide


@compiled(**KERNEL)
def _forward(band, ld, n, right, m):
    ld, n, m = U(ld), U(n), U(m)
    step = ld - U(1)
    for j in range(U(0), n, U(PANEL)):
        after, whole = _rows_of(j, ld, n)
        for at in range(U(0), m, U(PANEL)):
            for k in range(j, after):
                p = panel(right, k * m + at) * (1.0 / band[k * ld])
                put(right, k * m + at, p)
                for i in range(k + U(1), min(after, k + ld)):
                    q = panel(right, i * m + at)
                    put(right, i * m + at, plus(q, -band[k * step + i], p))
                for i in range(max(whole, after), min(k + ld, n)):
                    q = panel(right, i * m + at)
                    put(right, i * m + at, plus(q, -band[k * step + i], p))
            if whole > after:
                _take_eight(band, j * ld, step, right, j * m + at, m, whole - after)


@njit(**UNWRAPPED)
def _rows_of(j, ld, n):
    """The row behind the panel that begins with column j, and behind those all of it reaches."""
    after = min(j + U(PANEL), n)
    return after, min(j + ld, n) if after == j + U(PANEL) else after


@njit(**UNWRAPPED)
def _take_eight(band, diagonal, step, right, at, m, rows):
    """Take eight columns times their solution from so many rows below them."""
    y0, y1 = -panel(right, at), -panel(right, at + m)
    y2, y3 = -panel(right, at + U(2) * m), -panel(right, at + U(3) * m)
    y4, y5 = -panel(right, at + U(4) * m), -panel(right, at + U(5) * m)
    y6, y7 = -panel(right, at + U(6) * m), -panel(right, at + U(7) * m)
    for i in range(U(PANEL), U(PANEL) + rows):
        of, to = diagonal + i, at + i * m
        p = plus(panel(right, to), band[of], y0)
        p = plus(p, band[of + step], y1)
        p = plus(p, band[of + U(2) * step], y2)
        p = plus(p, band[of + U(3) * step], y3)
        p = plus(p, band[of + U(4) * step], y4)
        p = plus(p, band[of + U(5) * step], y5)
        p = plus(p, band[of + U(6) * step], y6)
        put(right, to, plus(p, band[of + U(7) * step], y7))


@compiled(**KERNEL)
def _backward(band, ld, n, right, m):
    ld, n, m = U(ld), U(n), U(m)
    step = ld - U(1)
    panels = (n + U(PANEL - 1)) // U(PANEL)
    for number in range(panels):
        j = (panels - U(1) - U(number)) * U(PANEL)
        after, whole = _rows_of(j, ld, n)
        for at in range(U(0), m, U(PANEL)):
            if whole > after:
                _gather_eight(band, j * ld, step, right, j * m + at, m, whole - after)
            for c in range(after - j):
                k = after - U(1) - U(c)
                p = panel(right, k * m + at)
                for i in range(k + U(1), min(after, k + ld)):
                    p = plus(p, -band[k * step + i], panel(right, i * m + at))
                for i in range(max(whole, after), min(k + ld, n)):
                    p = plus(p, -band[k * step + i], panel(right, i * m + at))
                put(right, k * m + at, p * (1.0 / band[k * ld]))


@njit(**UNWRAPPED)
def _gather_eight(band, diagonal, step, right, at, m, rows):
    """Take so many rows below eight columns, times their solution, from the eight."""
    below, of = at + U(PANEL) * m, diagonal + U(PANEL)
    sums = gathered(nothing(), band, of, step, U(1), right, below, m, rows)
    for _ in range(PANEL):
        s0, s1, s2, s3, s4, s5, s6, s7 = sums
        put(right, at, panel(right, at) - s0)
        sums = s1, s2, s3, s4, s5, s6, s7, s0
        at += m


@njit(**UNWRAPPED)
def gathered(sums, a, of, step, along, b, at, apart, count):
    """Add a(c, k) b(k, :8), over so many k, to sum c of eight.

    of, at: where both begin; step: from one c to the next; along, apart: from one k to the next.
    """
    s0, s1, s2, s3, s4, s5, s6, s7 = sums
    for _ in range(count):
        p = panel(b, at)
        s0 = plus(s0, a[of], p)
        s1 = plus(s1, a[of + step], p)
        s2 = plus(s2, a[of + U(2) * step], p)
        s3 = plus(s3, a[of + U(3) * step], p)
        s4 = plus(s4, a[of + U(4) * step], p)
        s5 = plus(s5, a[of + U(5) * step], p)
        s6 = plus(s6, a[of + U(6) * step], p)
        s7 = plus(s7, a[of + U(7) * step], p)
        of += along
        at += apart
    return s0, s1, s2, s3, s4, s5, s6, s7
