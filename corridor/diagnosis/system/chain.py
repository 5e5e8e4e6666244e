"""Cholesky factor of equations that hang together like a chain, with a border.

    [ D0  C0'  C0'      ]
    [ C0  D1   C1'  C1' ]  and below all of it a border, which touches every link.
    [ C0  C1   D2  ...  ]

Images of a corridor meet their neighbours only: each block of some images meets the rows behind it
as far as any image until there reaches. `adjustment.matrix` has them as a band, for few right
sides; here there are hundreds, and blocks are work for BLAS. Of an area, whose images meet others
far away, the chain branches (see `adjustment.fronts`).
Source: Golub and Van Loan 2013, "Matrix Computations", section 4.3.5 (band Cholesky, by blocks).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array

from corridor.core.adjustment import FrontFactor, Fronts, inverse_of, least_fill, solved

# Images of a block: smaller ones are work for Python and not for BLAS.
_FEWEST = 12
# Products that a chain may take, a tenth of a second, before it is asked whether to branch.
_QUICK = 2e9
# Share of a chain's products below which branches are worth their smaller blocks.
_WORTH = 0.5


class Inverse(NamedTuple):
    """Inverse of a chain within its pattern.

    layout: of the chain. own: of each block, link: of the rows behind it that it meets with it,
    both as long as the border stays where it is; follows (n, border): what the inner rows do less
    about a border that moves; edge (border, border): of the border.
    """

    layout: Layout
    own: list[np.ndarray]
    link: list[np.ndarray]
    follows: np.ndarray
    edge: np.ndarray

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
        layout, rows = self.layout, [self._moved(each) for each in (one, other)]
        out = ((rows[0] @ self.edge) * rows[1]).sum(axis=1)
        low, high = np.minimum(one, other), np.maximum(one, other)
        both = np.flatnonzero(high < inner)
        first, second = layout.block_of(low[both]), layout.block_of(high[both])
        for k in np.unique(first):
            start, later = layout.starts[k], layout.fronts.later[k]
            mine = both[(first == k) & (second == k)]
            out[mine] += self.own[k][low[mine] - start, high[mine] - start]
            mine = both[(first == k) & np.isin(high[both], later)]
            out[mine] += self.link[k][np.searchsorted(later, high[mine]), low[mine] - start]
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
        block = self.layout.block_of(inside.indices[inside.indptr[touched]])
        for k in np.unique(block):
            mine = touched[block == k]
            part = inside[mine][:, self.layout.starts[k] : self.layout.ends[k]].toarray()
            out[mine] += np.einsum("ij,ij->i", part @ self.own[k], part)
        return out


class Layout:
    """Where the entries of a matrix (n, n), symmetric, lie in the blocks of a chain.

    Matrices of one pattern and other values are many: the places are found once. One buffer holds
    each block (its lower triangle), the rows behind it that it meets, the border's rows and what is
    in the border's corner.
    """

    def __init__(self, fronts: Fronts, border: int):
        """fronts: the blocks. The last `border` rows are the border."""
        self.fronts, self.border = fronts, border
        self.starts, self.ends = fronts.starts, fronts.ends
        self.inner = int(self.ends[-1]) if len(self.ends) else 0
        self.n = self.inner + border
        self.size = self.ends - self.starts
        self.after = np.array([len(rows) for rows in fronts.later], dtype=np.int64)
        # Of each block its later rows, as numbers that rise from block to block.
        self._met = np.concatenate(
            [self.starts[:0], *(k * self.n + rows for k, rows in enumerate(fronts.later))]
        )
        self._begin = np.cumsum(self.after) - self.after
        self.first = np.concatenate([[0], np.cumsum(self.size * (self.size + self.after))])
        self._edge = int(self.first[-1])
        self._corner = self._edge + self.inner * border
        self.length = self._corner + border * border

    def block_of(self, rows: np.ndarray) -> np.ndarray:
        """Number of the block of inner rows."""
        return np.searchsorted(self.ends, rows, side="right")

    def places(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Places (k,) of the entries of pairs of rows, in the lower triangle."""
        low, high = np.minimum(one, other), np.maximum(one, other)
        out = self._corner + (low - self.inner) * self.border + high - self.inner
        outer = (low < self.inner) & (high >= self.inner)
        out[outer] = self._edge + low[outer] * self.border + high[outer] - self.inner
        inside = np.flatnonzero(high < self.inner)
        low, high = low[inside], high[inside]
        block = self.block_of(low)
        column, size = low - self.starts[block], self.size[block]
        within = high < self.ends[block]
        own = column * size + high - self.starts[block]
        behind = np.searchsorted(self._met, block * self.n + high) - self._begin[block]
        link = size * size + column * self.after[block] + behind
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
        self.layout, self.n, self.border = layout, layout.n, layout.border
        own, link, edge, corner = layout.views(values)
        self._inner = FrontFactor(layout.fronts, own, link)
        if self._inner.weak is not None:
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        self._edge, self._inside = self._inner.half(edge), corner
        if self.border:
            corner -= self._edge.T @ self._edge
            corner[:] = np.linalg.cholesky(corner)

    @classmethod
    def of(cls, matrix: csc_array, fronts: Fronts, border: int) -> Chain:
        """Factor of a sparse matrix in the blocks of `Layout(fronts, border)`."""
        layout, matrix = Layout(fronts, border), coo_array(matrix)
        lower = matrix.row >= matrix.col
        values = np.zeros(layout.length)
        at = layout.places(matrix.row[lower].astype(np.int64), matrix.col[lower].astype(np.int64))
        values[at] = matrix.data[lower]
        return cls(layout, values)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right (n, k) for right (n, k)."""
        inner = self.n - self.border
        out = np.array(right, dtype=float, order="C")
        rows = self._inner.half(out[:inner])
        if self.border:
            out[inner:] -= self._edge.T @ rows
            out[inner:] = solved(self._inside, out[inner:])
        return out

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half (n, k)."""
        inner = self.n - self.border
        out = np.array(half, dtype=float, order="C")
        if self.border:
            out[inner:] = solved(self._inside, out[inner:], turned=True)
            out[:inner] -= self._edge @ out[inner:]
        self._inner.other_half(out[:inner])
        return out

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (n, k) for right (n, k)."""
        return self.other_half(self.half(right))

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant."""
        corner = self._inside.diagonal() if self.border else []
        return 2.0 * float(np.log(self._inner.pivots).sum() + np.log(corner).sum())

    def inverse(self) -> Inverse:
        """The inverse where the matrix has blocks: of each, with what it meets, and the border."""
        own, link = ([np.zeros((0, 0))] * len(self.layout.fronts) for _ in range(2))
        for k, mine, both in self._inner.inverse():
            own[k], link[k] = mine, both
        edge = inverse_of(self._inside) if self.border else np.zeros((0, 0))
        return Inverse(self.layout, own, link, self._follows, edge)

    @cached_property
    def _follows(self) -> np.ndarray:
        """What the inner rows (n, border) do about a border that moves."""
        return self._inner.other_half(self._edge.copy())


def blocks_of(one: np.ndarray, other: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, Fronts]:
    """Images (m,) in the order of a chain, and the blocks of their rows; of an area it branches.

    one, other: pairs of images that hang together; count (m,): rows of each image.
    """
    images = len(count)
    reach = np.arange(images)
    np.maximum.at(reach, np.minimum(one, other), np.maximum(one, other))
    reach = np.maximum.accumulate(reach)
    ends = np.append(np.arange(_FEWEST, images, _FEWEST), images)
    ahead = [np.arange(end, max(int(reach[end - 1]) + 1, end)) for end in ends.tolist()]
    chain = Fronts(ends, ahead).of_rows(count)
    if chain.products > _QUICK:
        order, tree = least_fill(one, other, images)
        tree = tree.of_rows(count[order])
        if tree.products < _WORTH * chain.products:
            return order, tree
    return np.arange(images), chain
