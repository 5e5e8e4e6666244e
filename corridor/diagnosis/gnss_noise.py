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

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, lu_factor, lu_solve
from scipy.optimize import minimize
from scipy.sparse import csr_array

from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.settings import SETTINGS
from corridor.gnss import SlowNoise


@dataclass
class GnssNoise:
    """Noise of antenna positions.

    flight, time: (k,) of each position. stated: (3k,) m. white: (flights, 3) factor on the stated
    standard deviation; coloured: (flights, 3) m; tau: (flights, 3) s.
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
        slow = SlowNoise(self.tau[f, axis]).correlation(self.time[rows // 3])
        return white, self.coloured[f, axis] ** 2 * slow

    def weigh(self, rows):
        """Inverse covariance times rows (3k, ...), sparse or dense."""
        if self._inverse is None:
            self._inverse = self._inverted()
        return self._inverse @ rows

    def _inverted(self) -> csr_array:
        row, column, data = [], [], []
        for rows, f, axis in self.blocks():
            white, coloured = self.parts(rows, f, axis)
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
    return SETTINGS.untimed_step * image.astype(float)


def stated_noise(equations) -> GnssNoise:
    """The noise that gnss.csv states, white."""
    images = equations.system.images
    flights = len(images.flight_names)
    return GnssNoise(
        images.flight[equations.image], times_of(images, equations.image), equations.stated,
        np.ones((flights, 3)), np.zeros((flights, 3)),
        np.full((flights, 3), SETTINGS.time_constant_prior[0]),
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
        self.few = len(equations.residual) < SETTINGS.few_antenna_coordinates
        self._found: dict[tuple, tuple[GnssNoise, float]] = {}
        self._start: GnssNoise | None = None
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

    def _across(self, group) -> np.ndarray | None:
        return self.core[:, group.columns] if group.own is None else self.own[group.own]

    def freedom(self, noise: GnssNoise) -> float:
        """Degrees of freedom with which the size of slow noise is known.

        Correlation times of all flights and axes, and what the prior knowledge is worth.
        """
        span = [
            np.ptp(noise.time[rows // 3]) / noise.tau[f, axis] for rows, f, axis in noise.blocks()
        ]
        return float(np.sum(span)) + 0.5 / SETTINGS.slow_prior[1] ** 2

    def given(self, chosen: dict[int, float]) -> tuple[GnssNoise, float]:
        """The noise of a model of groups n -> kappa, and the log probability of the data.

        It is sought from the noise of the model without any, whatever was asked before.
        """
        if self.few:
            return self.stated, self.evidence.model(chosen)[0]
        key = tuple(sorted(chosen.items()))
        if key not in self._found:
            if self._start is None:
                self._start, _ = _estimate(self.stated, self.P, self.rho)
            base, P, rho = self._left(chosen)
            noise, value = _estimate(self.stated, P, rho, self._start)
            self._found[key] = noise, base - 0.5 * value
        return self._found[key]

    def at(self, chosen: dict[int, float], noise: GnssNoise) -> float:
        """The log probability of the data with groups n -> kappa and this noise."""
        base, P, rho = self._left(chosen)
        parts = _parts(self.stated, P, rho)
        return base - 0.5 * sum(one.value(one.arguments(noise)) for one in parts)

    def apart(self, n: int, theta: np.ndarray) -> float:
        """Log likelihood by which the n-th group explains more than the noise could in its place.

        Of data like these, in which nothing is missing, with parameters theta (p,), in prior
        standard deviations, on top: once the noise alone is fitted to them, once the noise with
        the group. Of values for each image only their size is known then; of others all, and the
        mean of theta and -theta is taken, so that this block's noise has no part in it.
        """
        group = self.evidence.groups[n]
        M, g = self.evidence.block(group)
        A = self._columns([n])
        if group.own is None:
            _, alone = _estimate(self.stated, self.P, self.rho)
            both = [_estimate(self.stated, self.P, self.rho + A @ t)[1] for t in (theta, -theta)]
            return float(0.5 * theta @ M @ theta + 0.5 * (np.mean(both) - alone))
        rho, g = self.rho + A @ theta, g + M @ theta
        inside = M + np.eye(len(M)) / np.mean(theta**2)
        step = np.linalg.solve(inside, np.column_stack([g, A.T]))
        _, logdet = np.linalg.slogdet(inside * np.mean(theta**2))
        _, alone = _estimate(self.stated, self.P, rho)
        _, with_it = _estimate(self.stated, self.P - A @ step[:, 1:], rho - A @ step[:, 0])
        return float(0.5 * (g @ step[:, 0] - logdet + alone - with_it))

    def _left(self, chosen: dict[int, float]) -> tuple[float, np.ndarray, np.ndarray]:
        """Log evidence of groups with the stated noise, and the P and rho that they leave."""
        base, theta, factor = self.evidence.model(chosen)
        P, rho = self.P, self.rho
        if chosen:
            A = self._columns(chosen)
            P = P - A @ cho_solve(factor, A.T, check_finite=False)
            rho = rho - A @ theta
        return base, P, rho

    def _columns(self, chosen: Iterable[int]) -> np.ndarray:
        """Between the antenna positions and groups together (3k, columns)."""
        parts = []
        for n in chosen:
            across = self._across(self.evidence.groups[n])
            empty = np.zeros((len(self.rho), len(self.evidence.groups[n])))
            parts.append(empty if across is None else across)
        return np.concatenate(parts, axis=1)

    def parameters(
        self, chosen: dict[int, float], noise: GnssNoise, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Parameters (p,) of groups n -> kappa together and their covariance (p, p).

        Averaged over the noises that the data allow, near `noise`: how slow and how large it is
        is known from a few correlation times, and what looks like slow noise (a lever arm, a
        drift) is the less certain for it. None where the stated noise knows nothing of a group.
        """
        groups = [self.evidence.groups[n] for n in chosen]
        if any(g.own is not None and self.evidence.block(g)[0] is None for g in groups):
            return None
        theta, K = self.evidence.solution(chosen)
        if self.few:
            return theta, K
        A = self._columns(chosen)
        turned = A @ K
        P, rho = self.P - turned @ A.T, self.rho - A @ theta
        parts = _parts(self.stated, P, rho)
        count = SETTINGS.noise_draws if len(parts) == 1 else SETTINGS.noise_draws_by_axis
        drawn, log_weight = [], np.zeros(count)
        for one in parts:
            x, length = one.likely(one.arguments(noise), count, rng)
            log_weight -= 0.5 * (np.array([one(each)[0] for each in x]) - length)
            drawn.append(x)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        whole = Likelihood(self.stated, P, rho, list(self.stated.blocks()))
        columns = np.column_stack([turned, rho])
        found, spread = [], np.zeros_like(K)
        for k, share in enumerate(weight):
            one = noise
            for part, x in zip(parts, drawn, strict=True):
                one = part.noise_at(x[k], one)
            left = turned.T @ whole.solved(one, columns)
            found.append(theta - left[:, -1])
            spread += share * (K + left[:, :-1])
        mean = weight @ np.array(found)
        away = np.array(found) - mean
        return mean, spread + (away * weight[:, None]).T @ away


