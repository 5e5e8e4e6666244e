"""Cholesky factor of equations that hang together like a chain, with a border.

    [ D0  C0'           ]
    [ C0  D1  C1'       ]  and below all of it a border, which touches every link.
    [     C1  D2  ...   ]

Images of a corridor meet their neighbours only: blocks as long as a link reaches make their
equations block tridiagonal. `adjustment.matrix` has them as a band, for few right sides; here there
are hundreds, and blocks are work for BLAS.
Source: Golub and Van Loan 2013, "Matrix Computations", section 4.5.1 (block tridiagonal systems).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csc_array, csr_array

# Images that a block holds at least: smaller ones are work for Python and not for BLAS.
_FEWEST = 12


class Inverse(NamedTuple):
    """Inverse of a chain within its pattern.

    starts, ends: rows of each block. own: of each block, link: of each block's next with it, both
    as long as the border stays where it is; follows (n, border): what the inner rows do less about
    a border that moves; edge (border, border): of the border.
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
        inner = inner + np.einsum("ij,jk,ik->i", self.follows, self.edge, self.follows)
        return np.concatenate([inner, self.edge.diagonal()])

    def between(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Entries (k,) of pairs of rows, which lie in one block, in neighbours or in the border."""
        inner = len(self.follows)
        rows = [self._moved(each) for each in (one, other)]
        out = np.einsum("ij,jk,ik->i", rows[0], self.edge, rows[1])
        low, high = np.minimum(one, other), np.maximum(one, other)
        both = np.flatnonzero(high < inner)
        first, second = self.block_of(low[both]), self.block_of(high[both])
        for k in np.unique(first):
            start = self.starts[k]
            mine = both[(first == k) & (second == k)]
            out[mine] += self.own[k][low[mine] - start, high[mine] - start]
            mine = both[(first == k) & (second == k + 1)]
            if len(mine):
                out[mine] += self.link[k][high[mine] - self.starts[k + 1], low[mine] - start]
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
        out = np.einsum("ij,jk,ik->i", moved, self.edge, moved)
        touched = np.flatnonzero(np.diff(inside.indptr))
        block = self.block_of(inside.indices[inside.indptr[touched]])
        for k in np.unique(block):
            mine = touched[block == k]
            part = inside[mine][:, self.starts[k] : self.ends[k]].toarray()
            out[mine] += np.einsum("ij,ij->i", part @ self.own[k], part)
        return out


class Chain:
    """Factor of a matrix (n, n), symmetric, sparse, whose last `border` rows are the border.

    ends: rows behind the last of each block. Raises LinAlgError where it is not positive definite.
    """

    def __init__(self, matrix: csc_array, ends: np.ndarray, border: int):
        self.n, self.border = matrix.shape[0], border
        inner = self.n - border
        self.ends = ends = np.asarray(ends)
        self.starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)
        self._own: list[np.ndarray] = []
        self._next: list[np.ndarray] = []
        for k, (start, end) in enumerate(zip(self.starts, ends, strict=True)):
            after = ends[k + 1] if k + 1 < len(ends) else end
            columns = matrix[:, start:end]
            own = columns[start:end].toarray(order="F")
            if k:
                link = self._next[-1]
                own -= link @ link.T
            factor = cholesky(own, lower=True, check_finite=False, overwrite_a=True)
            self._own.append(factor)
            link = columns[end:after].toarray()
            if link.size:
                link = solve_triangular(factor, link.T, lower=True, check_finite=False).T
            self._next.append(link)
        edge = matrix[:, inner:]
        self._edge = self._forward(edge[:inner].toarray())
        inside = edge[inner:].toarray() - self._edge.T @ self._edge
        self._inside = cholesky(inside, lower=True, check_finite=False) if border else inside

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right (n, k) for right (n, k)."""
        inner = self.n - self.border
        rows = self._forward(right[:inner].copy())
        border = right[inner:] - self._edge.T @ rows
        if self.border:
            border = solve_triangular(self._inside, border, lower=True, check_finite=False)
        return np.concatenate([rows, border])

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half (n, k)."""
        inner = self.n - self.border
        rows, border = half[:inner].copy(), half[inner:]
        if self.border:
            border = solve_triangular(self._inside, border, lower=True, trans=1, check_finite=False)
            rows -= self._edge @ border
        return np.concatenate([self._backward(rows), border])

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (n, k) for right (n, k)."""
        return self.other_half(self.half(right))

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant."""
        parts = [*self._own, self._inside] if self.border else self._own
        return 2.0 * float(sum(np.log(one.diagonal()).sum() for one in parts))

    def inverse(self) -> Inverse:
        """The inverse where the matrix has blocks: of each link, with the next, and the border.

        Source: Takahashi, Fagan and Chin 1973 (inverse within the pattern of the factor).
        """
        own: list[np.ndarray] = []
        link: list[np.ndarray] = []
        for k in reversed(range(len(self.ends))):
            half = solve_triangular(
                self._own[k], np.eye(len(self._own[k])), lower=True, check_finite=False
            )
            mine = half.T @ half
            if own:
                across = self._next[k] @ half
                after = own[-1] @ across
                link.append(-after)
                mine += across.T @ after
            own.append(mine)
        edge = np.zeros((0, 0))
        if self.border:
            half = solve_triangular(
                self._inside, np.eye(self.border), lower=True, check_finite=False
            )
            edge = half.T @ half
        return Inverse(self.starts, self.ends, own[::-1], link[::-1], self._follows, edge)

    @cached_property
    def _follows(self) -> np.ndarray:
        """What the inner rows (n, border) do about a border that moves."""
        return self._backward(self._edge.copy())

    def _forward(self, right: np.ndarray) -> np.ndarray:
        """In place."""
        if not right.size:
            return right
        for k, start, end in self._blocks():
            if k:
                right[start:end] -= self._next[k - 1] @ right[self.starts[k - 1] : start]
            right[start:end] = solve_triangular(
                self._own[k], right[start:end], lower=True, check_finite=False
            )
        return right

    def _blocks(self) -> Iterator[tuple[int, int, int]]:
        return zip(range(len(self.ends)), self.starts.tolist(), self.ends.tolist(), strict=True)

    def _backward(self, half: np.ndarray) -> np.ndarray:
        """In place."""
        if not half.size:
            return half
        for k, start, end in reversed(list(self._blocks())):
            if k + 1 < len(self.ends):
                half[start:end] -= self._next[k].T @ half[end : self.ends[k + 1]]
            half[start:end] = solve_triangular(
                self._own[k], half[start:end], lower=True, trans=1, check_finite=False
            )
        return half


def block_ends(reach: np.ndarray) -> np.ndarray:
    """Images behind the last of each block of a chain: each block meets its neighbours only.

    reach (m,): the last image that each meets.
    """
    count = len(reach)
    farthest = np.maximum.accumulate(np.maximum(reach, np.arange(count)))
    ends = []
    end = min(max(int(farthest[0]) + 1, _FEWEST), count) if count else 0
    while end:
        ends.append(end)
        if end == count:
            break
        end = min(max(int(farthest[end - 1]) + 1, end + _FEWEST), count)
    return np.array(ends, dtype=np.int64)
