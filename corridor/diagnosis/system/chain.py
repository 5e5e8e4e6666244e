"""Cholesky factor of equations that hang together like a chain, with a border.

    [ D0  C0'  C0'      ]
    [ C0  D1   C1'  C1' ]  and below all of it a border, which touches every link.
    [ C0  C1   D2  ...  ]

Images of a corridor meet their neighbours only: each block of some images meets the rows behind it
as far as any image until there reaches. `adjustment.matrix` has them as a band, for few right
sides; here there are hundreds, and blocks are work for BLAS.
Source: Golub and Van Loan 2013, "Matrix Computations", section 4.3.5 (band Cholesky, by blocks).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import coo_array, csc_array, csr_array

# Images of a block: smaller ones are work for Python and not for BLAS.
_FEWEST = 12


class Inverse(NamedTuple):
    """Inverse of a chain within its pattern.

    starts, ends: rows of each block. own: of each block, link: of the rows behind it that it meets
    with it, both as long as the border stays where it is; follows (n, border): what the inner rows
    do less about a border that moves; edge (border, border): of the border.
    """

    starts: np.ndarray
    ends: np.ndarray
    own: list[np.ndarray]
    link: list[np.ndarray]
    follows: np.ndarray
    edge: np.ndarray

    def block_of(self, rows: np.ndarray) -> np.ndarray:
        """Number of the block of inner rows."""
        return np.searchsorted(self.ends, rows, side="right")

    def diagonal(self) -> np.ndarray:
        """Diagonal (n + border,)."""
        inner = np.concatenate([np.zeros(0), *(one.diagonal() for one in self.own)])
        inner = inner + ((self.follows @ self.edge) * self.follows).sum(axis=1)
        return np.concatenate([inner, self.edge.diagonal()])

    def between(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Entries (k,) of pairs of rows, of a block and what it meets, or of the border.

        Of others what they owe to the border alone.
        """
        inner = len(self.follows)
        rows = [self._moved(each) for each in (one, other)]
        out = ((rows[0] @ self.edge) * rows[1]).sum(axis=1)
        low, high = np.minimum(one, other), np.maximum(one, other)
        both = np.flatnonzero(high < inner)
        first, second = self.block_of(low[both]), self.block_of(high[both])
        for k in np.unique(first):
            start = self.starts[k]
            mine = both[(first == k) & (second == k)]
            out[mine] += self.own[k][low[mine] - start, high[mine] - start]
            met = high[both] < self.ends[k] + len(self.link[k])
            mine = both[(first == k) & (second > k) & met]
            out[mine] += self.link[k][high[mine] - self.ends[k], low[mine] - start]
        return out

    def _moved(self, rows: np.ndarray) -> np.ndarray:
        """What moves of rows (k, border) when the border does."""
        inner = len(self.follows)
        out = np.zeros((len(rows), self.edge.shape[0]))
        inside = rows < inner
        out[inside] = -self.follows[rows[inside]]
        out[np.flatnonzero(~inside), rows[~inside] - inner] = 1.0
        return out

    def variances(self, rows: csr_array) -> np.ndarray:
        """Of each of rows (k, n + border), which touches one block and the border, its variance."""
        inner = len(self.follows)
        inside = csr_array(rows[:, :inner])
        moved = rows[:, inner:].toarray() - inside @ self.follows
        out = ((moved @ self.edge) * moved).sum(axis=1)
        touched = np.flatnonzero(np.diff(inside.indptr))
        block = self.block_of(inside.indices[inside.indptr[touched]])
        for k in np.unique(block):
            mine = touched[block == k]
            part = inside[mine][:, self.starts[k] : self.ends[k]].toarray()
            out[mine] += np.einsum("ij,ij->i", part @ self.own[k], part)
        return out