def _estimate(noise: GnssNoise, P, rho, start=None) -> tuple[GnssNoise, float]:
    """The noise that P and rho, made with `noise` stated, tell of; and -2 log L."""
    value = 0.0
    for one in _parts(noise, P, rho):
        found = one.minimum(start)
        noise = one.noise_at(found.x, noise)
        value += float(found.fun)
    return noise, value


def _parts(noise: GnssNoise, P, rho) -> list[Likelihood]:
    """The likelihood as a whole, or of long flights axis by axis.

    Axis by axis the others stay as stated: their part of D is zero in this axis's equations.
    """
    blocks = list(noise.blocks())
    if len(rho) <= SETTINGS.most_together:
        return [Likelihood(noise, P, rho, blocks)]
    return [
        Likelihood(noise, P[np.ix_(block[0], block[0])], rho[block[0]], [block], own=True)
        for block in blocks
    ]


class Likelihood:
    """-2 log L of the noise of some blocks (rows, flight, axis), with weak prior knowledge.

    Arguments x: logarithms of w of each block, of c over the stated sigma of each, of tau of each
    flight. own: P and rho hold the rows of these blocks only.
    """

    def __init__(self, noise: GnssNoise, P, rho, blocks, own: bool = False):
        self.P, self.rho, self.blocks, self.time = P, rho, blocks, noise.time
        self.flights = sorted({f for _, f, _ in blocks})
        self.count = len(blocks)
        self.stated = np.array([np.sqrt(np.mean(noise.stated[rows] ** 2)) for rows, *_ in blocks])
        self.first = [noise.stated[rows] ** 2 for rows, *_ in blocks]
        time = [noise.time[rows // 3] for rows, *_ in blocks]
        self.lags = [np.abs(t[:, None] - t) for t in time]
        self.place = [np.arange(len(rows)) if own else rows for rows, *_ in blocks]
        many = [self.count, self.count, len(self.flights)]
        prior = SETTINGS.white_prior, SETTINGS.slow_prior, SETTINGS.time_constant_prior
        self.centre = np.repeat([np.log(p[0]) for p in prior], many)
        covariance = np.diag(np.repeat([p[2] ** 2 for p in prior], many))
        kind = np.repeat([0, 1, 2], many)
        covariance += (kind[:, None] == kind) * np.repeat([p[1] ** 2 for p in prior], many)
        self.precision = np.linalg.inv(covariance)
        factor, tau = SETTINGS.noise_factor_range, SETTINGS.time_constant_range
        self.low, self.high = (
            np.repeat(np.log([factor[k], factor[k], tau[k]]), many) for k in (0, 1)
        )

    def minimum(self, start: GnssNoise | None = None):
        """Where -2 log L is least (x, fun), as of `scipy.optimize.minimize`."""
        x = self.centre.copy()
        if start is not None:
            x = self.arguments(start)
        return minimize(
            self, x, jac=True, method="L-BFGS-B",
            bounds=list(zip(self.low, self.high, strict=True)),
            options={"maxiter": 40, "ftol": 1e-6},
        )  # fmt: skip

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
        return GnssNoise(noise.flight, noise.time, noise.stated, white, coloured, tau)

    def parts(self, x):
        """White variances (n,), coloured covariance (n, n) and tau of each block."""
        for n, (_, f, _) in enumerate(self.blocks):
            tau = np.exp(x[2 * self.count + self.flights.index(f)])
            coloured = np.exp(2 * x[self.count + n]) * self.stated[n] ** 2
            yield (
                np.exp(2 * x[n]) * self.first[n],
                coloured * SlowNoise(tau).memory(self.lags[n]),
                tau,
            )

    def factor(self, parts):
        """LU of I + P D, and D rho."""
        inner = np.eye(len(self.P))
        right = np.zeros(len(self.P))
        for (white, coloured, _), first, at in zip(parts, self.first, self.place, strict=True):
            D = coloured + np.diag(white - first)
            inner[:, at] += self.P[:, at] @ D
            right[at] = D @ self.rho[at]
        return lu_factor(inner, check_finite=False, overwrite_a=True), right

    def solved(self, noise: GnssNoise, columns) -> np.ndarray:
        """D (I + P D)^-1 columns (n, k) of a noise."""
        parts = []
        for rows, f, axis in self.blocks:
            white, coloured = noise.parts(rows, f, axis)
            parts.append((np.diag(white), coloured, None))
        inner = lu_solve(self.factor(parts)[0], columns, check_finite=False)
        out = np.zeros_like(inner)
        for (white, coloured, _), first, at in zip(parts, self.first, self.place, strict=True):
            out[at] = coloured @ inner[at] + (white - first)[:, None] * inner[at]
        return out

    def value(self, x) -> float:
        """-2 log L at x."""
        factor, right = self.factor(list(self.parts(x)))
        away = x - self.centre
        v = lu_solve(factor, self.rho, check_finite=False)
        return _logdet(factor) - float(right @ v) + float(away @ self.precision @ away)

    def __call__(self, x):
        """-2 log L at x, and its gradient."""
        parts = list(self.parts(x))
        factor, right = self.factor(parts)
        logdet = _logdet(factor)
        V = lu_solve(factor, self.P, check_finite=False)
        v = lu_solve(factor, self.rho, check_finite=False)
        slope = np.zeros_like(x)
        for n, ((white, coloured, tau), at) in enumerate(zip(parts, self.place, strict=True)):
            inside = V[np.ix_(at, at)] - np.outer(v[at], v[at])
            slope[n] = 2.0 * np.sum(np.diag(inside) * white)
            weighted = inside * coloured
            slope[self.count + n] = 2.0 * weighted.sum()
            flight = self.flights.index(self.blocks[n][1])
            slope[2 * self.count + flight] += np.sum(weighted * self.lags[n]) / tau
        away = x - self.centre
        pull = self.precision @ away
        return logdet - float(right @ v) + float(away @ pull), slope + 2.0 * pull

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


def _logdet(factor) -> float:
    """Logarithm of the determinant of a matrix of which this is the LU factor."""
    return float(np.sum(np.log(np.abs(np.diag(factor[0])))))
