"""The reduced normal equations: a symmetric matrix of image blocks bordered by what they share.

    [ B  E ] [dc]   [g]
    [ E' D ] [ds] = [h]

B belongs to the images (d unknowns each), D to what they share. B is a band along the corridor
(LAPACK lower band storage, Cholesky) or, where the band would cost more, blocks of those images
that share points, with a Cholesky factor of fronts.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import bsr_array, csc_array

from corridor.core.adjustment.fronts import FrontFactor, least_fill
from corridor.core.engine.interface import Engine, Factor
from corridor.core.engine.scene import Storage

# A pivot this small against the unknown's own diagonal is rounding: nothing determines it.
SINGULAR = 1e-13


class Singular(ArithmeticError):
    """The matrix has a direction without information.

    image, own: position and number of an image's unknown, or shared: number among the shared.
    """

    def __init__(self, image: int | None = None, own: int | None = None, shared: int | None = None):
        self.image, self.own, self.shared = image, own, shared
        super().__init__(f"image {image}, unknown {own}" if shared is None else f"shared {shared}")


class Blocks:
    """B (n, n), entries of images that share a point: storage, and what it holds: the factor, or
    None for the equations; what is made in one place is gone from there."""

    flat: np.ndarray
    stride: int
    neighbour_start: np.ndarray
    neighbour: np.ndarray
    holds: Any = None

    def __init__(self, images: int, d: int):
        self.images, self.d, self.n = images, d, images * d

    @property
    def storage(self) -> Storage:
        """As engines take it."""
        return Storage(self.flat, self.stride, self.neighbour_start, self.neighbour)

    def add_blocks(self, unknown: np.ndarray, blocks: np.ndarray) -> None:
        """Add symmetric blocks (k, l, l) of unknowns (k, l) of one image each, in rising order."""
        r, c = np.tril_indices(unknown.shape[1])
        at = self.storage.entries(unknown[:, r], unknown[:, c], self.d)
        np.add.at(self.flat, at, blocks[:, r, c])

    def _diagonal(self) -> np.ndarray:
        every = np.arange(self.n)
        return self.storage.entries(every, every, self.d).reshape(self.images, self.d)

    def add_diagonal(self, values: np.ndarray) -> None:
        """Add (images, d) to the diagonal."""
        self.flat[self._diagonal()] += values

    def multiply(self, x: np.ndarray) -> np.ndarray:
        """B x for x (n, k), before factorisation."""
        return self.symmetric() @ x

    def symmetric(self) -> csc_array:
        """B as a whole, before factorisation."""
        every = np.arange(self.d)
        return self.of_images(every, every)

    def _pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Images that have a block, the later and the earlier of each pair."""
        raise NotImplementedError

    def of_images(self, one: np.ndarray, other: np.ndarray) -> csc_array:
        """B (images * k, images * l) of some unknowns of every image, one (k,) and other (l,)."""
        later, earlier = self._pairs()
        row = np.concatenate([later, earlier[later != earlier]])
        column = np.concatenate([earlier, later[later != earlier]])
        order = np.lexsort((column, row))
        row, column = row[order], column[order]
        first, second = row[:, None, None] * self.d, column[:, None, None] * self.d
        value = self.storage.symmetric(first + one[:, None], second + other, self.d)
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=self.images))])
        shape = self.images * len(one), self.images * len(other)
        out = bsr_array((value, column, start), shape=shape).tocsc()
        out.eliminate_zeros()
        return out


class Band(Blocks):
    """B as a band: storage, Cholesky factor, solutions."""

    def __init__(self, images: int, d: int, width: int, rows: int, engine: Engine):
        """rows: of images, and behind them what pieces keep apart (see `Pieces`)."""
        super().__init__(images, d)
        self.engine, self.width = engine, min(width, images)
        self.ld = self.width * d
        self.stride = self.ld - 1
        self.flat = np.zeros(rows * d * self.ld)
        self.neighbour_start = np.zeros(0, dtype=np.int64)
        self.neighbour = np.zeros(0, dtype=np.int64)

    @property
    def rows(self) -> np.ndarray:
        """Of every image one, and of what lies apart behind."""
        return self.flat.reshape(-1, self.d * self.ld)

    def _pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the band those blocks that are not zero, by the column of each."""
        band = self.flat[: self.n * self.ld].reshape(self.images, self.d, self.width, self.d)
        # The first of a column's d numbers of one image are still of the image before.
        seen = np.asarray(band.any(axis=(1, 3)))
        seen[:, 1:] |= seen[:, :-1]
        earlier, apart = np.nonzero(seen)
        inside = earlier + apart < self.images
        return (earlier + apart)[inside], earlier[inside]

    def factor(self, reference: np.ndarray) -> Factor:
        """Cholesky in place. reference (images, d): diagonal before the points were eliminated.

        Raises Singular.
        """
        self.holds = self.engine.factor(self.flat, self.ld, self.n)
        if self.holds.weak is not None:
            raise Singular(*divmod(self.holds.weak, self.d))
        _refuse_weak(self.flat[self._diagonal()], reference)
        return self.holds

    def inverse(self, left: np.ndarray, right: np.ndarray) -> Storage:
        """B^-1 + left right' where the equations have entries, in place of the factor."""
        flat, self.flat, self.holds = self.flat, np.zeros(0), None
        self.engine.inverse(flat, self.ld, self.n, left, right)
        return self.storage._replace(flat=flat)


