"""Cholesky factor of sparse equations, front by front.

Eliminating a row leaves those that it meets with equations among themselves. A *front* holds rows
that are eliminated together and the later ones they meet, as dense matrices, which is work for
BLAS: Cholesky of its own columns, and what is left of the later ones goes to the front that
eliminates the first of these, its *parent*. Of a corridor the fronts are a chain; of an area, in an
order that leaves few equations, they are a tree.
Source: Duff and Reid 1983 (multifrontal); George and Liu 1989 (minimum degree); Takahashi, Fagan
and Chin 1973 (inverse within the pattern of the factor).
"""

from __future__ import annotations

from collections.abc import Iterator, Sized

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

# What is passed on to another front takes as long as so many products of images more in one: for
# each pair of images, and for the front itself. Measured on a five-camera head of 1,264 images.
_PAIR, _FRONT = 3.0, 1e4


class Fronts:
    """Which rows, or images, are eliminated together, numbered in the order of elimination.

    starts, ends (k,): the first of each front's own and behind the last. later: of each, those that
    it meets behind its own, rising. parent (k,): number of the front that gets what is left, -1 for
    none. runs: of each, first and behind the last of those later ones that follow one another in
    the parent, too, and the first there.
    """

    def __init__(self, ends: np.ndarray, later: list[np.ndarray]):
        """Every later one has to be its parent's own, or among those that its parent meets."""
        self.ends, self.later = np.asarray(ends, dtype=np.int64), later
        self.starts = np.concatenate([[0], self.ends[:-1]]).astype(np.int64)[: len(self.ends)]
        first = np.array([rows[0] if len(rows) else -1 for rows in later], dtype=np.int64)
        parent = np.searchsorted(self.ends, first, side="right")
        self.parent = np.where(first >= 0, parent, -1).tolist()
        self.runs = [
            _runs(self.within(front, rows)) if front >= 0 else []
            for front, rows in zip(self.parent, later, strict=True)
        ]

    def __len__(self) -> int:
        return len(self.ends)

    def within(self, front: int, rows: np.ndarray) -> np.ndarray:
        """Where rows (k,) are among a front's own and the later ones that it meets."""
        start, end = self.starts[front], self.ends[front]
        behind = end - start + np.searchsorted(self.later[front], rows)
        return np.where(rows < end, rows - start, behind)

    @property
    def products(self) -> float:
        """About how many products a factor takes."""
        own = map(range, self.starts.tolist(), self.ends.tolist())
        return sum(map(_products, own, self.later))

    def of_rows(self, count: np.ndarray) -> Fronts:
        """The fronts of rows, of which images have so many each (m,)."""
        last = np.concatenate([[0], np.cumsum(count)])
        every = np.split(np.arange(last[-1]), last[1:-1])
        later = [np.concatenate([last[:0], *(every[n] for n in rows)]) for rows in self.later]
        return Fronts(last[self.ends], later)


def least_fill(one: np.ndarray, other: np.ndarray, images: int) -> tuple[np.ndarray, Fronts]:
    """Images (m,) in an order of elimination that leaves few equations, and their fronts.

    one, other (k,): pairs of images that hang together.
    """
    pattern = csc_array((np.ones(len(one)), (one, other)), shape=(images, images))
    pattern = csc_array(pattern + pattern.T + diags_array(np.full(images, 2.0 * len(one) + 1.0)))
    symmetric = {"SymmetricMode": True}
    place = splu(
        pattern, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric
    ).perm_c.astype(np.int64)
    low, high = np.minimum(place[one], place[other]), np.maximum(place[one], place[other])
    sort = np.lexsort((high, low))
    met = np.split(high[sort], np.searchsorted(low[sort], np.arange(1, images)))
    own: dict[int, list[int]] = {}
    later: dict[int, np.ndarray] = {}
    children: list[list[int]] = [[] for _ in range(images)]
    for n in range(images):
        below = [later[child] for child in children[n]]
        later[n] = np.setdiff1d(np.concatenate([met[n], *below]), [n])
        own[n] = [n]
        for child in sorted(children[n], key=lambda child: -len(later[child])):
            one_after_the_other = _products(own[child], later[child]) + _products(own[n], later[n])
            passed = _PAIR * len(later[child]) ** 2 + _FRONT
            both = own[child] + own[n]
            if _products(both, later[n]) <= one_after_the_other + passed:
                own[n] = both
                del own[child]
        if len(later[n]):
            children[later[n][0]].append(n)
    now = np.concatenate([np.array(mine) for mine in own.values()])
    number = np.argsort(now)
    ends = np.cumsum([len(mine) for mine in own.values()])
    return np.argsort(place)[now], Fronts(ends, [np.sort(number[later[n]]) for n in own])


def _products(own: Sized, later: Sized) -> float:
    """About how many products a front takes."""
    return float(len(own) * (len(own) + len(later)) ** 2)


