"""The noise that a block's residuals speak of: how large, how heavy its tails, how slow.

Residuals are smaller than the noise, because poses and points follow it. What they lost is known
from the adjustment itself: for GNSS from the equations, for everything else by trying noise until
the residuals it leaves behind are those that were found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import minimize

from corridor.adjustment import LinearSystem
from corridor.effects import Context, every_effect
from corridor.geometry import CLIPPED, robust_scale, robust_scale_of_lengths
from corridor.gnss import SlowNoise

# Probabilities at which the length of the tie noise is known: dense where tails begin.
GRID = np.concatenate([np.linspace(0.0, 0.98, 99), 1 - np.geomspace(0.018, 1e-6, 30)])
# Epochs from which on slow noise can be told from white.
ENOUGH_EPOCHS = 12
# Gain in log likelihood from which on slow noise is believed: a chance of one in seven.
CLEARLY = 2.0
# Weight, in degrees of freedom, of a stated standard deviation where few residuals tell.
TRUST = 20.0


@dataclass(frozen=True)
class Gauss:
    """Noise of one flight and axis of the antenna, in stated standard deviations.

    white and slow: standard deviations; slow noise is exponentially correlated with the time
    constant constant_s (seconds; epochs where the block has no times).
    """

    white: float
    slow: float = 0.0
    constant_s: float = 1.0


@dataclass(frozen=True)
class EstimatedNoise:
    """Noise of everything that is measured, in units of the stated standard deviations.

    tie: (len(GRID),) length of a tie point's error at the probabilities GRID (a Gaussian one has
    the lengths of Rayleigh). mark, control: factors. gnss: by flight number and axis.
    """

    tie: np.ndarray
    mark: float = 1.0
    control: float = 1.0
    gnss: dict[tuple[int, int], Gauss] = field(default_factory=dict)

    @property
    def tie_sigma(self) -> float:
        """Robust standard deviation of a tie coordinate in stated ones: from the median length."""
        return robust_scale_of_lengths(np.interp(0.5, GRID, self.tie))

    def changed(self, **values) -> EstimatedNoise:
        """The same noise but for these."""
        return replace(self, **values)

    def draw_tie(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Errors (count, 2) in stated standard deviations, in any direction."""
        length = np.interp(rng.random(count), GRID, self.tie)
        angle = rng.uniform(0.0, 2 * np.pi, count)
        return length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])

    def draw_gnss(self, series: list[Series], count: int, rng: np.random.Generator) -> np.ndarray:
        """Errors (count, 3) of the antenna positions in stated standard deviations."""
        out = rng.standard_normal((count, 3))
        for one in series:
            for axis in range(3):
                kind = self.gnss.get((one.flight, axis), Gauss(1.0))
                out[one.rows, axis] *= kind.white
                if kind.slow > 0:
                    out[one.rows, axis] += (
                        kind.slow * SlowNoise(kind.constant_s).draw(one.time, rng)[:, 0]
                    )
        return out


@dataclass(frozen=True)
class Series:
    """The antenna positions of one flight in the order of time: rows and times, s or epochs."""

    flight: int
    rows: np.ndarray
    time: np.ndarray


def series_of(system: LinearSystem) -> list[Series]:
    """Antenna positions by flight, in the order of time (of images.csv where there is none)."""
    image, images = system.gnss.image, system.images
    out = []
    for flight in np.unique(images.flight[image]):
        rows = np.flatnonzero(images.flight[image] == flight)
        time = images.time[image[rows]]
        if np.isnan(time).any():
            rows = rows[np.argsort(system.image_order[image[rows]])]
            time = np.arange(len(rows), dtype=float)
        else:
            sort = np.argsort(time, kind="stable")
            rows, time = rows[sort], time[sort]
        out.append(Series(int(flight), rows, time))
    return out


def lengths(residual: np.ndarray) -> np.ndarray:
    """Lengths of residuals (n, 2), in standard deviations, at the probabilities GRID."""
    return np.quantile(np.hypot(*residual.T), GRID)


def mended(noise: EstimatedNoise, found: np.ndarray, left: np.ndarray) -> EstimatedNoise:
    """Tie noise nearer the truth, when it left behind lengths `left` in place of `found`."""
    ratio = np.clip(found / np.maximum(left, 1e-12), 0.5, 2.0)
    # One draw's tail is a few observations: what they say is averaged along the tail.
    tail = GRID > 0.98
    smooth = np.convolve(np.pad(ratio, 3, mode="edge"), np.full(7, 1 / 7), mode="valid")
    ratio = np.where(tail, smooth, ratio)
    return noise.changed(tie=np.maximum.accumulate(noise.tie * ratio))