class Sparse(Blocks):
    """B as sparse blocks, factorised front by front. For blocks that are not corridors."""

    def __init__(self, images: int, d: int, ptr: np.ndarray, img: np.ndarray):
        super().__init__(images, d)
        self.stride = d
        self.neighbour_start, self.neighbour = neighbours(images, ptr, img)
        self.flat = np.zeros(len(self.neighbour) * d * d)

    @property
    def rows(self) -> np.ndarray:
        """What pieces add to, as one row: where there is one piece alone, nothing lies apart."""
        return self.flat[None]

    def _pairs(self) -> tuple[np.ndarray, np.ndarray]:
        return self.neighbour, np.repeat(np.arange(self.images), np.diff(self.neighbour_start))

    @cached_property
    def _places(self) -> _Places:
        """Where the blocks go: the same for all equations that are put here."""
        return _Places(self.neighbour_start, self.neighbour)

    def factor(self, reference: np.ndarray) -> SparseFactor:
        """As of `Band`."""
        self.holds = SparseFactor(self._places, self.flat, self.d)
        if self.holds.weak is not None:
            raise Singular(*divmod(self.holds.weak, self.d))
        _refuse_weak(self.holds.pivots, reference)
        return self.holds

    def inverse(self, left: np.ndarray, right: np.ndarray) -> Storage:
        """As of `Band`, with room of its own."""
        return self.storage._replace(flat=self.holds.inverse(left, right))


class _Places:
    """Where the blocks of a storage lie in fronts.

    order (m,): images as they are eliminated. earlier, later (k,): images of each block. Of each
    front blocks: those that belong there, their rows and columns among its images, and whether the
    storage has them the other way round.
    """

    def __init__(self, start: np.ndarray, neighbour: np.ndarray):
        images = len(start) - 1
        self.later, self.earlier = neighbour, np.repeat(np.arange(images), np.diff(start))
        self.order, self.fronts = least_fill(self.later, self.earlier, images)
        place = np.argsort(self.order)
        one, other = place[self.later], place[self.earlier]
        first = np.searchsorted(self.fronts.ends, np.minimum(one, other), side="right")
        sort = np.argsort(first, kind="stable")
        blocks = np.split(sort, np.searchsorted(first[sort], np.arange(1, len(self.fronts))))
        self.blocks = [
            (
                mine,
                self.fronts.within(n, np.maximum(one[mine], other[mine])),
                self.fronts.within(n, np.minimum(one[mine], other[mine])),
                one[mine] < other[mine],
            )
            for n, mine in enumerate(blocks)
        ]