class FrontFactor:
    """L of a matrix = L L', in the place of its blocks.

    weak: the first row whose column is not positive, None where all are: without a factor there are
    no solutions.
    """

    weak: int | None = None

    def __init__(self, fronts: Fronts, own: list[np.ndarray], link: list[np.ndarray]):
        """own: of each front the lower triangle (s, s) of its own rows; link (t, s): the later ones
        that it meets with it; columns first."""
        self.fronts, self._own, self._link = fronts, own, link
        self._later = [_in_a_row(rows) for rows in fronts.later]
        waiting: list[list[tuple[int, np.ndarray]]] = [[] for _ in own]
        for n, (mine, below) in enumerate(zip(own, link, strict=True)):
            behind = np.zeros((len(below), len(below)), order="F")
            for child, left in waiting[n]:
                _add(fronts.runs[child], left, mine, below, behind)
            waiting[n] = []
            _, info = dpotrf(mine, lower=1, clean=1, overwrite_a=1)
            if info:
                self.weak = int(fronts.starts[n]) + info - 1
                return
            if below.size:
                dtrsm(1.0, mine, below, side=1, lower=1, trans_a=1, overwrite_b=1)
                left = dsyrk(-1.0, below, beta=1.0, c=behind, lower=1, overwrite_c=1)
                waiting[fronts.parent[n]].append((n, left))

    @property
    def pivots(self) -> np.ndarray:
        """Diagonal (n,) of L."""
        return np.concatenate([np.zeros(0), *(own.diagonal() for own in self._own)])

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right for right (n, k), in its place: rows first."""
        for rows, later, own, link in self._each():
            right[rows] = solved(own, right[rows])
            if link.size:
                right[later] -= link @ right[rows]
        return right

    def other_half(self, half: np.ndarray) -> np.ndarray:
        """L'^-1 half for half (n, k), in its place: rows first."""
        for rows, later, own, link in reversed(list(self._each())):
            if link.size:
                half[rows] -= link.T @ half[later]
            half[rows] = solved(own, half[rows], turned=True)
        return half

    def inverse(self) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Of each front, from the last to the first: its number, the inverse (s, s) of its own rows
        and that of the later ones that it meets with them (t, s)."""
        fronts = self.fronts
        whole: dict[int, np.ndarray] = {}
        todo = np.bincount([n for n in fronts.parent if n >= 0], minlength=len(fronts))
        for n in reversed(range(len(fronts))):
            own, link, parent = self._own[n], self._link[n], fronts.parent[n]
            mine, both, met = inverse_of(own), np.zeros(link.shape), np.zeros((0, 0))
            if link.size:
                each = [np.arange(to, to + b - a) for a, b, to in fronts.runs[n]]
                at = _in_a_row(np.concatenate(each))
                met = whole[parent][at][:, at]
                across = dtrsm(1.0, own, link, side=1, lower=1)
                both = -(met @ across)
                mine -= across.T @ both
                todo[parent] -= 1
                if not todo[parent]:
                    del whole[parent]
            if todo[n]:
                whole[n] = np.block([[mine, both.T], [both, met]])
            yield n, mine, both

    def _each(self):
        """Own rows of each front, later ones, and both parts of the factor."""
        starts, ends = self.fronts.starts.tolist(), self.fronts.ends.tolist()
        return zip(map(slice, starts, ends), self._later, self._own, self._link, strict=True)


def solved(factor: np.ndarray, right: np.ndarray, turned: bool = False) -> np.ndarray:
    """L^-1 right, or L'^-1 right, for right (n, k) whose rows come first."""
    return dtrsm(1.0, factor, right.T, side=1, lower=1, trans_a=0 if turned else 1).T


def inverse_of(factor: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of the matrix that a dense factor is of."""
    out, _ = dpotri(factor, lower=1)
    return np.tril(out) + np.tril(out, -1).T


def _in_a_row(rows: np.ndarray) -> slice | np.ndarray:
    """The same rows, as a slice where they follow one another."""
    if len(rows) and rows[-1] - rows[0] == len(rows) - 1:
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def _runs(at: np.ndarray) -> list[tuple[int, int, int]]:
    """First and behind the last of those (k,) that follow one another, and where they begin."""
    cut = np.concatenate([[0], np.flatnonzero(np.diff(at) != 1) + 1, [len(at)]]).tolist()
    return [(a, b, int(at[a])) for a, b in zip(cut[:-1], cut[1:], strict=True)]


def _add(runs, left: np.ndarray, own: np.ndarray, link: np.ndarray, behind: np.ndarray) -> None:
    """Add what a child has left of its later rows (lower triangle) where its parent has them."""
    size, split = len(own), []
    for a, b, to in runs:
        edge = min(max(size - to, 0), b - a)
        split += [(a, a + edge, to)] * (edge > 0) + [(a + edge, b, to + edge)] * (a + edge < b)
    for n, (a, b, to) in enumerate(split):
        for first, last, row in split[n:]:
            into = own if row < size else link if to < size else behind
            r, c = row - size * (row >= size), to - size * (to >= size)
            into[r : r + last - first, c : c + b - a] += left[first:last, a:b]
