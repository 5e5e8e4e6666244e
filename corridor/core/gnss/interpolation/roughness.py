"""What epochs show by themselves of how far a drone strays between them.

A smoother of accelerations takes motion that is too fast for its epochs for a rough but continuous
flight, which would stray little in half a step. How second differences grow with their lag tells:
of smooth motion with its third power, of motion faster than the epochs not at all.

Source: Matheron 1973, The intrinsic random functions (generalized covariances |t|^a, and the
variances of what has weights that no straight line passes).
"""

import numpy as np

from corridor.core.geometry import OUTLIER, robust_scale

# Weights by which the middle is interpolated, of epochs at these steps from it: linear, cubic.
_BETWEEN = (
    (np.array([-0.5, 0.5]), np.array([0.5, 0.5])),
    (np.array([-1.5, -0.5, 0.5, 1.5]), np.array([-1.0, 9.0, 9.0, -1.0]) / 16),
)
# Second differences (1, -2, 1) of white noise have six times its variance.
_OF_NOISE = 6.0
# Exponents of growth: from none to that of a random acceleration; at 2 the form degenerates.
_SMOOTHEST, _APART = 3.0, 0.05
# So many second differences are needed; and steps that are alike within this share.
_FEWEST, _ALIKE = 20, 0.05
# Lags, s, at which motion of a drone no longer hangs together, and slow noise does; lags, epochs,
# of motion; how many sigmas it is above none: by chance the largest of all lags and frequencies
# is once in seven times, which costs less than motion missed. Frequencies where it may have ended.
_FAR_S, _NEAR, _SURE = (2.0, 3.0, 4.0), range(1, 7), 2.0
_UPPER_HALF = np.pi * np.linspace(0.5, 1, 13)
# Twice the standard deviation of a robust variance of n numbers that hang together by threes.
CHANCE = 2 * np.sqrt(2 * 3 / 0.37)


def between(time: np.ndarray, position: np.ndarray, sigma: float) -> float:
    """Standard deviation, m, of a position in the middle between epochs, noise included.

    time (n,) s; position (n, k) m, of axes alike; sigma: of the noise of one epoch, m. 0 where
    the epochs show nothing beyond their noise, or are too few or too irregular to tell.
    """
    interval = float(np.median(np.diff(time)))
    grown = [_second_differences(time, position, interval, lag) for lag in (1, 2)]
    if min(map(len, grown)) < _FEWEST:
        return 0.0
    one, two = (float(robust_scale(part)) ** 2 for part in grown)
    noise = _OF_NOISE * sigma**2
    if one < noise * (1 + CHANCE / np.sqrt(grown[0].size)):
        return 0.0
    power = np.clip(np.log2(max(two - noise, one - noise) / (one - noise)), 0.0, _SMOOTHEST)
    if abs(power - 2) < _APART:
        power = 2 + np.copysign(_APART, power - 2)
    # Of second differences at a lag of one step, by the generalized covariance -+ |t|^power.
    density = (one - noise) / abs(_variance(np.array([-1.0, 0, 1]), np.array([1.0, -2, 1]), power))
    return min(
        float(
            np.sqrt(
                density * abs(_variance(np.append(at, 0.0), np.append(weight, -1.0), power))
                + sigma**2 * np.sum(weight**2)
            )
        )
        for at, weight in _BETWEEN
    )


def left_over(
    time: np.ndarray, residual: np.ndarray, noise: np.ndarray, passed: np.ndarray
) -> float:
    """Standard deviation, m, of motion that a smoother took for noise, beyond that in its sigmas.

    time (n,) s; residual (n, k) m, of axes alike; noise (n, k) m: white noise of the epochs, drawn;
    passed (n, k) m: what the same smoother makes of it. 0 where residuals show nothing.
    Residuals are white noise and motion that are not passed, and slow noise, which hangs together
    over seconds. Of that motion the covariances from epoch to epoch are what those of residuals
    are above those of noise, and the variance is the least that leaves its spectrum no negative
    part, so that the rest is as much white noise as can be.
    Source: Pisarenko 1973 (white noise of a covariance function); Hutchinson 1990 (by draws).
    """
    interval = float(np.median(np.diff(time)))
    far = [max(round(lag / interval), _NEAR[-1] + 1) for lag in _FAR_S]
    if len(time) < 3 * far[-1]:
        return 0.0
    most = OUTLIER * robust_scale(residual)
    residual = np.clip(residual, -most, most)
    # Of residuals, of noise with what is passed, of what is passed.
    pairs = (residual, residual), (noise, passed), (passed, passed)
    own, with_noise, alone = (
        np.array([_product(time, *pair, lag, interval) for lag in (*_NEAR, *far)]) for pair in pairs
    )
    slow = max(float((own + with_noise)[len(_NEAR) :].mean()), 0.0)
    motion = (own + 2 * with_noise - alone)[: len(_NEAR)] - slow
    held = float(np.mean(passed * (noise - passed)))
    # Epochs on a line leave no residuals: 1 nm at least.
    one_sigma = max(float(np.mean(residual**2)), 1e-18) / np.sqrt(residual.size)
    best, found = _SURE, 0.0
    for many in _NEAR:
        # Weights of Bartlett 1950: what is cut off makes no part of a spectrum negative.
        lag = np.arange(1, many + 1)
        waves = 2 * np.cos(np.outer(_UPPER_HALF, lag)) * (1 - lag / (many + 1))
        more = -waves @ motion[:many] - held
        sure = more / (one_sigma * np.linalg.norm(waves, axis=1))
        if sure.max() > best:
            best, found = float(sure.max()), float(more[np.argmax(sure)])
    return float(np.sqrt(found))


def _product(time, one, other, lag, interval) -> float:
    """Mean product of two series so many epochs apart, one before the other and after it alike."""
    even = np.abs(time[lag:] - time[:-lag] - lag * interval) < _ALIKE * interval
    if even.sum() < _FEWEST:
        return 0.0
    products = one[:-lag][even] * other[lag:][even] + one[lag:][even] * other[:-lag][even]
    return float(products.mean()) / 2


def _second_differences(time, position, interval, lag):
    """(m, k) of epochs at even steps of lag times the interval."""
    step = np.abs(time[2 * lag :] - time[lag:-lag] - lag * interval)
    step = np.maximum(step, np.abs(time[lag:-lag] - time[: -2 * lag] - lag * interval))
    found = position[2 * lag :] - 2 * position[lag:-lag] + position[: -2 * lag]
    return found[step < _ALIKE * interval]


def _variance(at, weight, power):
    """Of a weighted sum of values at steps, in densities of the generalized covariance."""
    apart = np.abs(np.subtract.outer(at, at))
    return (
        weight @ np.where(apart > 0, apart, 1e-300) ** power @ weight
        if power
        else float(weight @ (apart > 0) @ weight)
    )