class SparseFactor:
    """L of the blocks of a storage, as `Factor`. weak: the first row that is not positive."""

    def __init__(self, places: _Places, flat: np.ndarray, d: int):
        """flat: the blocks, which are left as they are."""
        self._places, self._d = places, d
        fronts = places.fronts
        own: list[np.ndarray] = []
        link: list[np.ndarray] = []
        for (block, row, column, turned), rows, size in zip(
            places.blocks, fronts.later, fronts.ends - fronts.starts, strict=True
        ):
            some = flat.reshape(-1, d, d)[block]
            some[turned] = some[turned].transpose(0, 2, 1)
            for part, mine, first, count in (
                (own, row < size, 0, size),
                (link, row >= size, size, len(rows)),
            ):
                columns = np.zeros((size, d, count, d))
                columns[column[mine], :, row[mine] - first] = some[mine]
                part.append(columns.reshape(size * d, count * d).T)
        order = places.order
        self._rows = (order[:, None] * d + np.arange(d)).ravel()
        self._factor = FrontFactor(fronts.of_rows(np.full(len(order), d)), own, link)
        weak = self._factor.weak
        self.weak = None if weak is None else int(self._rows[weak])

    @property
    def pivots(self) -> np.ndarray:
        """Diagonal (images, d) of L."""
        return self._back(self._factor.pivots).reshape(-1, self._d)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right for right (n, k), in the order of elimination."""
        return self._factor.half(np.ascontiguousarray(right[self._rows]))

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half for half (n, k), which is in the order of elimination."""
        return self._back(self._factor.other_half(np.array(half, order="C")))

    def inverse(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(L L')^-1 + left right' at the places of the storage."""
        d, places = self._d, self._places
        left, right = (one.reshape(len(one) // d, d, one.shape[1]) for one in (left, right))
        out = np.empty((len(places.later), d, d))
        for n, own, link in self._factor.inverse():
            block, row, column, turned = places.blocks[n]
            columns = np.concatenate([own, link]).reshape(-1, d, len(own) // d, d)
            some = columns[row, :, column].transpose(0, 2, 1)
            some[turned] = some[turned].transpose(0, 2, 1)
            i, j = places.earlier[block], places.later[block]
            out[block] = some + right[i] @ left[j].transpose(0, 2, 1)
        return out.ravel()

    def _back(self, rows: np.ndarray) -> np.ndarray:
        out = np.empty_like(rows)
        out[self._rows] = rows
        return out


def _refuse_weak(pivots: np.ndarray, reference: np.ndarray) -> None:
    """Raises Singular where the diagonal (images, d) of a factor is rounding beside `reference`."""
    weak = pivots**2 < SINGULAR * reference
    if weak.any():
        raise Singular(*(int(v) for v in np.argwhere(weak)[0]))


def neighbours(images: int, ptr: np.ndarray, img: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Images j >= i that share a point with image i, itself first: starts (m + 1,) and list."""
    point = np.repeat(np.arange(len(ptr) - 1), np.diff(ptr))
    seen = csc_array((np.ones(len(img)), (img, point)), shape=(images, len(ptr) - 1))
    linked = (seen @ seen.T).tocoo()
    keep = linked.row >= linked.col
    row, column = linked.row[keep], linked.col[keep]
    sort = np.lexsort((row, column))
    start = np.concatenate([[0], np.cumsum(np.bincount(column, minlength=images))])
    return start.astype(np.int64), row[sort].astype(np.int64)


class Bordered:
    """Solutions of the whole bordered system after `factor`, for as long as its storage holds it:
    what is asked of it later fails, and finds no wrong numbers."""

    def __init__(self, blocks: Band | Sparse, cross, block, shared_reference, reference):
        """cross (n, q), block (q, q) of the shared unknowns, lower half.

        The references are diagonals before elimination. Raises Singular.
        """
        self.blocks, self.q = blocks, block.shape[0]
        self._made = blocks.factor(reference)
        # L^-1 E: products need no more.
        self._solved = self._factor.half(cross) if self.q else np.zeros((blocks.n, 0))
        schur = np.tril(block) - np.tril(self._solved.T @ self._solved)
        self.shared_factor = _cholesky(schur, shared_reference)

    @property
    def _factor(self) -> Any:
        if self.blocks.holds is not self._made:
            raise RuntimeError(
                "the factor is gone: other equations, or the inverse, took its place"
            )
        return self._made

    def across(self) -> np.ndarray:
        """B^-1 E (n, q)."""
        return self._factor.other_half(self._solved)

    def solve(self, right: np.ndarray, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solution for right (n, k) and shared (q, k)."""
        half = self._factor.half(right)
        ds = self._shared_solution(shared - self._solved.T @ half)
        return self._factor.other_half(half - self._solved @ ds), ds

    def inverse(self, left: np.ndarray, right: np.ndarray) -> Storage:
        """B^-1 + left right' where the equations have entries; of a band in the factor's place."""
        _ = self._factor
        return self.blocks.inverse(left, right)

    def _shared_solution(self, right: np.ndarray) -> np.ndarray:
        if self.q == 0:
            return right
        half = solve_triangular(self.shared_factor, right, lower=True)
        return solve_triangular(self.shared_factor, half, lower=True, trans=1)

    def shared_inverse(self) -> np.ndarray:
        """Inverse (q, q) of the whole matrix, as far as it is shared."""
        return self._shared_solution(np.eye(self.q))


def _cholesky(matrix: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor (q, q). Raises Singular naming the first weak pivot."""
    scale = np.sqrt(np.maximum(reference, np.finfo(float).tiny))
    empty = np.flatnonzero(reference <= 0)
    if len(empty):
        raise Singular(shared=int(empty[0]))
    factor = np.tril(matrix / scale[:, None] / scale)
    for j in range(len(factor)):
        pivot = factor[j, j] - factor[j, :j] @ factor[j, :j]
        if not pivot > SINGULAR:
            raise Singular(shared=j)
        factor[j, j] = np.sqrt(pivot)
        factor[j + 1 :, j] -= factor[j + 1 :, :j] @ factor[j, :j]
        factor[j + 1 :, j] /= factor[j, j]
    return factor * scale[:, None]
