"""The noise of the GNSS that is most likely beside a model, by restricted maximum likelihood.

    -2 log L(x) = -2 log p(data | x, model) + (x - x0)' K (x - x0)

x: logarithms of w of each flight and axis, of c over the stated sigma of each, of tau of each
flight (see `gnss`); x0, K: what is known of receivers beforehand. The data are those of the whole
block, all flights and axes together, and all else follows: an error of one axis shows in the
others. With r the white residuals and u the slow states in units of their size,

    d / d log w   = 2 sum (1 - E r^2 / (w s)^2)
    d / d log c   = 2 (n - E u'Qu)
    d / d log tau = -d log |Q| + E u' dQ u

and steps are Newton's with the average information v' dS V dS v in place of the curvature.
Source: Patterson and Thompson 1971, "Recovery of inter-block information when block sizes are
unequal"; Louis 1982 (the gradient as a mean over the missing data); Gilmour, Thompson and Cullis
1995 (average information).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from corridor.diagnosis.noise.gnss import GnssNoise, precision_of
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination, Rows
from corridor.diagnosis.system.equations import Equations

# Change of log tau over which a derivative by it is a difference.
_STEP = 1e-4
# Twice the log likelihood that a step has to promise: what names an effect is eighty times that.
_WORTH = 0.1
# Share of what a step has promised below which a shorter one is tried; trials of one step.
_KEPT, _TRIALS = 0.5, 4
# Longest step: by a factor of four.
_FAR = np.log(4.0)
# Steps, after which the shape of the likelihood is a valley without a floor.
_MOST = 25

Bounds = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


class Arguments:
    """The noise of all flights and axes as one vector x, and what is known of it beforehand."""

    def __init__(self, noise: GnssNoise, bounds: Bounds | None = None):
        """bounds: least and most of w, c over the stated sigma and tau, where nothing else is
        known of them; default: the weak prior knowledge of the settings.
        """
        self.noise = noise
        self.blocks = [(noise.in_time(rows), f, axis) for rows, f, axis in noise.blocks()]
        self.flights = sorted({f for _, f, _ in self.blocks})
        self.count = count = len(self.blocks)
        self.stated = np.array(
            [np.sqrt(np.mean(noise.stated[rows] ** 2)) for rows, *_ in self.blocks]
        )
        many = [count, count, len(self.flights)]
        prior = SETTINGS.white_prior, SETTINGS.slow_prior, SETTINGS.time_constant_prior
        self.centre = np.repeat([np.log(p[0]) for p in prior], many)
        covariance = np.diag(np.repeat([p[2] ** 2 for p in prior], many))
        kind = np.repeat([0, 1, 2], many)
        covariance += (kind[:, None] == kind) * np.repeat([p[1] ** 2 for p in prior], many)
        self.precision = np.linalg.inv(covariance)
        factor, tau = SETTINGS.noise_factor_range, SETTINGS.time_constant_range
        ends = (factor, factor, tau) if bounds is None else bounds
        self.low, self.high = (np.repeat(np.log([e[k] for e in ends]), many) for k in (0, 1))
        if bounds is not None:
            self.precision = np.zeros_like(covariance)
            return
        two = slice(2 * count)
        size = np.maximum(noise.most[:, [axis for *_, axis in self.blocks]], 1e-9) / self.stated
        self.high[two] = np.clip(np.log(size).ravel(), self.low[two], self.high[two])

    def of(self, noise: GnssNoise) -> np.ndarray:
        """The arguments of a noise."""
        x = np.empty_like(self.centre)
        for n, (_, f, axis) in enumerate(self.blocks):
            x[n] = np.log(noise.white[f, axis])
            slow = noise.coloured[f, axis] / self.stated[n]
            x[self.count + n] = np.log(max(slow, SETTINGS.noise_factor_range[0]))
            x[2 * self.count + self.flights.index(f)] = np.log(noise.tau[f, axis])
        return x

    def noise_at(self, x: np.ndarray) -> GnssNoise:
        """The noise with these arguments."""
        noise = self.noise
        white, coloured, tau = noise.white.copy(), noise.coloured.copy(), noise.tau.copy()
        for n, (_, f, axis) in enumerate(self.blocks):
            white[f, axis] = np.exp(x[n])
            coloured[f, axis] = np.exp(x[self.count + n]) * self.stated[n]
            tau[f, axis] = np.exp(x[2 * self.count + self.flights.index(f)])
        return replace(noise, white=white, coloured=coloured, tau=tau)

    def far(self, x: np.ndarray) -> float:
        """How much less likely x is beforehand: twice the logarithm."""
        return float((x - self.centre) @ self.precision @ (x - self.centre))


@dataclass(frozen=True)
class Likely:
    """A noise and -2 log L there; x, curve: its arguments, and the information (n, n) on them."""

    noise: GnssNoise
    value: float
    x: np.ndarray
    curve: np.ndarray


def estimate(
    e: Equations, rows: Rows, arguments: Arguments, start: np.ndarray | None = None
) -> Likely:
    """The most likely noise beside groups of a model. start: arguments to begin from."""
    x = np.clip(arguments.centre if start is None else start, arguments.low, arguments.high)

    def at(x: np.ndarray) -> tuple[float, np.ndarray, Elimination]:
        made = Elimination(e, arguments.noise_at(x), rows)
        return value_of(made, arguments, x), x, made

    value, x, made = at(x)
    for _ in range(_MOST):
        slope, curve = derivatives(made, arguments, x)
        step = _step(x, slope, curve, arguments)
        promised = -(slope @ step + 0.5 * step @ curve @ step)
        if promised < _WORTH:
            break
        trials = [at(x + step)]
        while value - trials[-1][0] < _KEPT * promised and len(trials) < _TRIALS:
            # Where the parabola through value, slope and the trial has its lowest point.
            away = trials[-1][1] - x
            bent = trials[-1][0] - value - slope @ away
            share = float(np.clip(-0.5 * (slope @ away) / max(bent, 1e-12), 0.1, 0.7))
            trials.append(at(x + share * away))
            if trials[-2][0] < min(value, trials[-1][0]):
                break
        best = min(trials, key=lambda trial: trial[0])
        if not best[0] < value:
            break
        gained, (value, x, made) = value - best[0], best
        if gained < _WORTH:
            break
    return Likely(arguments.noise_at(x), value, x, curve)


def value_of(made: Elimination, arguments: Arguments, x: np.ndarray) -> float:
    """-2 log L of arguments whose noise an elimination has."""
    return -2.0 * made.log_probability + arguments.far(x)


def derivatives(
    made: Elimination, arguments: Arguments, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slope (n,) of -2 log L, and its average information (n, n)."""
    noise, count = made.noise, arguments.count
    white, square, pairs, _ = made.errors()
    slope = np.zeros_like(x)
    begin = 0
    v = made.weigh(made.antenna)
    moved = np.zeros((len(v), len(x)))
    for n, (rows, f, axis) in enumerate(arguments.blocks):
        many, at = len(rows), 2 * count + arguments.flights.index(f)
        size, tau, gaps = (
            noise.coloured[f, axis],
            noise.tau[f, axis],
            np.diff(noise.time[rows // 3]),
        )
        mine = slice(begin, begin + many)
        begin += many

        def mean(precision, mine=mine):
            both = pairs[mine][: len(precision[0]) - 1]
            return float(precision[1] @ square[mine] + 2.0 * precision[0, 1:] @ both)

        variance = (noise.white[f, axis] * noise.stated[rows]) ** 2
        slope[n] = 2.0 * float(np.sum(1.0 - white[rows] / variance))
        here, _ = precision_of(gaps, tau)
        slope[count + n] = 2.0 * (many - mean(here))
        (up, log_up), (down, log_down) = (
            precision_of(gaps, tau * np.exp(s)) for s in (_STEP, -_STEP)
        )
        slope[at] += (mean(up) - log_up - mean(down) + log_down) / (2.0 * _STEP)
        moved[rows, n] = 2.0 * variance * v[rows]
        moved[rows, count + n] = 2.0 * size**2 * solveh_banded(here, v[rows])
        change = solveh_banded(up, v[rows]) - solveh_banded(down, v[rows])
        moved[rows, at] += size**2 * change / (2.0 * _STEP)
    curve = moved.T @ made.weight(moved)
    curve = 0.5 * (curve + curve.T)
    return slope + 2.0 * arguments.precision @ (x - arguments.centre), (
        curve + 2.0 * arguments.precision
    )


def _step(x, slope, curve, arguments: Arguments) -> np.ndarray:
    """Newton's step (n,) within the bounds; what a bound holds stays."""
    step = np.zeros_like(x)
    held = ((x <= arguments.low) & (slope > 0)) | ((x >= arguments.high) & (slope < 0))
    for _ in range(len(x)):
        free = np.flatnonzero(~held)
        if not len(free):
            break
        inside = curve[np.ix_(free, free)]
        little = 1e-3 * np.diag(np.maximum(inside.diagonal(), 1.0))
        fixed = step.copy()
        fixed[free] = 0.0
        step[free] = -np.linalg.solve(inside + little, slope[free] + curve[free] @ fixed)
        step = np.clip(step, -_FAR, _FAR)
        bounded = np.clip(x + step, arguments.low, arguments.high) - x
        beyond = (bounded != step) & ~held
        step = bounded
        if not beyond.any():
            break
        held |= beyond
    return step
