"""Cholesky factor of equations that hang together like a chain, with a border.

    [ D0  C0'           ]
    [ C0  D1  C1'       ]  and below all of it a border, which touches every link.
    [     C1  D2  ...   ]

Images of a corridor meet their neighbours only: blocks as long as a link reaches make their
equations block tridiagonal. `adjustment.matrix` has them as a band, for few right sides; here there
are thousands, each of a few images, and blocks let them be solved with where they are felt alone.
Source: Golub and Van Loan 2013, "Matrix Computations", section 4.5.1 (block tridiagonal systems).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csc_array, csr_array, sparray

# Images that a block holds at least: smaller ones are work for Python and not for BLAS.
_FEWEST = 12
# Length of what is left of a right side, in its own, below which the rest of the chain is rounding.
FELT = 1e-11


@dataclass
class Half:
    """L^-1 of some right sides: rows (r1 - r0, k) from r0 on, zero elsewhere, and of the border."""

    first: int
    rows: np.ndarray
    border: np.ndarray

    def dot(self, other: Half) -> np.ndarray:
        """Products (k, other k): what the elimination takes away between right sides."""
        first = max(self.first, other.first)
        last = min(self.first + len(self.rows), other.first + len(other.rows))
        out = self.border.T @ other.border
        if first < last:
            mine = self.rows[first - self.first : last - self.first]
            out += mine.T @ other.rows[first - other.first : last - other.first]
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

    def half(self, right: np.ndarray) -> Half:
        """L^-1 right for right (n, k)."""
        inner = self.n - self.border
        return self._with_border(0, self._forward(right[:inner].copy()), right[inner:])

    def near(self, right: sparray) -> Half:
        """L^-1 right for sparse right (n, k) of a part of the chain: what is felt of it."""
        inner = self.n - self.border
        right = csr_array(right)
        inside = np.flatnonzero(np.diff(right.indptr)[:inner])
        border = right[inner:].toarray()
        if not len(inside):
            return self._with_border(0, np.zeros((0, right.shape[1])), border)
        begin = int(np.searchsorted(self.ends, inside.min(), side="right"))
        last = int(np.searchsorted(self.ends, inside.max(), side="right"))
        parts, length, before = [], np.zeros(right.shape[1]), None
        for k in range(begin, len(self.ends)):
            start, end = self.starts[k], self.ends[k]
            own = right[start:end].toarray() if k <= last else np.zeros((end - start, len(length)))
            if before is not None:
                own -= self._next[k - 1] @ before
            before = solve_triangular(
                self._own[k], own, lower=True, check_finite=False, overwrite_b=True
            )
            parts.append(before)
            square = np.einsum("ij,ij->j", before, before)
            length += square
            if k >= last and (square <= FELT**2 * length).all():
                break
        return self._with_border(int(self.starts[begin]), np.concatenate(parts), border)

    def taken(self, right: sparray) -> np.ndarray:
        """What the elimination takes away (k, k) among sparse right sides (n, k) of a part.

        The chain before the part stands in its factor, the chain behind it in `_closing`: of the
        solutions only the rows that the part touches are found, and half of what is symmetric.
        """
        right, inner = csr_array(right), self.n - self.border
        touched = np.flatnonzero(np.diff(right.indptr)[:inner])
        out = np.zeros((right.shape[1],) * 2)
        if len(touched):
            begin, last = np.searchsorted(self.ends, touched[[0, -1]], side="right").tolist()
            out += self._within(right[self.starts[begin] : self.ends[last]], begin, last)
        if self.border:
            moved = solve_triangular(
                self._inside,
                right[inner:].toarray() - (right[:inner].T @ self._follows).T,
                lower=True,
                check_finite=False,
            )
            out += moved.T @ moved
        return out

    def _within(self, right: csr_array, begin: int, last: int) -> np.ndarray:
        """right' N^-1 right (k, k) of blocks begin..last, the border aside."""
        by_column = csc_array(right)
        by_column.sort_indices()
        several = np.diff(by_column.indptr) > 0
        first = np.zeros(right.shape[1], dtype=np.int64)
        first[several] = by_column.indices[by_column.indptr[:-1][several]]
        # A column has nothing to say before its own first block, nor to those that begin later.
        order = np.argsort(first, kind="stable")
        start = int(self.starts[begin])
        many = np.searchsorted(first[order], self.ends[begin : last + 1] - start).tolist()
        right = right[:, order]
        rows = right.toarray()
        spans = [
            slice(int(self.starts[k]) - start, int(self.ends[k]) - start)
            for k in range(begin, last + 1)
        ]
        factors = [*self._own[begin:last], self._closing[last]]
        for k, (at, factor) in enumerate(zip(spans, factors, strict=True)):
            mine = rows[at, : many[k]]
            if k:
                mine[:, : many[k - 1]] -= (
                    self._next[begin + k - 1] @ rows[spans[k - 1], : many[k - 1]]
                )
            rows[at, : many[k]] = solve_triangular(factor, mine, lower=True, check_finite=False)
        for k in reversed(range(len(spans))):
            at, upto = spans[k], many[k]
            mine = rows[at, :upto]
            if k + 1 < len(spans):
                mine -= self._next[begin + k].T @ rows[spans[k + 1], :upto]
            rows[at, :upto] = solve_triangular(
                factors[k], mine, lower=True, trans=1, check_finite=False
            )
        # Of each pair the column that begins first is solved for wherever the other is.
        half = np.tril(right.T @ rows)
        out = np.empty_like(half)
        out[np.ix_(order, order)] = half + np.tril(half, -1).T
        return out

    @cached_property
    def _closing(self) -> list[np.ndarray]:
        """Factor of each block once all others are eliminated, those before it and those behind."""
        out, gone = [self._own[-1]], 0.0
        for k in reversed(range(len(self.ends) - 1)):
            after = self._own[k + 1] @ self._own[k + 1].T - gone
            # As it was before the blocks in front of it were eliminated.
            after += self._next[k] @ self._next[k].T
            link = self._next[k] @ self._own[k].T
            half = solve_triangular(
                cholesky(after, lower=True, check_finite=False),
                link,
                lower=True,
                check_finite=False,
            )
            gone = half.T @ half
            own = self._own[k] @ self._own[k].T - gone
            out.append(cholesky(own, lower=True, check_finite=False))
        return out[::-1]

    @cached_property
    def _follows(self) -> np.ndarray:
        """What the inner rows (n, border) do about a border that moves."""
        return self._backward(self._edge.copy())

    def _with_border(self, first: int, rows: np.ndarray, border: np.ndarray) -> Half:
        left = border - self._edge[first : first + len(rows)].T @ rows
        if self.border:
            left = solve_triangular(self._inside, left, lower=True, check_finite=False)
        return Half(first, rows, left)

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

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (n, k) for right (n, k)."""
        return self.other_half(self.half(right))

    def other_half(self, half: Half) -> np.ndarray:
        """L'^-1 (n, k) of a half of the whole chain."""
        rows, border = half.rows.copy(), half.border
        if self.border:
            border = solve_triangular(self._inside, border, lower=True, trans=1, check_finite=False)
            rows -= self._edge @ border
        return np.concatenate([self._backward(rows), border])

    def _backward(self, half: np.ndarray) -> np.ndarray:
        """In place."""
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