def gnss_noise(system: LinearSystem, residual: np.ndarray, tie_sigma: float) -> dict:
    """White and slow noise of the antenna by flight and axis, by restricted maximum likelihood.

    system: where the residual (k, 3), m, was found. tie_sigma: of a tie coordinate in stated
    ones. With G the covariance that the adjustment gives the predicted antenna and W the weights,
    the residual is (1 - G W) noise + what the others' noise does, of covariance G - G W G.
    What any antenna effect of the catalogue could do is projected out, for noise is what is left
    when each of them had its way: a drift must not count as slow noise.
    Source: Patterson and Thompson 1971 (restricted likelihood).
    """
    found = {}
    signals = _signals(system)
    sigmas = system.gnss.sigma
    for one in series_of(system):
        for axis in range(3):
            sigma = sigmas[one.rows, axis]
            # In stated standard deviations, so that good and bad epochs weigh as they should.
            v = residual[one.rows, axis] / sigma
            usual = robust_scale(v, centred=True, least=1e-9)
            v = np.clip(v, -CLIPPED * usual, CLIPPED * usual)
            # Covariance of the predicted antenna, unit weight.
            rows = system.gnss.jacobian[3 * one.rows + axis].toarray()
            g = rows @ system.solve(rows.T) / sigma[:, None] / sigma
            found[one.flight, axis] = _fit(
                v, g, signals[one.rows, axis] / sigma[:, None], one.time, tie_sigma
            )
    return found


def _signals(system: LinearSystem) -> np.ndarray:
    """Derivatives (k, 3, columns) of the antenna by every physical effect that a block shares."""
    block, image = system.block, system.gnss.image
    context = Context(system.images, image)
    parts = [np.tile(np.eye(3), (len(image), 1, 1))]
    for effect in every_effect():
        if effect.place != "antenna" or effect.generic or effect.group == "image":
            continue
        if effect.missing(block):
            continue
        values = np.zeros((len(image), len(effect.parameters(block))))
        derivative = effect.shift(context, values)[1]
        if np.isfinite(derivative).all():
            parts.append(derivative)
    return np.concatenate(parts, axis=2)


def _fit(v, g, signals, time, tie_sigma) -> Gauss:
    k = len(v)
    rest = np.eye(k) - g
    others = tie_sigma**2 * (g - g @ g)
    # What signals and the free lever arm leave of the residuals.
    u, s, _ = np.linalg.svd(rest @ signals, full_matrices=True)
    rank = int(np.sum(s > 1e-6 * max(s[0], 1e-12))) if len(s) else 0
    kept = u[:, rank:]
    value, vector = np.linalg.eigh(kept.T @ rest @ rest.T @ kept)
    kept = kept @ vector[:, value > 1e-6]
    w = kept.T @ v
    if kept.shape[1] < ENOUGH_EPOCHS:
        # Too few to estimate anything from alone: what is stated counts too.
        free = float(np.trace(kept.T @ rest @ rest.T @ kept))
        return Gauss(float(np.sqrt((TRUST + w @ w) / (TRUST + free))))
    left, floor = kept.T @ rest, kept.T @ others @ kept
    white = left @ left.T
    away = np.abs(time[:, None] - time)
    step = float(np.median(np.diff(time)))
    step = step if step > 0 else 1.0

    def cost(x):
        a, b, constant = np.exp(x)
        c = a**2 * white + b**2 * (left @ SlowNoise(constant).memory(away) @ left.T) + floor
        c[np.diag_indices_from(c)] += 1e-9
        try:
            factor = np.linalg.cholesky(c)
        except np.linalg.LinAlgError:
            return 1e12
        half = np.linalg.solve(factor, w)
        return float(np.log(np.diag(factor)).sum() + 0.5 * half @ half)

    size = float(np.sqrt(np.mean(w**2) / max(np.mean(np.diag(white)), 1e-9))) or 1.0
    low, high = np.log(2 * step), np.log(max(0.5 * float(np.ptp(time)), 3 * step))
    bounds = [(np.log(1e-3 * size), np.log(10 * size))] * 2 + [(low, high)]
    starts = [np.log([0.8 * size, 0.4 * size, f * step]) for f in (4.0, 20.0)]
    tried = [
        minimize(cost, np.clip(x, *np.array(bounds).T), method="L-BFGS-B", bounds=bounds,
                 options={"maxiter": 30})
        for x in starts
    ]  # fmt: skip
    best = min(tried, key=lambda t: t.fun)
    a, b, constant = np.exp(best.x)
    plain = minimize(
        lambda x: cost(np.array([x[0], np.log(1e-3 * size), low])), [np.log(size)],
        method="L-BFGS-B", bounds=bounds[:1], options={"maxiter": 30},
    )  # fmt: skip
    if plain.fun - best.fun < CLEARLY:
        # Slow noise that is not there would make the bands wide where drifts would show.
        return Gauss(float(np.exp(plain.x[0])))
    return Gauss(float(a), float(b), float(constant))
