"""The noise that a block's residuals speak of: how large, how heavy its tails, how slow.

Residuals are smaller than the noise, because poses and points follow it. What they lost is known
from the adjustment itself: for GNSS from the equations, for everything else by trying noise until
the residuals it leaves behind are those that were found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from corridor.adjustment import LinearSystem
from corridor.diagnosis.gnss_noise import (
    GnssNoise,
    Likelihood,
    Weight,
    in_pieces,
    stated_noise,
)
from corridor.effects import Context, every_effect
from corridor.geometry import CLIPPED, robust_scale, robust_scale_of_lengths

# Probabilities at which the length of the tie noise is known: dense where tails begin.
GRID = np.concatenate([np.linspace(0.0, 0.98, 99), 1 - np.geomspace(0.018, 1e-6, 30)])
# Epochs from which on slow noise can be told from white.
ENOUGH_EPOCHS = 12
# Gain in log likelihood from which on slow noise is believed: a chance of one in seven.
CLEARLY = 2.0
# Weight, in degrees of freedom, of a stated standard deviation where few residuals tell.
TRUST = 20.0


@dataclass(frozen=True)
class EstimatedNoise:
    """Noise of everything that is measured, in units of the stated standard deviations.

    tie: (len(GRID),) length of a tie point's error at the probabilities GRID (a Gaussian one has
    the lengths of Rayleigh). mark, control: factors. gnss: of the antenna; None without.
    """

    tie: np.ndarray
    mark: float = 1.0
    control: float = 1.0
    gnss: GnssNoise | None = None

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


def antenna_noise(system: LinearSystem, tie_sigma: float) -> GnssNoise | None:
    """White and slow noise of the antenna by flight and axis, by restricted maximum likelihood.

    system: at a fit. tie_sigma: of a tie coordinate in stated ones. What any antenna effect of the
    catalogue could do is projected out, for noise is what is left when each of them had its way: a
    drift must not count as slow noise. Nothing is known of the noise beforehand; it is white where
    the data do not speak for more.
    Source: Patterson and Thompson 1971 (restricted likelihood).
    """
    rows = system.image_rows
    sigma = np.where(rows.tie, tie_sigma * rows.sigma, rows.sigma)
    loss = system.loss._replace(width=system.loss.width / tie_sigma)
    system = replace(system.measuring(sigma=sigma), loss=loss)
    noise, signals = stated_noise(system), _signals(system)
    gnss = system.gnss
    left = gnss.residual.ravel() - gnss.jacobian @ system.solve(system.right[:, None])[:, 0]
    for block in noise.blocks():
        at = block[0]
        stated = gnss.sigma.ravel()[at]
        v = left[at] / stated
        usual = robust_scale(v, centred=True, least=1e-9)
        rho = np.clip(v, -CLIPPED * usual, CLIPPED * usual) / stated
        jacobian, weight = gnss.jacobian[at], (stated**-2.0)[:, None]
        heavy = weight * signals[at]
        moved = heavy - weight * (jacobian @ system.solve(jacobian.T @ heavy))
        inverse = np.linalg.pinv(signals[at].T @ moved, rcond=1e-10, hermitian=True)
        P = _weight(system, at).less(moved @ inverse, moved.T)
        rho = rho - moved @ inverse @ (signals[at].T @ rho)
        noise = _of_block(noise, P, rho, block)
    return noise


def _weight(system: LinearSystem, at: np.ndarray) -> Weight:
    """P of some antenna coordinates (n,) after all that the system estimates."""
    gnss, made = system.gnss, {}

    def part(rows: np.ndarray) -> np.ndarray:
        key = rows.tobytes()
        if key not in made:
            stated = gnss.sigma.ravel()[at[rows]]
            jacobian = gnss.jacobian[at[rows]].toarray()
            predicted = jacobian @ system.solve(jacobian.T) / stated[:, None] / stated
            made[key] = (np.eye(len(rows)) - predicted) / stated[:, None] / stated
        return made[key]

    return Weight(part, np.arange(len(at)))


def _of_block(noise: GnssNoise, P: Weight, rho: np.ndarray, block: tuple) -> GnssNoise:
    """The noise with that of one flight and axis, of which P and rho are left."""
    rows, flight, axis = block
    stated, time = noise.stated[rows], np.sort(noise.time[rows // 3])
    parts = in_pieces(noise.time[rows // 3])
    free = float(sum(P.part(at).toarray().diagonal() @ stated[at] ** 2 for at in parts))
    square = float(rho @ (stated**2 * rho))
    white = noise.white.copy()
    if free < ENOUGH_EPOCHS:
        # Too few to estimate anything from alone: what is stated counts too.
        white[flight, axis] = np.sqrt((TRUST + square) / (TRUST + free))
        return replace(noise, white=white)
    size = np.sqrt(square / free) or 1.0
    step = float(np.median(np.diff(time))) or 1.0
    factor = 1e-3 * size, 10 * size
    bounds = factor, factor, (2 * step, max(0.5 * float(np.ptp(time)), 3 * step))
    likelihood = Likelihood(noise, P, rho, [block], own=True, bounds=bounds)
    starts = [np.log([0.8 * size, 0.4 * size, many * step]) for many in (4.0, 20.0)]
    best = min((likelihood.minimum(x) for x in starts), key=lambda found: found.fun)
    none = likelihood.low[1:]
    most = np.array([likelihood.high[0], *none])
    alone = likelihood.minimum(np.array([np.log(size), *none]), high=most)
    if alone.fun - best.fun < 2 * CLEARLY:
        # Slow noise that is not there would make the bands wide where drifts would show.
        white[flight, axis] = np.exp(alone.x[0])
        return replace(noise, white=white)
    return likelihood.noise_at(best.x, noise)


def _signals(system: LinearSystem) -> np.ndarray:
    """Derivatives (3k, columns) of the antenna by every physical effect that a block shares."""
    block = system.block
    context = Context(system.images, system.gnss.image)
    parts = [np.tile(np.eye(3), (len(context), 1, 1))]
    for effect in every_effect():
        if effect.place != "antenna" or effect.generic or effect.group == "image":
            continue
        if effect.missing(block):
            continue
        values = np.zeros((len(context), len(effect.parameters(block))))
        derivative = effect.shift(context, values)[1]
        if np.isfinite(derivative).all():
            parts.append(derivative)
    return np.concatenate(parts, axis=2).reshape(3 * len(context), -1)
