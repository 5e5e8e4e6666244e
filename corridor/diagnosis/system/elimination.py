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
from threading import Lock
from typing import NamedTuple

import numpy as np
from scipy.sparse import (
    coo_array,
    csc_array,
    csr_array,
    hstack,
    issparse,
    tril,
    vstack,
)

from corridor.core.adjustment import Fronts, LinearSystem
from corridor.diagnosis.noise.gnss import GnssNoise
from corridor.diagnosis.system.chain import Chain, Layout, blocks_of
from corridor.diagnosis.system.equations import Equations
from corridor.diagnosis.system.groups import Group

# Positions that follow one another in time and lie farther apart in the block than points reach:
# so many of them are put into the border of the chain, the others make its links longer.
_MOST_JUMPS = 32

# Products of one factor, of which a search asks a hundred and more: some seconds of a processor.
_MOST_PRODUCTS = 5e10

# Columns that are solved for together.
_COLUMNS = 96

# Sets of rows whose equations are kept: a search for the noise asks for one many times, one for a
# model for a dozen; of large blocks each weighs a hundred megabytes.
_KEPT, _HELD_BYTES = 3, 1e8
_ONE = Lock()

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
    share. Sparse but for `core` and the vectors.
    """

    at: np.ndarray
    cross: csc_array
    inside: csc_array
    antenna: csr_array
    core: np.ndarray
    right: np.ndarray
    here: np.ndarray
    value: np.ndarray
    owner: np.ndarray


@dataclass(frozen=True)
class Static:
    """What an elimination has of its static rows, whatever the noise and the sizes of its groups.

    at (n,), owner (n,): numbers among the system's columns, and images. matrix (n, n): lower
    triangle of the equations, the antenna and priors aside. cross (n, c), jacobian (3k, n). right,
    here (n,): of no effect at all, and of the state. mean, value (q,): of the groups' parameters,
    beforehand and as they stand. patterns: by the rows of slow noise.
    """

    at: np.ndarray
    owner: np.ndarray
    matrix: coo_array
    cross: np.ndarray
    jacobian: csr_array
    right: np.ndarray
    here: np.ndarray
    mean: np.ndarray
    value: np.ndarray
    patterns: dict[bytes, Pattern]

    @classmethod
    def of(cls, e: Equations, groups: list[Group]) -> Static:
        """Of these groups as rows: noises and sizes are many, and rows the same."""
        key = tuple((group.key, group.columns.tobytes()) for group in groups)
        found = e.kept.get(key)
        if found is None:
            found = cls._made(e, groups)
            most = max(_KEPT, int(_HELD_BYTES / found.cross.nbytes) if found.cross.size else _KEPT)
            with _ONE:
                while len(e.kept) >= most:
                    del e.kept[next(iter(e.kept))]
                e.kept[key] = found
        return found

    @classmethod
    def _made(cls, e: Equations, groups: list[Group]) -> Static:
        parts = [_part_of(e, group) for group in groups]
        nothing = [np.zeros(0)]
        return cls(
            np.concatenate([e.first, *(p.at for p in parts)]).astype(int),
            np.concatenate([e.owner, *(p.owner for p in parts)]).astype(np.int64),
            _lower(e, groups, parts),
            np.concatenate([_dense(e.core.cross), *(p.core for p in parts)]),
            csr_array(hstack([e.jacobian, *(p.antenna for p in parts)])),
            np.concatenate([e.without[0], *(p.right for p in parts)]),
            np.concatenate([e.right, *(p.here for p in parts)]),
            np.concatenate([*nothing, *(_mean_of(group) for group in groups)]),
            np.concatenate([*nothing, *(p.value for p in parts)]),
            {},
        )

    def pattern(self, e: Equations, states: np.ndarray, linked: np.ndarray) -> Pattern:
        """With slow noise of rows `states` (s,) of 3k; see `Pattern`."""
        key = states.tobytes()
        if key not in self.patterns:
            self.patterns[key] = Pattern.of(self, e, states, linked)
        return self.patterns[key]


@dataclass(frozen=True)
class Pattern:
    """Where everything lies in a chain of all rows: the static ones and the states of slow noise.

    order, place (n,): rows in the order of the chain, and back. layout: of its blocks. Places in
    there: diagonal (n,); static and static_data (e,), of the equations; weighted (u,), to which
    weights w (3k,) of the antenna positions add products @ w; across (a,), to which those of states
    `state` add across_data w; links (s - 1,), of each state with the next, where they are `linked`.
    """

    order: np.ndarray
    place: np.ndarray
    layout: Layout
    diagonal: np.ndarray
    static: np.ndarray
    static_data: np.ndarray
    weighted: np.ndarray
    products: csr_array
    across: np.ndarray
    across_data: np.ndarray
    state: np.ndarray
    links: np.ndarray
    linked: np.ndarray

    @classmethod
    def of(cls, static: Static, e: Equations, states: np.ndarray, linked: np.ndarray) -> Pattern:
        """linked (s - 1,): whether each state and the next are of one flight and axis."""
        matrix, j, many = static.matrix, static.jacobian, len(static.owner)
        owner = np.concatenate([static.owner, e.image[states // 3]]).astype(np.int64)
        order, layout = _ordered(owner, matrix, linked, many, e.free_motions is not None)
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        # Products of two columns that one antenna position sees.
        width = np.diff(j.indptr)
        begin = np.repeat(j.indptr[:-1], width**2)
        within = np.arange(len(begin)) - np.repeat(np.cumsum(width**2) - width**2, width**2)
        wide = np.repeat(width, width**2)
        one, other = begin + within // wide, begin + within % wide
        row = np.repeat(np.arange(len(width)), width**2)
        keep = place[j.indices[one]] >= place[j.indices[other]]
        one, other, row = one[keep], other[keep], row[keep]
        weighted, which = np.unique(
            layout.places(place[j.indices[one]], place[j.indices[other]]), return_inverse=True
        )
        products = coo_array(
            (j.data[one] * j.data[other], (which.ravel(), row)), shape=(len(weighted), len(width))
        )
        seen = j[states]
        of = np.repeat(np.arange(len(states)), np.diff(seen.indptr))
        state = place[many + np.arange(len(states))]
        return cls(
            order, place, layout, layout.places(place, place),
            layout.places(place[matrix.row], place[matrix.col]), matrix.data,
            weighted, csr_array(products),
            layout.places(state[of], place[seen.indices]), seen.data, of,
            layout.places(state[:-1][linked], state[1:][linked]), linked,
        )  # fmt: skip


def _ordered(
    owner: np.ndarray, static: coo_array, linked: np.ndarray, first: int, free: bool
) -> tuple[np.ndarray, Layout]:
    """Order of all rows (n,), and the layout of their chain.

    owner (n,): image of each, -1 of what images share; from `first` on they are states, each of
    which meets the next where they are `linked`. free: a block that nothing holds is one block.
    """
    if free or not (owner >= 0).any():
        return np.arange(len(owner)), Layout(Fronts([len(owner)], [np.zeros(0, int)]), 0)
    images = int(owner.max()) + 1
    one, other = owner[static.row], owner[static.col]
    inner = (one >= 0) & (other >= 0)
    each = np.arange(images) * (images + 1)
    met = np.union1d(each, np.minimum(one, other)[inner] * images + np.maximum(one, other)[inner])
    owner = owner.copy()
    at = np.flatnonzero(linked) + first
    one, other = owner[at], owner[at + 1]
    span = np.abs(other - one)
    jumps = np.flatnonzero(span > (met % images - met // images).max())
    if len(jumps) > _MOST_JUMPS:
        jumps = jumps[np.argsort(-span[jumps], kind="stable")[:_MOST_JUMPS]]
    far = at[jumps] + 1
    near = ~(np.isin(at, far) | np.isin(at + 1, far))
    both = np.minimum(one, other)[near] * images + np.maximum(one, other)[near]
    one, other = np.divmod(np.union1d(met, both), images)
    owner[far] = -1
    order, fronts = blocks_of(one, other, np.bincount(owner[owner >= 0], minlength=images))
    rank = np.append(np.argsort(order), images)
    return np.argsort(rank[owner], kind="stable"), Layout(fronts, int((owner < 0).sum()))


def too_wide(system: LinearSystem, own: int) -> bool:
    """Whether a chain of so many rows an image is more than a search can factor many times.

    Photographs of an area hang together across it, and a chain of them is hardly a chain.
    """
    p = system.problem
    wide = p.bandwidth * p.image_count / p.exposure_count * own
    return p.image_count * own * wide**2 > _MOST_PRODUCTS


class Elimination:
    """Poses, nuisance and some groups of equations eliminated, for one covariance of the GNSS.

    The *static* rows are poses and nuisance, then those of the groups; behind them come the states
    of the slow noise.
    """

    def __init__(self, equations: Equations, noise: GnssNoise | None, rows: Rows = ()):
        """noise: None for the stated standard deviations. rows: groups that are no candidates."""
        self.equations, self.noise, self.rows = equations, noise, tuple(rows)
        e, static = equations, Static.of(equations, [group for group, _ in self.rows])
        self.at, self.cross, self.jacobian = static.at, static.cross, static.jacobian
        sizes = [np.broadcast_to(size, len(group)) for group, size in self.rows]
        self.sizes = np.concatenate([np.zeros(0), *sizes])
        weight, groups = self.sizes**-2.0, slice(len(e.first), None)
        self._right, self._here = static.right.copy(), static.here.copy()
        self._right[groups] += weight * static.mean
        # Of the state as it stands, for what moves from there.
        self._here[groups] += weight * (static.mean - static.value)
        self._of_priors = -0.5 * float(weight @ static.mean**2)
        residual = self._residual = e.without[1]
        nothing = np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((2, 0))
        self._states, self._size, slow = nothing if noise is None else noise.states()
        linked = np.zeros(0, dtype=bool) if noise is None else noise.linked(self._states)
        self._white = e.stated**-2.0 if noise is None else noise.white_weight
        self._pattern = static.pattern(e, self._states, linked)
        self._order = self._pattern.order
        self.chain = self._factored(weight, slow)
        self._half = self.chain.half(self._ordered_right(self._right, residual))

    # --- the equations -----------------------------------------------------------------------

    def _values(self, weight: np.ndarray, slow: np.ndarray) -> np.ndarray:
        """Entries of the equations at the places of the chain.

        weight (q,): of the priors of the groups. slow (2, s): what is above the diagonal of the
        precision of slow noise, and the diagonal, in units of its size.
        """
        p, first = self._pattern, len(self.equations.first)
        out = np.zeros(p.layout.length)
        out[p.static] = p.static_data
        out[p.diagonal[first : len(self.at)]] += weight
        if len(self._white):
            out[p.weighted] += p.products @ self._white
        if len(self._states):
            heavy = self._size * self._white[self._states]
            out[p.across] += p.across_data * heavy[p.state]
            out[p.diagonal[len(self.at) :]] += slow[1] + self._size * heavy
            out[p.links] += slow[0, 1:][p.linked]
        return out

    def _factored(self, weight: np.ndarray, slow: np.ndarray) -> Chain:
        """The factor of the equations in units of their own weight."""
        layout = self._pattern.layout
        try:
            return Chain(layout, self._in_units(self._values(weight, slow)))
        except np.linalg.LinAlgError:
            # What nothing determines is held a little.
            values = self._in_units(self._values(weight, slow))
            values[self._pattern.diagonal] += 1e-9
            return Chain(layout, values)

    def _in_units(self, values: np.ndarray) -> np.ndarray:
        """The same in units of their own weight, in place, or metres and radians would meet."""
        p = self._pattern
        self.unit = 1.0 / np.sqrt(np.maximum(values[p.diagonal], 1e-300))
        unit = self.unit[self._order]
        own, link, edge, corner = p.layout.views(values)
        for k, (start, end) in enumerate(zip(p.layout.starts, p.layout.ends, strict=True)):
            mine, after = unit[start:end], unit[p.layout.fronts.later[k]]
            own[k] *= mine
            own[k] *= mine[:, None]
            link[k] *= mine
            link[k] *= after[:, None]
        inner, outer = unit[: p.layout.inner], unit[p.layout.inner :]
        edge *= inner[:, None]
        edge *= outer
        corner *= outer
        corner *= outer[:, None]
        if self.equations.free_motions is not None:
            self._hold(own[0])
        return values

    def _hold(self, matrix: np.ndarray) -> None:
        """Hold a block that nothing holds as a whole, where it is, in its equations (n, n)."""
        g = self.equations.free_motions
        whole = np.zeros((len(matrix), g.shape[1]))
        whole[: len(g)] = g / np.linalg.norm(g, axis=0)
        whole = (self.unit[:, None] * whole)[self._order]
        # The median of the diagonal of poses and nuisance before it was brought to units.
        matrix += np.median(self.equations.matrix.diagonal()) * (whole @ whole.T)

    def _ordered_right(self, right: np.ndarray, antenna: np.ndarray) -> np.ndarray:
        """Right sides (n, k) in the order of the chain, of those of the static rows.

        antenna (3k, k): what they come with of antenna positions, to be weighed.
        """
        right, antenna = (one if one.ndim == 2 else one[:, None] for one in (right, antenna))
        place, static = self._pattern.place, len(right)
        out = np.empty((len(place), right.shape[1]))
        out[place[:static]] = right
        if len(self._white):
            heavy = self._white[:, None] * antenna
            out[place[:static]] += self.jacobian.T @ heavy
            out[place[static:]] = self._size[:, None] * heavy[self._states]
        out *= self.unit[self._order, None]
        return out

    def _core_half(self, columns: np.ndarray) -> np.ndarray:
        """Half a solution (n, k) for columns (k,) of what images share, some at a time: each copy
        of all of them weighs as much as the chain.
        """
        antenna = self.equations.core.antenna
        out = np.empty((len(self._order), len(columns)))
        for first in range(0, len(columns), _COLUMNS):
            some = columns[first : first + _COLUMNS]
            right = self._ordered_right(self.cross[:, some], antenna[:, some])
            out[:, first : first + _COLUMNS] = self.chain.half(right)
        return out

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

    @property
    def _all(self) -> np.ndarray:
        return np.arange(self.cross.shape[1])

    @cached_property
    def core(self) -> tuple[np.ndarray, np.ndarray]:
        """M (c, c) and g (c,) of what images share."""
        return self.core_of(self._all)

    def core_of(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """M (k, k) and g (k,) of some columns (k,) of what images share."""
        e, block = self.equations, self.equations.core
        half, antenna = self._core_half(columns), block.antenna[:, columns]
        heavy = self._white[:, None] * antenna
        M = block.inside[np.ix_(columns, columns)] + antenna.T @ heavy - half.T @ half
        g = e.core_without[columns] + heavy.T @ self._residual - (half.T @ self._half)[:, 0]
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
        half = self.chain.half(self._ordered_right(static, antenna))
        core = self._core_half(self._all)
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

    def values(self, number: int) -> np.ndarray:
        """Parameters (p,) of the number-th group of the rows, in prior standard deviations."""
        return self._back(self.chain.other_half(self._half))[self._rows_of(number), 0]

    def variances(self, number: int) -> np.ndarray:
        """Variances (p,) of the parameters of the number-th group of the rows, prior sigmas."""
        variance = np.empty(len(self._order))
        variance[self._order] = self.chain.inverse().diagonal()
        return (self.unit**2 * variance)[self._rows_of(number)]

    def _rows_of(self, number: int) -> slice:
        ends = np.cumsum([len(self.equations.first), *(len(g) for g, _ in self.rows)])
        return slice(int(ends[number]), int(ends[number + 1]))

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
        right = self.cross[:, columns]
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
        slow = found[len(self.at) :]
        white = self._residual - self.jacobian @ found[: len(self.at)]
        white[self._states] -= self._size * slow
        white = white**2
        place, unit, j = self._pattern.place, self.unit, self.jacobian
        into = csr_array(
            (
                self._size * unit[len(self.at) :],
                (self._states, place[len(self.at) :]),
            ),
            shape=(len(self._white), len(place)),
        )
        seen = (j.data * unit[j.indices], place[j.indices], j.indptr)
        rows = csr_array(csr_array(seen, shape=into.shape) + into)
        white = white + inverse.variances(rows)
        place, unit = place[len(self.at) :], unit[len(self.at) :]
        square = slow**2 + unit**2 * inverse.diagonal()[place]
        pairs = slow[:-1] * slow[1:] + unit[:-1] * unit[1:] * inverse.between(place[:-1], place[1:])
        return white, square, pairs, self._states


def rows_of(chosen: Iterable[tuple[Group, float | np.ndarray]]) -> Rows:
    """Groups and their sizes, as rows of an elimination."""
    return tuple((group, np.broadcast_to(np.asarray(s, float), len(group))) for group, s in chosen)


def _mean_of(group: Group) -> np.ndarray:
    return np.zeros(len(group)) if group.mean is None else group.mean


def _dense(matrix: np.ndarray | csc_array) -> np.ndarray:
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)


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
        _dense(core),
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


def _lower(e: Equations, groups: list[Group], parts: list[Part]) -> coo_array:
    """Lower triangle (n, n) of the equations of the static rows, but for antenna and priors."""
    blocks = [(0, 0, tril(e.matrix))]
    begin = np.cumsum([len(e.first), *(len(group) for group in groups)]).tolist()
    for n, part in enumerate(parts):
        blocks.append((begin[n], 0, part.cross.T))
        blocks += [(begin[n], begin[k], _between(e, groups[n], groups[k])) for k in range(n)]
        blocks.append((begin[n], begin[n], tril(part.inside)))
    found = [(down, right, coo_array(block)) for down, right, block in blocks]
    row = np.concatenate([block.row.astype(np.int32) + down for down, _, block in found])
    column = np.concatenate([block.col.astype(np.int32) + right for _, right, block in found])
    data = np.concatenate([block.data for *_, block in found])
    return coo_array((data, (row, column)), shape=(begin[-1], begin[-1]))