class Layout:
    """Where the entries of a matrix (n, n), symmetric, lie in the blocks of a chain.

    Matrices of one pattern and other values are many: the places are found once. One buffer holds
    each block (its lower triangle), the rows behind it that it meets, the border's rows and what is
    in the border's corner.
    """

    def __init__(self, ends: np.ndarray, reach: np.ndarray, border: int):
        """ends: rows behind the last of each block; reach: behind the last that it meets. The last
        `border` rows are the border.
        """
        self.ends, self.border = np.asarray(ends, dtype=np.int64), border
        self.reach = np.asarray(reach, dtype=np.int64)
        self.inner = int(self.ends[-1]) if len(self.ends) else 0
        self.n = self.inner + border
        self.starts = np.concatenate([[0], self.ends[:-1]]).astype(np.int64)
        self.size = np.diff(self.ends, prepend=0)
        self.after = self.reach - self.ends
        self.first = np.concatenate([[0], np.cumsum(self.size * (self.size + self.after))])
        self._edge = int(self.first[-1])
        self._corner = self._edge + self.inner * border
        self.length = self._corner + border * border

    def places(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Places (k,) of the entries of pairs of rows, in the lower triangle."""
        low, high = np.minimum(one, other), np.maximum(one, other)
        out = self._corner + (low - self.inner) * self.border + high - self.inner
        outer = (low < self.inner) & (high >= self.inner)
        out[outer] = self._edge + low[outer] * self.border + high[outer] - self.inner
        inside = np.flatnonzero(high < self.inner)
        low, high = low[inside], high[inside]
        block = np.searchsorted(self.ends, low, side="right")
        column, size = low - self.starts[block], self.size[block]
        within = high < self.ends[block]
        own = column * size + high - self.starts[block]
        link = size * size + column * self.after[block] + high - self.ends[block]
        out[inside] = self.first[block] + np.where(within, own, link)
        return out

    def views(self, values: np.ndarray) -> tuple[list, list, np.ndarray, np.ndarray]:
        """Blocks, what each meets behind it, border (inner, border), and its corner."""
        own, link = [], []
        for first, size, after in zip(self.first, self.size, self.after, strict=False):
            square = first + size * size
            own.append(values[first:square].reshape((size, size), order="F"))
            both = values[square : square + size * after]
            link.append(both.reshape((after, size), order="F"))
        edge = values[self._edge : self._corner].reshape(self.inner, self.border)
        corner = values[self._corner :].reshape((self.border, self.border), order="F")
        return own, link, edge, corner


class Chain:
    """Factor of a matrix (n, n), symmetric, in the blocks of a layout, in place of its values.

    Raises LinAlgError where it is not positive definite.
    """

    def __init__(self, layout: Layout, values: np.ndarray):
        """values: of the lower triangle, at the layout's places; they are overwritten."""
        self.n, self.border = layout.n, layout.border
        self.starts, self.ends, self.reach = layout.starts, layout.ends, layout.reach
        self._own, self._next, edge, corner = layout.views(values)
        # What the blocks before do to the rows behind them (s, s), its lower triangle.
        done = np.zeros((0, 0))
        for own, link in zip(self._own, self._next, strict=True):
            size, ahead = min(len(own), len(done)), max(len(done) - len(own), 0)
            own[:size, :size] += done[:size, :size]
            if ahead:
                link[:ahead] += done[size:, :size]
            _factored(own)
            if link.size:
                dtrsm(1.0, own, link, side=1, lower=1, trans_a=1, overwrite_b=1)
            behind = np.zeros((len(link), len(link)), order="F")
            behind[:ahead, :ahead] = done[size:, size:]
            done = behind
            if link.size:
                done = dsyrk(-1.0, link, beta=1.0, c=behind, lower=1, overwrite_c=1)
        self._edge, self._inside = self._forward(edge), corner
        if self.border:
            corner -= self._edge.T @ self._edge
            _factored(corner)

    @classmethod
    def of(cls, matrix: csc_array, ends: np.ndarray, reach: np.ndarray, border: int) -> Chain:
        """Factor of a sparse matrix in the blocks of `Layout(ends, reach, border)`."""
        layout, matrix = Layout(ends, reach, border), coo_array(matrix)
        lower = matrix.row >= matrix.col
        values = np.zeros(layout.length)
        at = layout.places(matrix.row[lower].astype(np.int64), matrix.col[lower].astype(np.int64))
        values[at] = matrix.data[lower]
        return cls(layout, values)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right (n, k) for right (n, k)."""
        inner = self.n - self.border
        out = np.array(right, dtype=float, order="C")
        rows = self._forward(out[:inner])
        if self.border:
            out[inner:] -= self._edge.T @ rows
            out[inner:] = _solved(self._inside, out[inner:])
        return out

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half (n, k)."""
        inner = self.n - self.border
        out = np.array(half, dtype=float, order="C")
        if self.border:
            out[inner:] = _solved(self._inside, out[inner:], turned=True)
            out[:inner] -= self._edge @ out[inner:]
        self._backward(out[:inner])
        return out

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (n, k) for right (n, k)."""
        return self.other_half(self.half(right))

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant."""
        parts = [*self._own, self._inside] if self.border else self._own
        return 2.0 * float(sum(np.log(one.diagonal()).sum() for one in parts))

    def inverse(self) -> Inverse:
        """The inverse where the matrix has blocks: of each, with what it meets, and the border.

        Source: Takahashi, Fagan and Chin 1973 (inverse within the pattern of the factor).
        """
        own: list[np.ndarray] = []
        link: list[np.ndarray] = []
        # Of the rows from the start of the block behind on, as far as that one meets them.
        whole = np.zeros((0, 0))
        for factor, behind in zip(reversed(self._own), reversed(self._next), strict=True):
            size, met = len(factor), len(behind)
            mine = _inverse_of(factor)
            both = np.zeros((met, size))
            if met:
                across = dtrsm(1.0, factor, behind, side=1, lower=1)
                both = -(whole[:met, :met] @ across)
                mine -= across.T @ both
            of_block = np.empty((size + met, size + met))
            of_block[:size, :size], of_block[size:, :size] = mine, both
            of_block[:size, size:], of_block[size:, size:] = both.T, whole[:met, :met]
            whole = of_block
            own.append(mine)
            link.append(both)
        edge = _inverse_of(self._inside) if self.border else np.zeros((0, 0))
        return Inverse(self.starts, self.ends, own[::-1], link[::-1], self._follows, edge)

    @cached_property
    def _follows(self) -> np.ndarray:
        """What the inner rows (n, border) do about a border that moves."""
        return self._backward(self._edge.copy())

    def _forward(self, right: np.ndarray) -> np.ndarray:
        """In place."""
        if not right.size:
            return right
        for k, start, end, reach in self._blocks():
            right[start:end] = _solved(self._own[k], right[start:end])
            right[end:reach] -= self._next[k] @ right[start:end]
        return right

    def _blocks(self) -> Iterator[tuple[int, int, int, int]]:
        rows = (self.starts.tolist(), self.ends.tolist(), self.reach.tolist())
        return zip(range(len(self.ends)), *rows, strict=True)

    def _backward(self, half: np.ndarray) -> np.ndarray:
        """In place."""
        if not half.size:
            return half
        for k, start, end, reach in reversed(list(self._blocks())):
            half[start:end] -= self._next[k].T @ half[end:reach]
            half[start:end] = _solved(self._own[k], half[start:end], turned=True)
        return half


def _factored(matrix: np.ndarray) -> None:
    """Cholesky factor of a matrix (n, n), columns first, of its lower triangle, in its place."""
    _, info = dpotrf(matrix, lower=1, clean=1, overwrite_a=1)
    if info:
        raise np.linalg.LinAlgError("the matrix is not positive definite")


def _solved(factor: np.ndarray, right: np.ndarray, turned: bool = False) -> np.ndarray:
    """L^-1 right, or L'^-1 right, for right (n, k) whose rows come first."""
    return dtrsm(1.0, factor, right.T, side=1, lower=1, trans_a=0 if turned else 1).T


def _inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of the matrix that a factor is of."""
    out, _ = dpotri(factor, lower=1)
    return np.tril(out) + np.tril(out, -1).T


def blocks_of(reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Images behind the last of each block of a chain, and behind the last that each meets.

    reach (m,): the last image that each meets.
    """
    count = len(reach)
    farthest = np.maximum.accumulate(np.maximum(reach, np.arange(count)))
    ends = np.append(np.arange(_FEWEST, count, _FEWEST), [count] * bool(count)).astype(np.int64)
    return ends, np.maximum(farthest[ends - 1] + 1, ends)
