"""The noise of the GNSS: white plus exponentially correlated, per flight and axis.

    Sigma_ij = w^2 s_i^2 delta_ij + c^2 exp(-|t_i - t_j| / tau)

s: the stated standard deviations, which know of epochs next to a gap or a kink; w, c, tau by
restricted maximum likelihood. The reduced system gives P and rho, weight and weighted residual of
the antenna positions after everything else has been fitted with Sigma_0; for another Sigma

    -2 log L = log |I + P D| + rho' D' ... with D = Sigma - Sigma_0,
             = log |I + P D| - rho' D (I + P D)^-1 rho + const

Source: Patterson and Thompson 1971, "Recovery of inter-block information when block sizes are
unequal"; Harville 1977 for the gradient, tr(V dSigma) - v' dSigma v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, lu_factor, lu_solve
from scipy.optimize import minimize
from scipy.sparse import csr_array

from corridor.diagnosis.evidence import Evidence

# Weak knowledge: mean and standard deviation of the logarithms of w, c over the stated sigma, and
# tau in seconds. It keeps short flights sensible.
PRIOR_WHITE = (np.log(0.7), 0.7)
PRIOR_COLOURED = (np.log(0.6), 0.9)
PRIOR_TAU = (np.log(60.0), 0.6)
TAU_LEAST, TAU_MOST = 4.0, 240.0
# Positions whose noise is estimated together; more are taken flight by flight, axis by axis.
TOGETHER = 900


@dataclass
class GnssNoise:
    """Noise of antenna positions.

    flight, time: (k,) of each position. stated: (3k,) m. white: (flights, 3) factor on the stated
    standard deviation; coloured: (flights, 3) m; tau: (flights,) s.
    """

    flight: np.ndarray
    time: np.ndarray
    stated: np.ndarray
    white: np.ndarray
    coloured: np.ndarray
    tau: np.ndarray

    def __post_init__(self):
        self._inverse = None

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
        lag = np.abs(self.time[rows // 3][:, None] - self.time[rows // 3])
        return white, self.coloured[f, axis] ** 2 * np.exp(-lag / self.tau[f]), lag

    def weigh(self, rows):
        """Inverse covariance times rows (3k, ...), sparse or dense."""
        if self._inverse is None:
            self._inverse = self._inverted()
        return self._inverse @ rows

    def _inverted(self) -> csr_array:
        row, column, data = [], [], []
        for rows, f, axis in self.blocks():
            white, coloured, _ = self.parts(rows, f, axis)
            inverse = np.linalg.inv(white + coloured)
            row.append(np.repeat(rows, len(rows)))
            column.append(np.tile(rows, len(rows)))
            data.append(inverse.ravel())
        n = len(self.stated)
        if not row:
            return csr_array((n, n))
        parts = (np.concatenate(part) for part in (data, row, column))
        data, row, column = parts
        return csr_array((data, (row, column)), shape=(n, n))

    @property
    def size(self) -> np.ndarray:
        """Standard deviation (flights, 3), m, of one position."""
        out = np.zeros_like(self.coloured)
        for rows, f, axis in self.blocks():
            white = self.white[f, axis] ** 2 * np.mean(self.stated[rows] ** 2)
            out[f, axis] = np.sqrt(white + self.coloured[f, axis] ** 2)
        return out


def times_of(images, image: np.ndarray) -> np.ndarray:
    """Times (k,) of antenna positions; where they are unknown, one image is two seconds."""
    time = images.time[image]
    if np.isfinite(time).all():
        return time
    return 2.0 * image.astype(float)


def stated_noise(equations) -> GnssNoise:
    """The noise that gnss.csv states, white."""
    images = equations.problem.images
    flights = len(images.flight_names)
    return GnssNoise(
        images.flight[equations.image], times_of(images, equations.image), equations.stated,
        np.ones((flights, 3)), np.zeros((flights, 3)), np.full(flights, np.exp(PRIOR_TAU[0])),
    )  # fmt: skip


class NoiseModel:
    """The noise of the GNSS by restricted maximum likelihood, for any set of effects.

    What is missing from a model inflates the noise that one finds, and then hides in it: noise
    and effects have to be compared together. `given` finds the noise of a model of some groups,
    and how probable the data are with both.
    """

    def __init__(self, equations, elimination, evidence: Evidence):
        """elimination, evidence: with the stated noise."""
        self.stated = stated_noise(equations)
        self.evidence = evidence
        self.few = len(equations.residual) < 12
        self._found: dict[tuple, tuple[GnssNoise, float]] = {}
        if not self.few:
            self.P, self.rho, self.core, self.own = elimination.antennas()

    def touches(self, n: int) -> float:
        """How much of what a group explains the antenna positions see: 0 to 1, or more."""
        if self.few:
            return 0.0
        group = self.evidence.groups[n]
        across = self._across(group)
        if across is None:
            return 0.0
        inside = np.diag(self.evidence.block(group)[0])
        seen = np.einsum("ij,ij->j", across, across * (self.stated.stated**2)[:, None])
        return float(np.max(seen / np.maximum(inside, 1e-12), initial=0.0))

    def _across(self, group) -> np.ndarray:
        return self.core[:, group.columns] if group.own is None else self.own[group.own]

    def given(self, chosen: dict[int, float], start: GnssNoise | None = None):
        """The noise of a model of groups n -> kappa, and the log probability of the data."""
        base, theta, factor = self.evidence.model(chosen)
        if self.few:
            return self.stated, base
        key = tuple(sorted(chosen.items()))
        if key not in self._found:
            P, rho = self.P, self.rho
            if chosen:
                groups = [self.evidence.groups[n] for n in chosen]
                across = np.concatenate(
                    [
                        np.zeros((len(rho), len(group)))
                        if self._across(group) is None
                        else self._across(group)
                        for group in groups
                    ],
                    axis=1,
                )
                P = P - across @ cho_solve(factor, across.T, check_finite=False)
                rho = rho - across @ theta
            noise, value = _estimate(self.stated, P, rho, start)
            self._found[key] = noise, base - 0.5 * value
        return self._found[key]


def _estimate(noise: GnssNoise, P, rho, start=None) -> tuple[GnssNoise, float]:
    """The noise that P and rho, made with `noise` stated, tell of; and -2 log L."""
    blocks = list(noise.blocks())
    if len(rho) <= TOGETHER:
        return _fit(noise, P, rho, blocks, start)
    value = 0.0
    for block in blocks:
        # The others stay as stated: their part of D is zero in this block's equations.
        rows = block[0]
        noise, part = _fit(noise, P[np.ix_(rows, rows)], rho[rows], [block], start, own=True)
        value += part
    return noise, value


def _fit(noise, P, rho, blocks, begin=None, own=False) -> tuple[GnssNoise, float]:
    """Parameters of some blocks, and -2 log L; own: P and rho hold those blocks only."""
    flights = sorted({f for _, f, _ in blocks})
    stated = {(f, axis): np.sqrt(np.mean(noise.stated[rows] ** 2)) for rows, f, axis in blocks}
    count = len(blocks)
    start = np.concatenate(
        [np.full(count, PRIOR_WHITE[0]), np.full(count, PRIOR_COLOURED[0]),
         np.full(len(flights), PRIOR_TAU[0])]
    )  # fmt: skip
    centre = start.copy()
    width = np.concatenate(
        [np.full(count, PRIOR_WHITE[1]), np.full(count, PRIOR_COLOURED[1]),
         np.full(len(flights), PRIOR_TAU[1])]
    )  # fmt: skip
    if begin is not None:
        for n, (_, f, axis) in enumerate(blocks):
            start[n] = np.log(begin.white[f, axis])
            start[count + n] = np.log(max(begin.coloured[f, axis] / stated[f, axis], 0.03))
            start[2 * count + flights.index(f)] = np.log(begin.tau[f])
    lags = [np.abs(noise.time[r // 3][:, None] - noise.time[r // 3]) for r, _, _ in blocks]
    place = [np.arange(len(r)) if own else r for r, _, _ in blocks]
    first = [noise.stated[r] ** 2 for r, _, _ in blocks]

    def minus_two_log(x):
        inner = np.eye(len(P))
        right = np.zeros(len(P))
        parts = []
        for n, (_, f, axis) in enumerate(blocks):
            tau = np.exp(x[2 * count + flights.index(f)])
            white = np.exp(2 * x[n]) * first[n]
            coloured = np.exp(2 * x[count + n]) * stated[f, axis] ** 2 * np.exp(-lags[n] / tau)
            block = coloured.copy()
            block[np.diag_indices(len(white))] += white - first[n]
            inner[:, place[n]] += P[:, place[n]] @ block
            right[place[n]] = block @ rho[place[n]]
            parts.append((white, coloured, tau))
        factor = lu_factor(inner, check_finite=False)
        logdet = float(np.sum(np.log(np.abs(np.diag(factor[0])))))
        V = lu_solve(factor, P, check_finite=False)
        v = lu_solve(factor, rho, check_finite=False)
        value = logdet - float(right @ v)
        slope = np.zeros_like(x)
        for n, (_, f, _) in enumerate(blocks):
            white, coloured, tau = parts[n]
            at = place[n]
            inside = V[np.ix_(at, at)] - np.outer(v[at], v[at])
            slope[n] = 2.0 * np.sum(np.diag(inside) * white)
            weighted = inside * coloured
            slope[count + n] = 2.0 * weighted.sum()
            slope[2 * count + flights.index(f)] += np.sum(weighted * lags[n]) / tau
        away = (x - centre) / width
        return value + away @ away, slope + 2.0 * away / width

    low = np.concatenate([np.full(2 * count, np.log(0.03)), np.full(len(flights), 0.0)])
    high = np.concatenate([np.full(2 * count, np.log(30.0)), np.full(len(flights), 0.0)])
    low[2 * count :], high[2 * count :] = np.log(TAU_LEAST), np.log(TAU_MOST)
    found = minimize(
        minus_two_log, start, jac=True, method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        # From where another model ended, little is left to do.
        options={"maxiter": 40 if begin is None else 12, "ftol": 1e-6},
    )  # fmt: skip
    white, coloured, tau = noise.white.copy(), noise.coloured.copy(), noise.tau.copy()
    for n, (_, f, axis) in enumerate(blocks):
        white[f, axis] = np.exp(found.x[n])
        coloured[f, axis] = np.exp(found.x[count + n]) * stated[f, axis]
        tau[f] = np.exp(found.x[2 * count + flights.index(f)])
    made = GnssNoise(noise.flight, noise.time, noise.stated, white, coloured, tau)
    return made, float(found.fun)
