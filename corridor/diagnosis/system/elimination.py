"""Candidates after poses, camera and lever arms have had their say.

With B the candidates' columns, W the weights and Q = I - A (A'WA)^-1 A'W what poses, points and
nuisance A leave, the candidates meet

    M = B'WQB,    g = B'WQr

M theta = g is one more step of Newton's; under the null hypothesis g ~ N(0, M).

Slow noise of the antenna positions is nuisance too: with its value at each position as an unknown,
which depends on the one before it alone, what is left is white, and all equations hang together
like a chain along the corridor (see `chain`). Poses, nuisance and slow noise are the *rows* here.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, coo_array, csc_array, csr_array, diags_array, issparse, vstack

from corridor.diagnosis.noise.gnss import GnssNoise, Weight
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.chain import Chain, Half, block_ends
from corridor.diagnosis.system.equations import Columns, Equations
from corridor.diagnosis.system.groups import Group

# Positions that follow one another in time and lie farther apart in the block than points reach:
# so many of them are put into the border of the chain.
_MOST_JUMPS = 32
# Numbers between the antenna positions and values for each image that are worked out: 16 MB.
_MOST_FELT = 2_000_000


class Pieces:
    """A matrix (p, p) of values for each image, as square pieces along its diagonal.

    One piece where there are few; of many, images far apart share little of what each has for
    itself.
    """

    def __init__(self, blocks: list[np.ndarray]):
        self.blocks = blocks
        ends = np.cumsum([len(one) for one in blocks])
        self.spans = [slice(int(e) - len(b), int(e)) for e, b in zip(ends, blocks, strict=True)]
        self.shape = (int(ends[-1]),) * 2

    def __len__(self) -> int:
        return self.shape[0]

    def less(self, left: np.ndarray, right: np.ndarray) -> Pieces:
        """Less the product of left (p, k) and right (k, p)."""
        each = zip(self.blocks, self.spans, strict=True)
        return Pieces([block - left[at] @ right[:, at] for block, at in each])

    @property
    def T(self) -> Pieces:  # noqa: N802, an array has it so
        """Its transpose."""
        return Pieces([block.T for block in self.blocks])

    @property
    def several(self) -> bool:
        """Whether there is something beside the pieces that is taken for zero."""
        return len(self.blocks) > 1

    def __matmul__(self, values: np.ndarray) -> np.ndarray:
        each = zip(self.blocks, self.spans, strict=True)
        return np.concatenate([block @ values[at] for block, at in each])

    def __truediv__(self, factor: float) -> Pieces:
        return Pieces([block / factor for block in self.blocks])

    def __getitem__(self, at: tuple[np.ndarray, np.ndarray]) -> Pieces:
        """Some rows and the same columns, in order: as with `np.ix_`."""
        rows = at[0].ravel()
        inside = [rows[(rows >= s.start) & (rows < s.stop)] - s.start for s in self.spans]
        each = zip(self.blocks, inside, strict=True)
        return Pieces([block[np.ix_(mine, mine)] for block, mine in each])

    def diagonal(self) -> np.ndarray:
        """Its diagonal (p,)."""
        return np.concatenate([block.diagonal() for block in self.blocks])

    def square(self) -> float:
        """Sum of the squares of its entries."""
        return float(sum(np.sum(block**2) for block in self.blocks))

    def toarray(self) -> np.ndarray:
        """As a matrix, zero beside the pieces."""
        out = np.zeros(self.shape)
        for block, at in zip(self.blocks, self.spans, strict=True):
            out[at, at] = block
        return out


@dataclass(frozen=True)
class Mutual:
    """M between two blocks of per-image columns, which is large and seldom asked for.

    make: the matrix (p, q). times: it times values (q,); back: its transpose times values (p,).
    """

    make: Callable[[], np.ndarray]
    times: Callable[[np.ndarray], np.ndarray]
    back: Callable[[np.ndarray], np.ndarray]

    def less(self, left: np.ndarray, right: np.ndarray) -> Mutual:
        """Less the product of left (p, k) and right (k, q)."""
        return Mutual(
            cache(lambda: self.make() - left @ right),
            lambda values: self.times(values) - left @ (right @ values),
            lambda values: self.back(values) - right.T @ (left.T @ values),
        )


@dataclass
class Reduced:
    """M and g of the core (c, c), (c,), of each block of per-image columns, and between them.

    own_matrix: (p, p) of each block; between: of each with the core; mutual: (i, j) -> of two
    blocks, i < j.

    g is that of no effect at all: where candidates stand at a value, their part has been put
    back. Blocks that were left out are None.
    """

    M: np.ndarray
    g: np.ndarray
    own_matrix: list[Pieces | None]
    own_g: list[np.ndarray | None]
    between: list[np.ndarray | None]
    mutual: dict[tuple[int, int], Mutual]
    groups: list[Group]

    def between_blocks(self, i: int | None, n: int | None) -> np.ndarray:
        """M between two blocks of per-image columns, or the core (None), as a matrix."""
        if i is None or n is None:
            return self.M if i is n else self.between[n].T if i is None else self.between[i]
        if i == n:
            return self.own_matrix[i].toarray()
        return self.mutual[i, n].make() if i < n else self.mutual[n, i].make().T

    def across(self, i: int, n: int, values: np.ndarray) -> np.ndarray:
        """M between two blocks of per-image columns times values (p,) of the second."""
        return self.mutual[i, n].times(values) if i < n else self.mutual[n, i].back(values)


class Antennas(NamedTuple):
    """One unit column for each antenna coordinate, reduced: all that the block knows of its noise.

    P (3k, 3k), rho (3k,): their M and g. core (3k, c), own: M between them and the candidates, of
    per-image columns what makes it for some of them (3k, some); None where a block of per-image
    columns cannot touch the antenna much. under: a noise -> P of that noise times rows (3k, n);
    before anything was taken away from P.
    """

    P: Weight
    rho: np.ndarray
    core: np.ndarray
    own: list[Callable[[slice], np.ndarray] | None]
    under: Callable[[GnssNoise], Callable[[np.ndarray], np.ndarray]] | None = None


class Elimination:
    """Poses and nuisance of equations eliminated, for one covariance of the GNSS."""

    def __init__(self, equations: Equations, noise: GnssNoise | None):
        """noise: None for the stated standard deviations."""
        self.equations, self.noise = equations, noise
        e = equations
        self.right = e.right.copy()
        if len(e.residual):
            self.right += e.jacobian.T @ self.weigh(e.residual)
        nothing = np.zeros(0, dtype=np.int64), np.zeros(0), csr_array((0, 0))
        self._at, self._size, slow = nothing if noise is None else noise.states()
        self._white = e.stated**-2.0 if noise is None else noise.white_weight
        self._order, ends, border = self._ordered(slow)
        matrix = self._matrix(slow)
        # In units of their own weight, or metres and radians would meet.
        self.unit = 1.0 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        scale = diags_array(self.unit)
        matrix = csc_array(scale @ matrix @ scale)[self._order][:, self._order]
        if e.free_motions is not None:
            matrix = self._held(matrix)
        try:
            self._chain = Chain(matrix, ends, border)
        except np.linalg.LinAlgError:
            # What nothing determines is held a little.
            little = diags_array(np.full(matrix.shape[0], 1e-10))
            self._chain = Chain(csc_array(matrix + little), ends, border)
        self._right = self._chain.half(self._rows(e.right[:, None], e.residual[:, None]))

    def _ordered(self, slow) -> tuple[np.ndarray, np.ndarray, int]:
        """Order of the rows (n,), ends of the blocks of their chain, and how many are its border.

        slow: precision of the slow noise.
        """
        e = self.equations
        states = e.image[self._at // 3]
        owner = np.concatenate([e.owner, states]).astype(np.int64)
        if e.free_motions is not None or not (owner >= 0).any():
            return np.arange(len(owner)), np.array([len(owner)]), 0
        reach = np.arange(int(owner.max()) + 1)
        links = coo_array(e.matrix)
        one, other = owner[links.row], owner[links.col]
        inner = (one >= 0) & (other >= 0)
        np.maximum.at(reach, one[inner], other[inner])
        links = coo_array(slow)
        one, other = states[links.row], states[links.col]
        width = int((reach - np.arange(len(reach))).max())
        span = np.where(links.col == links.row + 1, np.abs(other - one), 0)
        jumps = np.flatnonzero(span > width)
        if len(jumps) > _MOST_JUMPS:
            jumps = jumps[np.argsort(-span[jumps], kind="stable")[:_MOST_JUMPS]]
        far = np.unique(links.col[jumps])
        near = ~(np.isin(links.row, far) | np.isin(links.col, far))
        np.maximum.at(reach, one[near], other[near])
        owner[len(e.owner) + far] = -1
        ends = block_ends(reach)
        order = np.argsort(np.where(owner < 0, len(reach), owner), kind="stable")
        count = np.cumsum(np.bincount(owner[owner >= 0], minlength=len(reach)))
        return order, count[ends - 1], int((owner < 0).sum())

    def _matrix(self, slow) -> csc_array:
        """Equations (n, n) of poses, nuisance and slow noise."""
        e = self.equations
        if not len(e.residual):
            return csc_array(e.matrix)
        weighted = diags_array(self._white) @ e.jacobian
        own = csr_array(e.matrix + e.jacobian.T @ weighted)
        if not len(self._at):
            return csc_array(own)
        across = diags_array(self._size) @ csr_array(weighted)[self._at]
        inside = slow + diags_array(self._size**2 * self._white[self._at])
        return csc_array(block_array([[own, across.T], [across, inside]]))

    def _held(self, matrix: csc_array) -> csc_array:
        """A block that nothing holds is held as a whole, where it is."""
        g = self.equations.free_motions
        g = g / np.linalg.norm(g, axis=0)
        g = self.unit[: len(g), None] * g
        # The median of the diagonal before it was brought to units.
        weight = np.median(self.unit**-2.0)
        return csc_array(matrix + csc_array(weight * (g @ g.T)))

    def _rows(self, right, antenna):
        """Right sides (n, k) in the order of the chain, of those of poses and nuisance (n, k).

        antenna (3k, k): what they come with of antenna positions, to be weighed. Both dense, or
        both sparse.
        """
        e = self.equations
        if issparse(right):
            heavy = diags_array(self._white) @ antenna
            whole = csr_array(right + e.jacobian.T @ heavy)
            if len(self._at):
                whole = vstack([whole, diags_array(self._size) @ csr_array(heavy)[self._at]])
            return csc_array((diags_array(self.unit) @ csr_array(whole))[self._order])
        if len(e.residual):
            heavy = self._white[:, None] * antenna
            right = right + e.jacobian.T @ heavy
            right = np.concatenate([right, self._size[:, None] * heavy[self._at]])
        return (self.unit[:, None] * right)[self._order]

    def weigh(self, rows: np.ndarray) -> np.ndarray:
        """Inverse covariance of the antenna positions times rows (3k, ...)."""
        if self.noise is None:
            weight = self.equations.stated**-2.0
            return rows * (weight[:, None] if rows.ndim == 2 else weight)
        return self.noise.weigh(rows)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """What poses and nuisance (n, k) do about right (n, k)."""
        nothing = np.zeros((len(self._at), right.shape[1]))
        whole = (self.unit[:, None] * np.concatenate([right, nothing]))[self._order]
        out = np.empty_like(whole)
        out[self._order] = self._chain.solve(whole)
        return (self.unit[:, None] * out)[: len(right)]

    def following(self, block: Columns, columns: slice = slice(None)) -> np.ndarray:
        """What poses and nuisance (n, p) would do about some columns of a block."""
        e = self.equations
        right = _dense(block.cross[:, columns])
        if len(e.residual):
            right = right + e.jacobian.T @ self.weigh(_dense(block.antenna[:, columns]))
        return self.solve(right)

    def _inside(self, block: Columns, a: slice, b: slice) -> np.ndarray:
        """Of some columns of a block and others of it before the elimination."""
        light = block.antenna[:, a]
        heavy = diags_array(self._white) @ block.antenna[:, b]
        return _dense(block.inside[a][:, b]) + _dense(light.T @ heavy)

    def core(self) -> tuple[np.ndarray, np.ndarray, Half]:
        """M (c, c) and g (c,) of what images share as they stand, and half their solution."""
        e, block = self.equations, self.equations.core
        half = self._chain.half(self._rows(block.cross, block.antenna))
        heavy = self._white[:, None] * block.antenna
        M = block.inside + block.antenna.T @ heavy - half.dot(half)
        g = block.right + heavy.T @ e.residual - half.dot(self._right)[:, 0]
        return M, g, half

    def halves(self, block: Columns) -> Iterator[tuple[slice, Half]]:
        """Half solutions of per-image columns, some images at a time."""
        rows = self._rows(block.cross, block.antenna)
        for at in pieces_of(len(block.value)):
            yield at, self._chain.near(rows[:, at])

    def reduced(self, but: Container[int] = ()) -> Reduced:
        """M and g of all candidates, but for some of the blocks of per-image columns."""
        e = self.equations
        M, g, core = self.core()
        count = len(e.own)
        out = Reduced(
            M, g + M @ e.core.value, [None] * count, [None] * count, [None] * count, {}, e.groups
        )
        tested = [n for n in range(count) if n not in but]
        followed = [self._chain.other_half(half) for half in (core, self._right) if tested]
        for n in tested:
            self._reduce_own(out, n, followed)
        for n in tested:
            out.mutual |= {(i, n): self._between(i, n) for i in tested if i < n}
            # What has been estimated counts as missing again: in all that is tested.
            value = e.own[n].value
            if value.any():
                out.g = out.g + out.between[n].T @ value
                for i in tested:
                    if i != n:
                        out.own_g[i] += self._across(i, n, value)
        return out

    def shared(self) -> Reduced:
        """M and g of what images share alone, where no values of single images are asked for."""
        return self.reduced(range(len(self.equations.own)))

    def _reduce_own(self, out: Reduced, n: int, followed: list[np.ndarray]) -> None:
        """Put M and g of a block of per-image columns in their place.

        followed: what poses and nuisance do about the core (n, c), and about all else (n, 1).
        """
        e, block = self.equations, self.equations.own[n]
        heavy = diags_array(self._white) @ block.antenna
        out.between[n] = e.between[n] + _dense(heavy.T @ e.core.antenna)
        out.own_g[n] = block.right + heavy.T @ e.residual
        rows, (core, right) = self._rows(block.cross, block.antenna), followed
        out.between[n] -= rows.T @ core
        out.own_g[n] -= rows.T @ right[:, 0]
        inside = [
            self._inside(block, at, at) - self._chain.taken(rows[:, at])
            for at in pieces_of(len(block.value))
        ]
        out.own_matrix[n] = Pieces(inside)
        out.own_g[n] += out.between[n] @ e.core.value
        if block.value.any():
            out.own_g[n] += self._across(n, n, block.value)

    def _across(self, i: int, n: int, value: np.ndarray) -> np.ndarray:
        """M between two blocks of per-image columns times values (p,) of the second."""
        e, one, other = self.equations, self.equations.own[i], self.equations.own[n]
        inside = other.inside if i == n else e.mutual[i, n] if i < n else e.mutual[n, i].T
        moved = other.antenna @ value
        followed = self.solve((other.cross @ value + e.jacobian.T @ self.weigh(moved))[:, None])
        left = self.weigh(moved - e.jacobian @ followed[:, 0])
        return inside @ value - one.cross.T @ followed[:, 0] + one.antenna.T @ left

    def _between(self, i: int, n: int) -> Mutual:
        return Mutual(
            cache(partial(self._mutual, i, n)),
            partial(self._across, i, n),
            partial(self._across, n, i),
        )

    def _mutual(self, i: int, n: int) -> np.ndarray:
        """M between two blocks of per-image columns (p, q)."""
        e, one, other = self.equations, self.equations.own[i], self.equations.own[n]
        out = _dense(e.mutual[i, n])
        out += _dense(one.antenna.T @ (diags_array(self._white) @ other.antenna))
        second = list(self.halves(other))
        for a, half in self.halves(one):
            for b, its in second:
                out[a, b] -= half.dot(its)
        return out

    def antennas(self) -> Antennas:
        """M and g of the antenna positions, like those of `reduced` of no effect at all."""
        e = self.equations
        left = e.residual - e.jacobian @ self.solve(self.right[:, None])[:, 0]
        rho = self.weigh(left)
        core = self.felt(e.core, slice(None))
        rho = rho + core @ e.core.value
        own: list[Callable[[slice], np.ndarray] | None] = []
        for block in e.own:
            # Several values for each of many images tell of the picture; the antenna hardly feels
            # them, but for what other effects of the same model do as well.
            few = len(block.value) * len(e.residual) <= _MOST_FELT
            own.append((lambda at, block=block: self.felt(block, at)) if few else None)
            if block.value.any():
                moved = (block.antenna @ block.value)[:, None]
                right = (block.cross @ block.value)[:, None]
                right = right + e.jacobian.T @ self.weigh(moved)
                rho = rho + self.weigh(moved - e.jacobian @ self.solve(right))[:, 0]
        made: dict[bytes, np.ndarray] = {}

        def part(rows: np.ndarray) -> np.ndarray:
            key = rows.tobytes()
            if key not in made:
                made[key] = self._weight_of(rows)
            return made[key]

        P = Weight(part, np.arange(len(e.residual)))
        return Antennas(P, rho, core, own, lambda noise: Elimination(e, noise).weight)

    def felt(self, block: Columns, columns: slice) -> np.ndarray:
        """M (3k, p) between the antenna positions and some columns of a block."""
        moved = self.equations.jacobian @ self.following(block, columns)
        return self.weigh(_dense(block.antenna[:, columns]) - moved)

    def weight(self, rows: np.ndarray) -> np.ndarray:
        """P, as it is with this noise, times rows (3k, n)."""
        e, heavy = self.equations, self.weigh(rows)
        return heavy - self.weigh(e.jacobian @ self.solve(e.jacobian.T @ heavy))

    def _weight_of(self, at: np.ndarray) -> np.ndarray:
        """P (k, k) of some antenna coordinates, with white noise."""
        columns = csc_array(
            (self._white[at], (at, np.arange(len(at)))), shape=(len(self._white), len(at))
        )
        right = csr_array(self.equations.jacobian.T @ columns)
        right = (diags_array(self.unit) @ right)[self._order]
        return np.diag(self._white[at]) - self._chain.taken(right)


def pieces_of(count: int) -> list[slice]:
    """Columns of values for each image that are taken together."""
    some = -(-count // SETTINGS.most_own_together)
    cut = np.cumsum([0, *map(len, np.array_split(np.arange(count), max(some, 1)))]).tolist()
    return [slice(a, b) for a, b in zip(cut[:-1], cut[1:], strict=True)]


def _dense(matrix) -> np.ndarray:
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)
