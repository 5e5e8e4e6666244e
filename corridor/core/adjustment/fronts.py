"""Cholesky factor of image blocks that hang together across an area, not along a corridor.

Eliminating an image leaves its neighbours with equations among themselves; an order that keeps
these few makes a tree. A *front* holds images that are eliminated together and the later ones they
meet, as dense matrices, which is work for BLAS: Cholesky of its own columns, and what is left of
the later ones is passed to the front that eliminates the first of these.
Source: Duff and Reid 1983 (multifrontal); George and Liu 1989 (minimum degree); Takahashi, Fagan
and Chin 1973 (inverse within the pattern of the factor).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from corridor.core.engine.scene import Storage

# Share of zeros in the columns of a front up to which images are eliminated together: BLAS does
# them faster than Python goes on to another front. Measured on a five-camera head, 1,264 images.
_ZEROS = 0.4


@dataclass
class Front:
    """Images that are eliminated together, numbered by the order of elimination.

    images: theirs (k,) and behind them the later ones they meet. own: how many are eliminated.
    parent: number of the front that gets what is left, -1 for none. runs: of the later images that
    follow one another in the parent, too: first and last here, and first there.
    block, row, column: blocks of the storage that belong here, and where; turned: whether the
    storage has one the other way round.
    """

    images: np.ndarray
    own: int
    parent: int
    runs: list[tuple[int, int, int]]
    block: np.ndarray
    row: np.ndarray
    column: np.ndarray
    turned: np.ndarray


class Tree:
    """In which order images are eliminated, and the fronts of it: of every matrix of one pattern.

    order (m,): images in that order. fronts: each before its parent.
    """

    def __init__(self, start: np.ndarray, neighbour: np.ndarray):
        """start, neighbour: the pattern, as `Storage` has it."""
        images = len(start) - 1
        column = np.repeat(np.arange(images), np.diff(start))
        place = _least_degree(images, neighbour, column)
        groups = _groups(place[neighbour], place[column], images)
        last = np.argsort(place)
        self.order = last[np.concatenate([own for own, _ in groups])]
        place = np.argsort(self.order)
        ends = np.cumsum([len(own) for own, _ in groups])
        front_of = np.repeat(np.arange(len(groups)), np.diff(ends, prepend=0))
        one, other = place[neighbour], place[column]
        first = front_of[np.minimum(one, other)]
        sort = np.argsort(first, kind="stable")
        bounds = np.searchsorted(first[sort], np.arange(len(groups) + 1))
        inside = [
            np.concatenate([np.arange(end - len(own), end), np.sort(place[last[later]])])
            for end, (own, later) in zip(ends, groups, strict=True)
        ]
        self.fronts = []
        for n, (mine, (own, later)) in enumerate(zip(inside, groups, strict=True)):
            parent = int(front_of[mine[len(own)]]) if len(later) else -1
            runs = _runs(np.searchsorted(inside[parent], mine[len(own) :])) if len(later) else []
            block = sort[bounds[n] : bounds[n + 1]]
            row, col = (
                np.searchsorted(mine, by(one[block], other[block]))
                for by in (np.maximum, np.minimum)
            )
            turned = one[block] < other[block]
            self.fronts.append(Front(mine, len(own), parent, runs, block, row, col, turned))


class FrontFactor:
    """L of a matrix = L L', front by front. weak: the first image and unknown of it whose column is
    not positive, None where all are: without a factor there are no solutions.

    pivots (n,): the diagonal of L, in the order of the images.
    """

    weak: tuple[int, int] | None = None

    def __init__(self, tree: Tree, flat: np.ndarray, d: int):
        """flat: the matrix at the places of `Storage`, which is left as it is."""
        self.tree, self.d = tree, d
        self.pivots = np.zeros((len(tree.order), d))
        blocks, fronts = flat.reshape(-1, d, d), tree.fronts
        self._own, self._link = [], []
        waiting: list[list[tuple[Front, np.ndarray]]] = [[] for _ in fronts]
        for n, front in enumerate(fronts):
            size, all_rows = front.own * d, len(front.images) * d
            blank = np.zeros((front.own, d, len(front.images), d))
            some = blocks[front.block]
            some[front.turned] = some[front.turned].transpose(0, 2, 1)
            blank[front.column, :, front.row] = some
            columns = blank.reshape(size, all_rows)
            own = np.array(columns[:, :size].T, order="F")
            link = np.array(columns[:, size:].T, order="F")
            behind = np.zeros((all_rows - size, all_rows - size), order="F")
            for child, left in waiting[n]:
                _add(child.runs, left, front.own, own, link, behind, d)
            waiting[n] = []
            own, info = dpotrf(own, lower=1, clean=1, overwrite_a=1)
            if info:
                image, unknown = divmod(info - 1, d)
                self.weak = int(tree.order[front.images[image]]), unknown
                return
            if link.size:
                link = dtrsm(1.0, own, link, side=1, lower=1, trans_a=1, overwrite_b=1)
                left = dsyrk(-1.0, link, beta=1.0, c=behind, lower=1, overwrite_c=1)
                waiting[front.parent].append((front, left))
            self._own.append(own)
            self._link.append(link)
            mine = tree.order[front.images[: front.own]]
            self.pivots[mine] = own.diagonal().reshape(-1, d)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right for right (n, k), in the order of elimination."""
        out = np.array(self._by_image(right)[self.tree.order], order="C")
        out = out.reshape(right.shape)
        for rows, later, own, link in self._each():
            out[rows] = dtrsm(1.0, own, out[rows].T, side=1, lower=1, trans_a=1).T
            if link.size:
                out[later] -= link @ out[rows]
        return out

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half for half (n, k), which is in the order of elimination."""
        out = np.array(half, dtype=float, order="C")
        for rows, later, own, link in reversed(list(self._each())):
            if link.size:
                out[rows] -= link.T @ out[later]
            out[rows] = dtrsm(1.0, own, out[rows].T, side=1, lower=1).T
        back = np.empty_like(self._by_image(out))
        back[self.tree.order] = self._by_image(out)
        return back.reshape(out.shape)

    def inverse(self, storage: Storage, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """(L L')^-1 + left right' (n, k) at the places of a storage, flat."""
        d, fronts = self.d, self.tree.fronts
        out = np.empty((len(storage.neighbour), d, d))
        left, right = self._by_image(left), self._by_image(right)
        column = np.repeat(
            np.arange(len(storage.neighbour_start) - 1), np.diff(storage.neighbour_start)
        )
        whole: list[np.ndarray] = [np.zeros((0, 0))] * len(fronts)
        todo = np.bincount([f.parent for f in fronts if f.parent >= 0], minlength=len(fronts))
        for n in reversed(range(len(fronts))):
            front, own, link = fronts[n], self._own[n], self._link[n]
            size = len(own)
            mine, _ = dpotri(own, lower=1)
            mine = np.tril(mine) + np.tril(mine, -1).T
            both = np.zeros((len(link), size))
            later = np.zeros((0, 0))
            if link.size:
                at = _within(front, d)
                later = whole[front.parent][np.ix_(at, at)]
                across = dtrsm(1.0, own, link, side=1, lower=1)
                both = -(later @ across)
                mine -= across.T @ both
                todo[front.parent] -= 1
                if not todo[front.parent]:
                    whole[front.parent] = np.zeros((0, 0))
            if todo[n]:
                whole[n] = np.block([[mine, both.T], [both, later]])
            columns = np.concatenate([mine, both]).reshape(-1, d, front.own, d)
            some = columns[front.row, :, front.column].transpose(0, 2, 1)
            some[front.turned] = some[front.turned].transpose(0, 2, 1)
            i, j = column[front.block], storage.neighbour[front.block]
            out[front.block] = some + right[i] @ left[j].transpose(0, 2, 1)
        return out.ravel()

    def _each(self):
        """Rows of each front that are its own, and later ones, with both parts of the factor."""
        every = np.arange(self.d)
        for front, own, link in zip(self.tree.fronts, self._own, self._link, strict=True):
            first = int(front.images[0]) * self.d
            later = (front.images[front.own :, None] * self.d + every).ravel()
            yield slice(first, first + len(own)), later, own, link

    def _by_image(self, rows: np.ndarray) -> np.ndarray:
        return rows.reshape(-1, self.d, *rows.shape[1:])


def _least_degree(images: int, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Place (m,) of each image in an order of least degree."""
    pattern = csc_array((np.ones(len(row)), (row, column)), shape=(images, images))
    pattern = csc_array(pattern + pattern.T + diags_array(np.full(images, 2.0 * images)))
    symmetric = {"SymmetricMode": True}
    return splu(
        pattern, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric
    ).perm_c.astype(np.int64)


def _groups(one: np.ndarray, other: np.ndarray, images: int) -> list[tuple[list[int], np.ndarray]]:
    """Images of each front, in an order of elimination, and the later ones that it meets.

    one, other: places of pairs of images that hang together.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    sort = np.lexsort((high, low))
    met = np.split(high[sort], np.searchsorted(low[sort], np.arange(1, images)))
    own: dict[int, list[int]] = {}
    later: dict[int, np.ndarray] = {}
    zeros: dict[int, int] = {}
    children: list[list[int]] = [[] for _ in range(images)]
    for n in range(images):
        below = [later[child] for child in children[n]]
        later[n] = np.setdiff1d(np.concatenate([met[n], *below]), [n])
        own[n], zeros[n] = [n], 0
        for child in sorted(children[n], key=lambda child: -len(later[child])):
            size, rows = len(own[child]) + len(own[n]), len(own[n]) + len(later[n])
            more = zeros[child] + zeros[n] + len(own[child]) * (rows - len(later[child]))
            if more <= _ZEROS * size * (size + len(later[n])):
                own[n], zeros[n] = own.pop(child) + own[n], more
        if len(later[n]):
            children[later[n][0]].append(n)
    return [(own[n], later[n]) for n in own]


def _runs(at: np.ndarray) -> list[tuple[int, int, int]]:
    """First and behind the last of those (k,) that follow one another, and where they begin."""
    cut = np.concatenate([[0], np.flatnonzero(np.diff(at) != 1) + 1, [len(at)]]).tolist()
    return [(a, b, int(at[a])) for a, b in zip(cut[:-1], cut[1:], strict=True)]


def _add(runs, left: np.ndarray, size: int, own, link, behind, d: int) -> None:
    """Add what a child has left of its later images (lower triangle) where its parent has them.

    size: images of the parent's own.
    """
    split = []
    for a, b, to in runs:
        edge = min(max(size - to, 0), b - a)
        split += [(a, a + edge, to)] * (edge > 0) + [(a + edge, b, to + edge)] * (a + edge < b)
    for n, (a, b, to) in enumerate(split):
        for first, last, row in split[n:]:
            into, down = (behind, size) if to >= size else (own, 0) if row < size else (link, size)
            over = size if to >= size else 0
            r, c = (row - down) * d, (to - over) * d
            part = left[first * d : last * d, a * d : b * d]
            into[r : r + part.shape[0], c : c + part.shape[1]] += part


def _within(front: Front, d: int) -> np.ndarray:
    """Rows of a front's later images in its parent."""
    at = np.concatenate([np.arange(to, to + b - a) for a, b, to in front.runs])
    return (at[:, None] * d + np.arange(d)).ravel()
