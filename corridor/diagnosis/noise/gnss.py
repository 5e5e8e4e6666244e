"""The noise of the GNSS: white plus exponentially correlated, per flight and axis.

    Sigma_ij = w^2 s_i^2 delta_ij + c^2 exp(-|t_i - t_j| / tau)

s: the stated standard deviations, which know of epochs next to a gap or a kink; w, c, tau by
restricted maximum likelihood. The reduced system gives P and rho, weight and weighted residual of
the antenna positions after everything else has been fitted with Sigma_0; for another Sigma

    -2 log L = log |I + P D| + rho' D' ... with D = Sigma - Sigma_0,
             = log |I + P D| - rho' D (I + P D)^-1 rho + const

with I + P D = P (P^-1 + D), whose Cholesky factor also gives V = (P^-1 + D)^-1 for the gradient.

How slow noise can be large is a matter of its class: a fixed carrier-phase solution (RTK, PPK) is
good to centimetres, one from code to metres, whatever a model lacks.
Source: Patterson and Thompson 1971, "Recovery of inter-block information when block sizes are
unequal"; Harville 1977 for the gradient, tr(V dSigma) - v' dSigma v.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize
from scipy.sparse import block_diag, csr_array, diags_array

from corridor.core.adjustment import LinearSystem
from corridor.core.geometry import robust_scale
from corridor.core.gnss import SlowNoise
from corridor.diagnosis.settings import SETTINGS

# Share of slow noise that is new after no time at all: two positions of one moment.
_FRESH = 1e-9
# Share of its stated weight that every coordinate gets, so that P has an inverse: it has none of
# what has been projected out, to as many digits as that was known.
_LITTLE = 1e-7


@dataclass
class GnssNoise:
    """Noise of antenna positions.

    flight, time: (k,) of each position. stated: (3k,) m. white: (flights, 3) factor on the stated
    standard deviation; coloured: (flights, 3) m; tau: (flights, 3) s. most: (2, 3) m, largest white
    and coloured part that such positions have.
    """

    flight: np.ndarray
    time: np.ndarray
    stated: np.ndarray
    white: np.ndarray
    coloured: np.ndarray
    tau: np.ndarray
    most: np.ndarray = field(default_factory=lambda: np.full((2, 3), np.inf))

    def blocks(self):
        """Rows (n,) of 3k, flight and axis of each block of the covariance."""
        for f in range(len(self.tau)):
            rows = np.flatnonzero(self.flight == f)
            if len(rows):
                for axis in range(3):
                    yield 3 * rows + axis, f, axis

    def parts(self, rows, f, axis):
        """White and coloured covariance (n, n) of a block."""
        white = np.diag((self.white[f, axis] * self.stated[rows]) ** 2)
        slow = SlowNoise(self.tau[f, axis]).correlation(self.time[rows // 3])
        return white, self.coloured[f, axis] ** 2 * slow

    @property
    def white_weight(self) -> np.ndarray:
        """Weights (3k,) of the white part alone, 1/m2."""
        axis = np.tile(np.arange(3), len(self.flight))
        return (self.white[np.repeat(self.flight, 3), axis] * self.stated) ** -2.0

    def slow_parts(self) -> Iterator[tuple[np.ndarray, float, np.ndarray]]:
        """Of each block its rows (n,) in the order of time, the size of its slow part, m, and the
        precision of that in units of the size: its diagonal and what is above it (2, n).

        What remembers only its last value has a precision of neighbours. Source: Rue and Held
        2005, "Gaussian Markov random fields", 1.1.
        """
        for rows, f, axis in self.blocks():
            rows = rows[np.argsort(self.time[rows // 3], kind="stable")]
            precision = _precision(np.diff(self.time[rows // 3]), self.tau[f, axis])
            yield rows, float(self.coloured[f, axis]), precision

    def states(self) -> tuple[np.ndarray, np.ndarray, csr_array]:
        """Rows (s,) of 3k with a slow part, its size (s,) m, and its precision (s, s) in units of
        the size: what is measured there less the slow part has the white part alone.
        """
        parts = [part for part in self.slow_parts() if part[1] > 0.0]
        if not parts:
            return np.zeros(0, dtype=np.int64), np.zeros(0), csr_array((0, 0))
        chains = [diags_array([q[1], q[0, 1:], q[0, 1:]], offsets=[0, 1, -1]) for *_, q in parts]
        rows = np.concatenate([rows for rows, *_ in parts])
        size = np.concatenate([np.full(len(rows), size) for rows, size, _ in parts])
        return rows, size, csr_array(block_diag(chains))

    def weigh(self, rows):
        """Inverse covariance times dense rows (3k, ...)."""
        rows = np.asarray(rows)
        weight = self.white_weight.reshape((-1,) + (1,) * (rows.ndim - 1))
        out = weight * rows
        for at, size, precision in self.slow_parts():
            if size > 0.0:
                inside = precision.copy()
                inside[1] += size**2 * weight[at].ravel()
                out[at] -= size**2 * weight[at] * solveh_banded(inside, out[at])
        return out

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Covariance times dense rows (3k, n)."""
        out = rows / self.white_weight[:, None]
        for at, size, precision in self.slow_parts():
            if size > 0.0:
                out[at] += size**2 * solveh_banded(precision, rows[at])
        return out

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Errors (k, 3), m."""
        out = np.zeros(len(self.stated))
        for rows, f, axis in self.blocks():
            slow = SlowNoise(self.tau[f, axis]).draw(self.time[rows // 3], rng)[:, 0]
            white = self.white[f, axis] * self.stated[rows] * rng.standard_normal(len(rows))
            out[rows] = white + self.coloured[f, axis] * slow
        return out.reshape(-1, 3)

    @property
    def size(self) -> np.ndarray:
        """Standard deviation (flights, 3), m, of one position."""
        out = np.zeros_like(self.coloured)
        for rows, f, axis in self.blocks():
            white = self.white[f, axis] ** 2 * np.mean(self.stated[rows] ** 2)
            out[f, axis] = np.sqrt(white + self.coloured[f, axis] ** 2)
        return out


def _precision(gaps: np.ndarray, tau: float) -> np.ndarray:
    """Precision of slow noise of size one: its diagonal and what is above it (2, n).

    gaps (n - 1,): between the positions in the order of time, s.
    """
    kept = SlowNoise(tau).memory(gaps)
    fresh = np.maximum(1.0 - kept**2, _FRESH)
    out = np.zeros((2, len(gaps) + 1))
    out[1, 0] = 1.0
    out[1, 1:] = 1.0 / fresh
    out[1, :-1] += kept**2 / fresh
    out[0, 1:] = -kept / fresh
    return out


class Weight:
    """P (n, n) of antenna coordinates, made by parts where they are asked for.

    make: (k,) numbers of all coordinates -> their part (k, k) of the whole. rows (n,): numbers of
    those that are meant. less: pairs (n, k), (k, n) of which the product has been taken away.
    """

    def __init__(self, make: Callable[[np.ndarray], np.ndarray], rows: np.ndarray, less=()):
        self._make, self.rows, self.taken = make, rows, list(less)

    @classmethod
    def of(cls, P: Weight | np.ndarray) -> Weight:
        """Itself, or of a matrix that is there."""
        if isinstance(P, Weight):
            return P
        return cls(lambda rows: P[np.ix_(rows, rows)], np.arange(len(P)))

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, at: np.ndarray) -> Weight:
        """Of some of the coordinates."""
        return Weight(self._make, self.rows[at], [(a[at], b[:, at]) for a, b in self.taken])

    def less(self, left: np.ndarray, right: np.ndarray) -> Weight:
        """P - left right, for left (n, k) and right (k, n)."""
        return Weight(self._make, self.rows, [*self.taken, (left, right)])

    def toarray(self) -> np.ndarray:
        """The matrix (n, n)."""
        out = np.array(self._make(self.rows))
        for left, right in self.taken:
            out -= left @ right
        return out


def times_of(images, image: np.ndarray) -> np.ndarray:
    """Times (k,) of antenna positions; where they are unknown, one image is two seconds."""
    time = images.time[image]
    if np.isfinite(time).all():
        return time
    return SETTINGS.untimed_step * image.astype(float)


def stated_noise(system: LinearSystem) -> GnssNoise:
    """The noise that gnss.csv states, white."""
    images, rows = system.images, system.gnss
    flights = len(images.flight_names)
    return GnssNoise(
        flight=images.flight[rows.image],
        time=times_of(images, rows.image),
        stated=rows.sigma.ravel(),
        white=np.ones((flights, 3)),
        coloured=np.zeros((flights, 3)),
        tau=np.full((flights, 3), SETTINGS.time_constant_prior[0]),
        most=most_of_class(system),
    )


def most_of_class(system: LinearSystem) -> np.ndarray:
    """Largest white and slow part (2, 3) m of antenna positions, by their class.

    The class is told by what is stated and by how much positions differ from one to the next, of
    which slow noise has no part: who states centimetres of a code solution is not believed.
    """
    rows, images = system.gnss, system.images
    if len(rows.image) < 2:
        return np.full((2, 3), np.inf)
    stated = np.median(rows.sigma, axis=0)
    order = np.lexsort((times_of(images, rows.image), images.flight[rows.image]))
    step = np.diff(rows.residual[order], axis=0) / np.sqrt(2.0)
    scatter = robust_scale(step, axis=0)
    if np.maximum(stated, scatter)[:2].max() > SETTINGS.carrier_phase_plan:
        return np.full((2, 3), np.inf)
    slow = np.maximum(SETTINGS.carrier_phase_slow, np.minimum(stated, scatter))
    return np.array([SETTINGS.white_of_scatter * scatter, slow])


def estimate(noise: GnssNoise, P, rho, start=None) -> tuple[GnssNoise, float]:
    """The noise that P and rho, made with `noise` stated, tell of; and -2 log L."""
    value = 0.0
    for one in parts_of(noise, P, rho):
        found = one.minimum(None if start is None else one.arguments(start))
        noise = one.noise_at(found.x, noise)
        value += float(found.fun)
    return noise, value


def parts_of(noise: GnssNoise, P, rho) -> list[Likelihood]:
    """The likelihood as a whole, or of long flights axis by axis.

    Axis by axis the others stay as stated: their part of D is zero in this axis's equations.
    """
    blocks = list(noise.blocks())
    if len(rho) <= SETTINGS.most_together:
        return [Likelihood(noise, P, rho, blocks)]
    P = Weight.of(P)
    return [
        Likelihood(noise, P.part(block[0]), rho[block[0]], [block], own=True) for block in blocks
    ]


def in_pieces(time: np.ndarray) -> list[np.ndarray]:
    """Numbers of positions of one axis at times (n,) that are taken together, s."""
    if len(time) <= SETTINGS.most_at_a_time:
        return [np.arange(len(time))]
    count = -(-len(time) // SETTINGS.most_at_a_time)
    return np.array_split(np.argsort(time, kind="stable"), count)


class _Noise(NamedTuple):
    """Noise of one block in the order of time: variances of its white part (n,) m2, covariance of
    its slow part (n, n) m2, and the time constant of that, s.
    """

    white: np.ndarray
    slow: np.ndarray
    tau: float


class Likelihood:
    """-2 log L of the noise of some blocks (rows, flight, axis).

    Arguments x: logarithms of w of each block, of c over the stated sigma of each, of tau of each
    flight. P: (n, n), or a `Weight`. own: P and rho hold the rows of these blocks only; a long
    block of them is taken in pieces of time, beyond which it remembers nothing. bounds: least and
    most of w, c and tau, where nothing else is known of them; default: the weak prior knowledge of
    the settings.
    """

    def __init__(self, noise: GnssNoise, P, rho, blocks, own: bool = False, bounds=None):
        self.blocks = blocks
        self.flights = sorted({f for _, f, _ in blocks})
        self.count = len(blocks)
        self.stated = np.array([np.sqrt(np.mean(noise.stated[rows] ** 2)) for rows, *_ in blocks])
        time = [noise.time[rows // 3] for rows, *_ in blocks]
        apart = own and len(rho) > SETTINGS.most_at_a_time
        P = Weight.of(P)
        self.first = [noise.stated[rows] ** 2 for rows, *_ in blocks]
        # Block after block, of which each is a slice then.
        self.order = np.arange(len(rho)) if own else np.concatenate([rows for rows, *_ in blocks])
        ends = np.cumsum([len(rows) for rows, *_ in blocks]).tolist()
        self.place = [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
        if not apart:
            self.lags = [np.abs(t[:, None] - t) for t in time]
            self.rho = rho[self.order]
            P = P.toarray()[np.ix_(self.order, self.order)]
            self._factor = _possible(P, np.sqrt(np.concatenate(self.first)))
        many = [self.count, self.count, len(self.flights)]
        prior = SETTINGS.white_prior, SETTINGS.slow_prior, SETTINGS.time_constant_prior
        self.centre = np.repeat([np.log(p[0]) for p in prior], many)
        covariance = np.diag(np.repeat([p[2] ** 2 for p in prior], many))
        kind = np.repeat([0, 1, 2], many)
        covariance += (kind[:, None] == kind) * np.repeat([p[1] ** 2 for p in prior], many)
        self.precision = np.linalg.inv(covariance)
        factor, tau = SETTINGS.noise_factor_range, SETTINGS.time_constant_range
        ends = (factor, factor, tau) if bounds is None else bounds
        if bounds is not None:
            self.precision = np.zeros_like(covariance)
        self.low, self.high = (np.repeat(np.log([e[k] for e in ends]), many) for k in (0, 1))
        if bounds is None:
            two = slice(2 * self.count)
            size = np.maximum(noise.most[:, [axis for *_, axis in blocks]], 1e-9) / self.stated
            self.high[two] = np.clip(np.log(size).ravel(), self.low[two], self.high[two])
        self.pieces: list[Likelihood] = []
        if apart:
            ((rows, *which),) = blocks
            for at in in_pieces(time[0]):
                some = [(rows[at], *which)]
                # What is known beforehand counts once, here.
                one = Likelihood(noise, P.part(at), rho[at], some, own=True, bounds=ends)
                one.stated = self.stated
                self.pieces.append(one)

    def minimum(self, start: np.ndarray | None = None, low=None, high=None):
        """Where -2 log L is least (x, fun), as of `scipy.optimize.minimize`.

        start: arguments to begin from; default: what one would expect. low, high: other bounds.
        """
        low, high = (self.low if low is None else low), (self.high if high is None else high)
        return minimize(
            self,
            np.clip(self.centre if start is None else start, low, high),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)),
            options={"maxiter": 40, "ftol": 1e-6},
        )

    def arguments(self, noise: GnssNoise) -> np.ndarray:
        """The arguments of a noise."""
        x = np.empty_like(self.centre)
        for n, (_, f, axis) in enumerate(self.blocks):
            x[n] = np.log(noise.white[f, axis])
            x[self.count + n] = np.log(
                max(noise.coloured[f, axis] / self.stated[n], SETTINGS.noise_factor_range[0])
            )
            x[2 * self.count + self.flights.index(f)] = np.log(noise.tau[f, axis])
        return x

    def noise_at(self, x, noise: GnssNoise) -> GnssNoise:
        """`noise` with these parameters in place of its own."""
        white, coloured, tau = noise.white.copy(), noise.coloured.copy(), noise.tau.copy()
        for n, (_, f, axis) in enumerate(self.blocks):
            white[f, axis] = np.exp(x[n])
            coloured[f, axis] = np.exp(x[self.count + n]) * self.stated[n]
            tau[f, axis] = np.exp(x[2 * self.count + self.flights.index(f)])
        return replace(noise, white=white, coloured=coloured, tau=tau)

    def _at(self, x: np.ndarray) -> list[_Noise]:
        """The noise of each block at x."""
        flight = [self.flights.index(f) for _, f, _ in self.blocks]
        white, coloured, tau = np.split(np.exp(x), [self.count, 2 * self.count])
        return self._of(white, coloured * self.stated, tau[flight])

    def _of(self, white, coloured, tau) -> list[_Noise]:
        """The noise of each block, of white (blocks,) factors, coloured (blocks,) m, tau, s."""
        each = zip(self.first, self.lags, white, coloured, tau, strict=True)
        return [
            _Noise(w**2 * first, c**2 * SlowNoise(constant).memory(lags), constant)
            for first, lags, w, c, constant in each
        ]

    @cached_property
    def _inverse(self) -> tuple[np.ndarray, float]:
        """P^-1 (n, n) and log |P|."""
        return _inverted(self._factor), _logdet(self._factor)

    @cached_property
    def _explained(self) -> np.ndarray:
        """P^-1 rho (n,)."""
        return self._inverse[0] @ self.rho

    def _factorised(self, each: list[_Noise]) -> np.ndarray:
        """Cholesky factor (n, n) of P^-1 + D."""
        inner = self._inverse[0].copy(order="F")
        for one, first, at in zip(each, self.first, self.place, strict=True):
            inner[at, at] += one.slow
            np.einsum("ii->i", inner[at, at])[:] += one.white - first
        return dpotrf(inner, lower=1, clean=1, overwrite_a=1)[0]

    def _times(self, each: list[_Noise], columns: np.ndarray) -> np.ndarray:
        """D times columns (n, ...)."""
        out = np.empty_like(columns)
        for one, first, at in zip(each, self.first, self.place, strict=True):
            change = (one.white - first).reshape(-1, *[1] * (columns.ndim - 1))
            out[at] = one.slow @ columns[at] + change * columns[at]
        return out

    def solved(self, noise: GnssNoise, columns: np.ndarray) -> np.ndarray:
        """D (I + P D)^-1 columns (n, k) of a noise."""
        at = tuple(np.transpose([(f, axis) for _, f, axis in self.blocks]))
        each = self._of(noise.white[at], noise.coloured[at], noise.tau[at])
        inner, _ = dpotrs(self._factorised(each), self._inverse[0] @ columns[self.order], lower=1)
        out = np.empty_like(inner)
        out[self.order] = self._times(each, inner)
        return out

    def value(self, x: np.ndarray) -> float:
        """-2 log L at x."""
        away = x - self.centre
        far = float(away @ self.precision @ away)
        if self.pieces:
            return sum(one.value(x) for one in self.pieces) + far
        each = self._at(x)
        factor = self._factorised(each)
        v, _ = dpotrs(factor, self._explained, lower=1)
        explained = float(self._times(each, self.rho) @ v)
        return self._inverse[1] + _logdet(factor) - explained + far

    def __call__(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """-2 log L at x, and its gradient."""
        away = x - self.centre
        pull = self.precision @ away
        if self.pieces:
            found = [one(x) for one in self.pieces]
            value = sum(one for one, _ in found) + float(away @ pull)
            return value, sum(slope for _, slope in found) + 2.0 * pull
        each = self._at(x)
        factor = self._factorised(each)
        V = _inverted(factor)
        v = V @ self._explained
        slope = np.zeros_like(x)
        for n, (one, at) in enumerate(zip(each, self.place, strict=True)):
            inside = V[at, at] - np.outer(v[at], v[at])
            slope[n] = 2.0 * float(inside.diagonal() @ one.white)
            inside *= one.slow
            slope[self.count + n] = 2.0 * inside.sum()
            flight = self.flights.index(self.blocks[n][1])
            slope[2 * self.count + flight] += np.vdot(inside, self.lags[n]) / one.tau
        explained = float(self._times(each, self.rho) @ v)
        value = self._inverse[1] + _logdet(factor) - explained
        return value + float(away @ pull), slope + 2.0 * pull

    def likely(self, x, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Arguments (count, n) that are likely too, and -2 log of the density of each.

        From the normal distribution of the curvature at x, somewhat widened.
        """
        step = 1e-3
        rows = [
            (self(x + step * one)[1] - self(x - step * one)[1]) / (2 * step)
            for one in np.eye(len(x))
        ]
        value, vector = np.linalg.eigh(0.25 * (np.array(rows) + np.array(rows).T))
        # Nothing is known less well than the prior says.
        least = np.linalg.eigvalsh(self.precision)[0]
        spread = 1.0 / np.sqrt(np.maximum(value, least))
        unit = rng.standard_normal((count, len(x)))
        made = np.clip(
            x + SETTINGS.noise_draws_widened * (unit * spread) @ vector.T, self.low, self.high
        )
        return made, np.sum(unit**2, axis=1)


def _possible(P: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """The Cholesky factor of P (n, n) and a little, without weights below zero.

    stated (n,): standard deviations, m. What an approximation took away from P may be more than
    there was: then nothing is left.
    """
    little = np.diag(_LITTLE * stated**-2.0)
    factor, failed = dpotrf(P + little, lower=1, clean=1)
    if failed:
        scale = np.outer(stated, stated)
        value, vector = np.linalg.eigh(P * scale)
        P = (vector * np.maximum(value, 0.0)) @ vector.T / scale
        factor, _ = dpotrf(P + little, lower=1, clean=1)
    return factor


def _inverted(factor: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of the matrix of a Cholesky factor."""
    lower, _ = dpotri(factor, lower=1)
    inverse = lower + lower.T
    inverse[np.diag_indices(len(inverse))] *= 0.5
    return inverse


def _logdet(factor: np.ndarray) -> float:
    """Logarithm of the determinant of the matrix of a Cholesky factor."""
    return 2.0 * float(np.log(factor.diagonal()).sum())
