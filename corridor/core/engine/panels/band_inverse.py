"""The inverse of a banded matrix inside its band, from its Cholesky factor.

What images share a point, and no more, is asked of the covariance of a block. With B = L L',
W = L_jj^-1 and G = L_rj W, r being the rows below a panel j of columns that it reaches,

    Z_rj = -Z_rr G    and    Z_jj = W' W + G' Z_rr G

go from the last panel to the first; Z_rr is known by then and lies in a square that fits the cache.
Source: Takahashi et al. 1973, "Formation of a sparse bus impedance matrix".
"""

from typing import NamedTuple

import numpy as np

from corridor.core.engine.compiled import KERNEL, UNWRAPPED, compiled, njit
from corridor.core.engine.panels.lanes import panel, plus, put, transposed, zeros
from corridor.core.engine.panels.triangular import (
    copy,
    gathered,
    keep,
    nothing,
    products,
    take_columns,
)
from corridor.core.engine.scene import PANEL

U = np.uint64


class _Room(NamedTuple):
    """Room for a panel of columns. A row r of the matrix has number r modulo `size` in it.

    columns: of L; w: W (8, 8); gain: G (size, 8); near: Z (size, size), its columns one after the
    other; moved: Z_rr G (8, size); left: (k, size); out: one column.
    """

    columns: np.ndarray
    w: np.ndarray
    gain: np.ndarray
    near: np.ndarray
    moved: np.ndarray
    left: np.ndarray
    out: np.ndarray


def invert_within(flat: np.ndarray, n: int, ld: int, left: np.ndarray, right: np.ndarray) -> None:
    """Entries of (L L')^-1 + left right' inside the band, in lower band storage (flat, n * ld).

    flat: L so stored, which they take the place of; left, right: (n, k).
    """
    two = 2 * PANEL
    # A panel, and all rows that one of its columns reaches.
    size = -(-(ld + two - 2) // two) * two
    k = left.shape[1]
    room = _Room(
        *(np.zeros(count) for count in (PANEL * (ld + 3 * PANEL), PANEL * PANEL, size * PANEL)),
        *(np.zeros(count) for count in (size * size, PANEL * size, k * size, size)),
    )
    both = (np.ascontiguousarray(side).ravel() for side in (left, right))
    _invert(flat, ld, n, *both, k, size, room)


@compiled(**KERNEL)
def _invert(band, ld, n, left, right, k, size, room):
    apart = ld + 3 * PANEL
    step, size = U(apart - 1), U(size)
    panels = -(-n // PANEL)
    for number in range(panels):
        j = (panels - 1 - number) * PANEL
        here = U(j) % size
        take_columns(band, ld, n, j, room.columns, U(0), apart)
        _invert_corner(room.columns, step, room.w)
        for at in range(U(0), size * U(PANEL), U(PANEL)):
            put(room.gain, at, zeros())
        last = min(j + ld + PANEL - 2, n - 1)
        for row in range(j + PANEL, last + 1):
            p = zeros()
            for c in range(U(PANEL)):
                p = plus(p, room.columns[U(row - j) + c * step], panel(room.w, c * U(PANEL)))
            put(room.gain, (U(row) % size) * U(PANEL), p)
        for at in range(U(0), size, U(2 * PANEL)):
            low, high = products(
                nothing(), nothing(), room.near, at, size, room.gain, U(0), U(PANEL), size
            )
            keep(low, room.moved, at, size)
            keep(high, room.moved, at + U(PANEL), size)
        own = gathered(nothing(), room.w, U(0), U(1), U(PANEL), room.w, U(0), U(PANEL), U(PANEL))
        own = gathered(own, room.moved, U(0), size, U(1), room.gain, U(0), U(PANEL), size)
        _put_near(room, here, size, own)
        for c in range(PANEL):
            row = (j + c) * k
            for q in range(k):
                # Rows beyond the last take part in nothing.
                room.left[U(q) * size + here + U(c)] = left[row + q] if j + c < n else 0.0
        for c in range(min(PANEL, n - j)):
            at = (here + U(c)) * size
            for i in range(U(0), size, U(PANEL)):
                p = panel(room.near, at + i)
                for q in range(k):
                    p = plus(p, right[(j + c) * k + q], panel(room.left, U(q) * size + i))
                put(room.out, i, p)
            rows, first, to = U(min(ld, n - j - c)), here + U(c), U((j + c) * ld)
            before = min(rows, size - first)
            copy(room.out, first, band, to, before)
            copy(room.out, U(0), band, to + before, rows - before)


@njit(**UNWRAPPED)
def _invert_corner(columns, step, w):
    """W, the inverse of the eight rows and columns of L at a diagonal."""
    for c in range(U(PANEL)):
        for r in range(U(PANEL)):
            total = 1.0 if r == c else 0.0
            for i in range(c, r):
                total -= columns[i * step + r] * w[i * U(PANEL) + c]
            w[r * U(PANEL) + c] = total / columns[r * step + r] if r >= c else 0.0


@njit(**UNWRAPPED)
def _put_near(room, here, size, own):
    """A panel's columns of Z, and as rows of the others, where `here` begins."""
    for at in range(U(0), size, U(PANEL)):
        rows = (
            -panel(room.moved, at),
            -panel(room.moved, at + size),
            -panel(room.moved, at + U(2) * size),
            -panel(room.moved, at + U(3) * size),
            -panel(room.moved, at + U(4) * size),
            -panel(room.moved, at + U(5) * size),
            -panel(room.moved, at + U(6) * size),
            -panel(room.moved, at + U(7) * size),
        )
        keep(rows, room.near, here * size + at, size)
        if at != here:
            keep(transposed(rows), room.near, at * size + here, size)
    keep(_even(own, transposed(own)), room.near, here * size + here, size)


@njit(**UNWRAPPED)
def _even(a, b):
    """The mean of a square and its transpose: what rounding makes uneven would grow and grow."""
    a0, a1, a2, a3, a4, a5, a6, a7 = a
    b0, b1, b2, b3, b4, b5, b6, b7 = b
    return (
        0.5 * (a0 + b0),
        0.5 * (a1 + b1),
        0.5 * (a2 + b2),
        0.5 * (a3 + b3),
        0.5 * (a4 + b4),
        0.5 * (a5 + b5),
        0.5 * (a6 + b6),
        0.5 * (a7 + b7),
    )
