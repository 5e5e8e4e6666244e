"""Candidates after poses, camera and lever arms have had their say.

With B the candidates' columns, W the weights and Q = I - A (A'WA)^-1 A'W what poses, points and
nuisance A leave, the candidates meet

    M = B'WQB,    g = B'WQr

M theta = g is one more step of Newton's; under the null hypothesis g ~ N(0, M).

Whatever belongs to one image stands in the equations beside its pose, whether there are ten images
or thousands: slow noise of its antenna position, which as an unknown depends on the one before it
alone, so that what is left is white; and the values for each image of the groups of a model, with
the prior of their size. What images share is the border: camera, lever arms, and groups that are
nuisance. So all equations hang together like a chain along the corridor (see `chain`), and

    log p(data) = -1/2 (r'W r + log |white| - log |Q| + log |N| - t'N^-1 t) - sum of log sizes

holds exactly for every model and every noise: N, t all equations and their right side, Q the
precision of the slow noise, up to a constant of the block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import (
    block_array,
    coo_array,
    csc_array,
    csr_array,
    diags_array,
    hstack,
    issparse,
    vstack,
)

from corridor.diagnosis.noise.gnss import GnssNoise
from corridor.diagnosis.system.chain import Chain, block_ends
from corridor.diagnosis.system.equations import Equations
from corridor.diagnosis.system.groups import Group

# Positions that follow one another in time and lie farther apart in the block than points reach:
# so many of them are put into the border of the chain, the others make its links longer.
_MOST_JUMPS = 32

# Sets of rows whose equations are kept: a search for the noise asks for one many times.
_KEPT = 3

# Groups and the prior standard deviations (p,) of their parameters, in those of the parameters.
Rows = tuple[tuple[Group, np.ndarray], ...]


@dataclass
class Reduced:
    """M (c, c) and g (c,) of what images share, beside the rows of an elimination.

    g is that of no effect at all: where candidates stand at a value, their part has been put back.
    fit, cost: what those rows have to do with the log probability of the data, fit - cost.
    beside: more rows -> the same with them; None where no image has values.
    """

    M: np.ndarray
    g: np.ndarray
    groups: list[Group]
    fit: float = 0.0
    cost: float = 0.0
    beside: Callable[[Rows], Reduced] | None = None
    elimination: Elimination | None = None


class Part(NamedTuple):
    """Columns of the equations that become rows: those of a group, and their prior.

    at (p,): numbers among the system's columns. cross (n, p): with poses and nuisance; inside
    (p, p); antenna (3k, p); core (p, c): with what images share; right (p,), of no effect at all;
    here (p,): of the state; value (p,): where that stands; owner (p,): image, -1 of what images
    share. Sparse but for the vectors.
    """

    at: np.ndarray
    cross: csc_array
    inside: csc_array
    antenna: csr_array
    core: csr_array
    right: np.ndarray
    here: np.ndarray
    value: np.ndarray
    owner: np.ndarray


@dataclass(frozen=True)
class Static:
    """What an elimination has of its static rows, whatever the noise.

    sizes (q,): prior standard deviations of the groups' parameters. at (n,), owner (n,): numbers
    among the system's columns, and images. matrix (n, n): equations, the antenna aside. cross
    (n, c), jacobian (3k, n). right, here (n,): of no effect at all, and of the state. of_priors:
    what the means of priors take of the log probability.
    """

    sizes: np.ndarray
    at: np.ndarray
    owner: np.ndarray
    matrix: csr_array
    cross: csr_array
    jacobian: csr_array
    right: np.ndarray
    here: np.ndarray
    of_priors: float

    @classmethod
    def of(cls, e: Equations, rows: Rows) -> Static:
        """Of these rows: noises are many, and rows the same."""
        key = tuple((group.key, tuple(group.columns), size.tobytes()) for group, size in rows)
        if key not in e.kept:
            while len(e.kept) >= _KEPT:
                del e.kept[next(iter(e.kept))]
            e.kept[key] = cls._made(e, rows)
        return e.kept[key]

    @classmethod
    def _made(cls, e: Equations, rows: Rows) -> Static:
        parts = [_part_of(e, group) for group, _ in rows]
        nothing = [np.zeros(0)]
        sizes = np.concatenate([*nothing, *(np.broadcast_to(s, len(g)) for g, s in rows)])
        mean = np.concatenate([*nothing, *(_mean_of(group) for group, _ in rows)])
        value = np.concatenate([*nothing, *(p.value for p in parts)])
        weight = sizes**-2.0
        right = np.concatenate([e.without[0], *(p.right for p in parts)])
        # Of the state as it stands, for what moves from there.
        here = np.concatenate([e.right, *(p.here for p in parts)])
        right[len(e.first) :] += weight * mean
        here[len(e.first) :] += weight * (mean - value)
        return cls(
            sizes,
            np.concatenate([e.first, *(p.at for p in parts)]).astype(int),
            np.concatenate([e.owner, *(p.owner for p in parts)]).astype(np.int64),
            csr_array(_static(e, rows, parts, weight)),
            csr_array(vstack([csr_array(e.core.cross), *(p.core for p in parts)])),
            csr_array(hstack([e.jacobian, *(p.antenna for p in parts)])),
            right,
            here,
            -0.5 * float(weight @ mean**2),
        )


class Elimination:
    """Poses, nuisance and some groups of equations eliminated, for one covariance of the GNSS.

    The *static* rows are poses and nuisance, then those of the groups; behind them come the states
    of the slow noise.
    """

    def __init__(self, equations: Equations, noise: GnssNoise | None, rows: Rows = ()):
        """noise: None for the stated standard deviations. rows: groups that are no candidates."""
        self.equations, self.noise, self.rows = equations, noise, tuple(rows)
        e, static = equations, Static.of(equations, self.rows)
        self.sizes, self.at, self.cross = static.sizes, static.at, static.cross
        self.jacobian, self.owner, self._static = static.jacobian, static.owner, static.matrix
        self._static_right, self._here = static.right, static.here
        residual = self._residual = e.without[1]
        nothing = np.zeros(0, dtype=np.int64), np.zeros(0), csr_array((0, 0))
        self._states, self._size, self._slow = nothing if noise is None else noise.states()
        self._white = e.stated**-2.0 if noise is None else noise.white_weight
        self._order, ends, border = self._ordered()
        matrix = self._matrix()
        # In units of their own weight, or metres and radians would meet.
        self.unit = 1.0 / np.sqrt(np.maximum(matrix.diagonal(), 1e-300))
        matrix = self._in_order(matrix)
        if e.free_motions is not None:
            matrix = self._held(matrix)
        try:
            self.chain = Chain(matrix, ends, border)
        except np.linalg.LinAlgError:
            # What nothing determines is held a little.
            little = diags_array(np.full(matrix.shape[0], 1e-9))
            self.chain = Chain(csc_array(matrix + little), ends, border)
        self._half = self.chain.half(self._ordered_right(self._static_right, residual))
        self._of_priors = static.of_priors

    # --- the equations -----------------------------------------------------------------------

    def _ordered(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Order of all rows (n,), ends of the blocks of their chain, and rows of its border."""
        e, slow = self.equations, self._slow
        states = e.image[self._states // 3]
        owner = np.concatenate([self.owner, states]).astype(np.int64)
        if e.free_motions is not None or not (owner >= 0).any():
            return np.arange(len(owner)), np.array([len(owner)]), 0
        reach = np.arange(int(owner.max()) + 1)
        links = coo_array(self._static)
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
        owner[len(self.owner) + far] = -1
        ends = block_ends(reach)
        order = np.argsort(np.where(owner < 0, len(reach), owner), kind="stable")
        count = np.cumsum(np.bincount(owner[owner >= 0], minlength=len(reach)))
        return order, count[ends - 1], int((owner < 0).sum())

    def _matrix(self) -> csc_array:
        """Equations (n, n) of the static rows and slow noise."""
        if not len(self._white):
            return csc_array(self._static)
        weighted = self.jacobian.copy()
        weighted.data *= np.repeat(self._white, np.diff(weighted.indptr))
        own = csr_array(self._static + self.jacobian.T @ weighted)
        if not len(self._states):
            return csc_array(own)
        across = diags_array(self._size) @ csr_array(weighted)[self._states]
        inside = self._slow + diags_array(self._size**2 * self._white[self._states])
        return csc_array(block_array([[own, across.T], [across, inside]]))

    def _in_order(self, matrix: csc_array) -> csc_array:
        """A matrix (n, n) in the order of the chain, in units of its own weight."""
        place = np.empty(len(self._order), dtype=matrix.indices.dtype)
        place[self._order] = np.arange(len(self._order))
        of_column = np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.indptr))
        data = matrix.data * self.unit[matrix.indices] * self.unit[of_column]
        return csc_array((data, (place[matrix.indices], place[of_column])), shape=matrix.shape)

    def _held(self, matrix: csc_array) -> csc_array:
        """A block that nothing holds is held as a whole, where it is."""
        g = self.equations.free_motions
        whole = np.zeros((matrix.shape[0], g.shape[1]))
        whole[: len(g)] = g / np.linalg.norm(g, axis=0)
        whole = self.unit[:, None] * whole
        # The median of the diagonal of poses and nuisance before it was brought to units.
        weight = np.median(self.equations.matrix.diagonal())
        return csc_array(matrix + csc_array(weight * (whole @ whole.T)))

    def _ordered_right(self, right: np.ndarray, antenna: np.ndarray) -> np.ndarray:
        """Right sides (n, k) in the order of the chain, of those of the static rows.

        antenna (3k, k): what they come with of antenna positions, to be weighed.
        """
        right, antenna = (one if one.ndim == 2 else one[:, None] for one in (right, antenna))
        if len(self._white):
            heavy = self._white[:, None] * antenna
            right = right + self.jacobian.T @ heavy
            right = np.concatenate([right, self._size[:, None] * heavy[self._states]])
        return (self.unit[:, None] * right)[self._order]

    # --- what it solves ------------------------------------------------------------------------

    def weigh(self, rows: np.ndarray) -> np.ndarray:
        """Inverse covariance of the antenna positions times rows (3k, ...)."""
        if self.noise is None:
            weight = self.equations.stated**-2.0
            return rows * (weight[:, None] if rows.ndim == 2 else weight)
        return self.noise.weigh(rows)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """What the static rows (n, k) do about right (n, k)."""
        nothing = np.zeros((len(self._states), right.shape[1]))
        whole = (self.unit[:, None] * np.concatenate([right, nothing]))[self._order]
        return self._back(self.chain.solve(whole))[: len(right)]

    def _back(self, ordered: np.ndarray) -> np.ndarray:
        """A solution (n, k) in the order of the chain and its units, in those of the rows."""
        out = np.empty_like(ordered)
        out[self._order] = ordered
        return self.unit[:, None] * out

    @property
    def here(self) -> np.ndarray:
        """Right side (n, 1) of the static rows at the state, with what the antenna says."""
        e = self.equations
        right = self._here[:, None]
        if len(e.residual):
            right = right + self.jacobian.T @ self.weigh(e.residual[:, None])
        return right

    def following(self, core: np.ndarray) -> np.ndarray:
        """What the static rows (n, k) do about changes of the core (c, k), less."""
        right = self.cross @ core
        if len(self.equations.residual):
            right = right + self.jacobian.T @ self.weigh(self.equations.core.antenna @ core)
        return self.solve(right)

    @cached_property
    def core(self) -> tuple[np.ndarray, np.ndarray]:
        """M (c, c) and g (c,) of what images share."""
        e, block = self.equations, self.equations.core
        half = self.chain.half(self._ordered_right(self.cross.toarray(), block.antenna))
        heavy = self._white[:, None] * block.antenna
        M = block.inside + block.antenna.T @ heavy - half.T @ half
        g = e.core_without + heavy.T @ self._residual - (half.T @ self._half)[:, 0]
        return M, g

    def step(self, right: np.ndarray) -> np.ndarray:
        """Step (columns, k) of all that is a row, of what is said of the columns (columns, k)."""
        out = np.zeros_like(right)
        unit = self.equations.unit[self.at, None]
        out[self.at] = unit * self.solve(unit * right[self.at])
        return out

    def scores(
        self, right: np.ndarray, antenna: np.ndarray, priors: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """Scores of the core (c, k) of other measurements than those at hand.

        right (columns, k): what they say of the system's columns, the antenna aside; antenna
        (3k, k): residuals of its positions, m; priors (q, k): what the priors of the groups among
        the rows say, in prior standard deviations.
        """
        e, block = self.equations, self.equations.core
        own = right * e.unit[: len(right), None]
        static = own[self.at]
        static[len(e.first) :] += priors
        core = self.chain.half(self._ordered_right(self.cross.toarray(), block.antenna))
        half = self.chain.half(self._ordered_right(static, antenna))
        return own[e.at] + block.antenna.T @ (self._white[:, None] * antenna) - core.T @ half

    def reduced(self) -> Reduced:
        """M and g of what images share."""
        M, g = self.core
        return Reduced(
            M, g, self.equations.groups, self.fit, self.cost,
            lambda more: Elimination(self.equations, self.noise, (*self.rows, *more)).reduced(),
            self,
        )  # fmt: skip

    @property
    def fit(self) -> float:
        """Half of t'N^-1 t, and what the priors' means take of it."""
        return 0.5 * float((self._half**2).sum()) + self._of_priors

    @cached_property
    def cost(self) -> float:
        """Half of log |N|, and the logarithms of the prior standard deviations."""
        logdet = self.chain.logdet - 2.0 * float(np.log(self.unit).sum())
        return 0.5 * logdet + float(np.log(self.sizes).sum())

    @property
    def log_probability(self) -> float:
        """Of the data with this noise and these rows, up to a constant of the block."""
        square = float(self._white @ self._residual**2)
        noise = square - float(np.log(self._white).sum())
        if self.noise is not None:
            noise -= self.noise.log_precision
        return self.fit - self.cost - 0.5 * noise

    def group(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (p,) of the number-th group of the rows and their variances, prior sigmas."""
        ends = np.cumsum([len(self.equations.first), *(len(g) for g, _ in self.rows)])
        at = slice(int(ends[number]), int(ends[number + 1]))
        value = self._back(self.chain.other_half(self._half))[at, 0]
        variance = np.empty(len(self._order))
        variance[self._order] = self.chain.inverse().diagonal()
        return value, (self.unit**2 * variance)[at]

    def followed(self, group: Group, values: np.ndarray) -> np.ndarray:
        """What the static rows (n,) do about values (p,) of a group for each image, less."""
        part = _part_of(self.equations, group)
        right = self._cross_of(group, part) @ values
        if len(self._white):
            right = right + self.jacobian.T @ self.weigh(part.antenna @ values)
        return self.solve(right[:, None])[:, 0]

    def _cross_of(self, group: Group, part: Part) -> csr_array:
        """Products (n, p) of the static rows with the columns of a group, the antenna aside."""
        others = [_between(self.equations, other, group) for other, _ in self.rows]
        return csr_array(vstack([part.cross, *others]))

    def spread(self, group: Group, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M of a group with values for each image times values (p, k); what of it the antenna
        positions see (3k, k).
        """
        part = _part_of(self.equations, group)
        cross = self._cross_of(group, part)
        right, moved = cross @ values, part.antenna @ values
        if len(moved):
            right = right + self.jacobian.T @ self.weigh(moved)
        followed = self.solve(right)
        left = self.weigh(moved - self.jacobian @ followed) if len(moved) else moved
        return part.inside @ values - cross.T @ followed + part.antenna.T @ left, left

    # --- what the antenna says of its noise ------------------------------------------------------

    def felt(self, columns: np.ndarray) -> np.ndarray:
        """M (3k, p) between the antenna positions and some columns of the core."""
        block = self.equations.core
        right = self.cross[:, columns].toarray() if issparse(self.cross) else self.cross[:, columns]
        antenna = block.antenna[:, columns]
        moved = self.jacobian @ self.solve(right + self.jacobian.T @ self.weigh(antenna))
        return self.weigh(antenna - moved)

    def weight(self, rows: np.ndarray) -> np.ndarray:
        """What antenna positions weigh when all else has followed, times rows (3k, n)."""
        heavy = self.weigh(rows)
        return heavy - self.weigh(self.jacobian @ self.solve(self.jacobian.T @ heavy))

    @cached_property
    def antenna(self) -> np.ndarray:
        """Residuals of the antenna positions (3k,), m, beside all rows but the slow noise."""
        found = self._back(self.chain.other_half(self._half))[: len(self.at), 0]
        return self._residual - self.jacobian @ found

    def errors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Mean squares of the white part (3k,), m2, and of the slow noise, of the data.

        Of each state in units of its size (s,), and of each with the next (s - 1,); and the rows
        (s,) of 3k they belong to. Where a state ends a flight, the product with the next is
        meaningless.
        """
        inverse = self.chain.inverse()
        found = self._back(self.chain.other_half(self._half))[:, 0]
        slow, count = found[len(self.at) :], len(self._states)
        into = csr_array(
            (self._size, (self._states, np.arange(count))), shape=(len(self._white), count)
        )
        rows = csr_array(hstack([self.jacobian, into]) @ diags_array(self.unit))[:, self._order]
        white = (self._residual - self.jacobian @ found[: len(self.at)] - into @ slow) ** 2
        white = white + inverse.variances(rows)
        place = np.empty(len(self._order), dtype=np.int64)
        place[self._order] = np.arange(len(self._order))
        place, unit = place[len(self.at) :], self.unit[len(self.at) :]
        square = slow**2 + unit**2 * inverse.diagonal()[place]
        pairs = slow[:-1] * slow[1:] + unit[:-1] * unit[1:] * inverse.between(place[:-1], place[1:])
        return white, square, pairs, self._states


def rows_of(chosen: Iterable[tuple[Group, float | np.ndarray]]) -> Rows:
    """Groups and their sizes, as rows of an elimination."""
    return tuple((group, np.broadcast_to(np.asarray(s, float), len(group))) for group, s in chosen)


def _mean_of(group: Group) -> np.ndarray:
    return np.zeros(len(group)) if group.mean is None else group.mean


def _part_of(e: Equations, group: Group) -> Part:
    at = group.columns
    if group.own is None:
        block, owner = e.core, np.full(len(at), -1)
        core, right = block.inside[at], e.core_without[at]
        number = e.at[at]
    else:
        block, owner = e.own[group.own], e.owner_of(group)[at]
        core, right = e.between[group.own][at], e.own_without[group.own][at]
        number = e.own_at[group.own][at]
    return Part(
        number,
        csc_array(block.cross[:, at]),
        csc_array(block.inside[at][:, at]),
        csr_array(block.antenna[:, at]),
        csr_array(core),
        right,
        block.right[at],
        block.value[at],
        owner,
    )


def _between(e: Equations, one: Group, other: Group) -> csc_array:
    """Products (p, q) of the columns of two groups, the antenna aside."""
    if one.own is None:
        found = e.core.inside if other.own is None else e.between[other.own].T
        return csc_array(found[np.ix_(one.columns, other.columns)])
    if other.own is None:
        return csc_array(e.between[one.own][one.columns][:, other.columns])
    if one.own == other.own:
        found = e.own[one.own].inside
    elif one.own < other.own:
        found = e.mutual[one.own, other.own]
    else:
        found = e.mutual[other.own, one.own].T
    return csc_array(csr_array(found)[one.columns][:, other.columns])


def _static(e: Equations, rows: Rows, parts: list[Part], weight: np.ndarray) -> csc_array:
    """Equations (n, n) of the static rows, the antenna aside, with the priors of the groups."""
    if not parts:
        return csc_array(e.matrix)
    table = [[e.matrix, *(p.cross for p in parts)]]
    for n, (group, _) in enumerate(rows):
        others = [_between(e, group, other) for other, _ in rows]
        table.append([parts[n].cross.T, *others])
    zero = np.concatenate([np.zeros(e.matrix.shape[0]), weight])
    return csc_array(block_array(table) + diags_array(zero))
