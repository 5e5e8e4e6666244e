"""A drone's track made up on the spot, so that a chapter on GNSS runs for everybody."""

from __future__ import annotations

import numpy as np
import pandas as pd

RATE_HZ = 5
_SIGMA = (0.0084, 0.0055, 0.0096)  # m: mean of Zhou 2019, section 5.6.2


def simulated_track(
    seed: int = 0, speed: float = 1.8, strips: int = 3, straight_s: float = 60.0
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Where the antenna truly was, five times a second, and what the receiver says of it.

    speed: that of the thesis's flight s1, 395 pictures every 2.5 s over 1.8 km (section 5.5).
    Straight strips, half circles of 12 s between them, gusts of 0.4 m/s with a memory of 3 s; half
    of the receiver's variance is slow (120 s). Both tables: time_s, x, y, z (m); the second sx,
    sy, sz as well.
    """
    draw = np.random.default_rng([seed, 11])
    step = 1 / RATE_HZ
    turn = np.pi / 12.0
    rates = []
    for strip in range(strips):
        rates += [0.0] * int(straight_s * RATE_HZ)
        if strip < strips - 1:
            rates += [turn * (-1) ** strip] * int(12 * RATE_HZ)
    heading = np.cumsum(rates) * step + np.pi / 2
    count = len(heading)
    gust = _remembering(draw, (count, 3), 3.0, step) * [0.4, 0.4, 0.2]
    velocity = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), np.zeros(count)])
    place = np.cumsum((velocity + gust) * step, axis=0) + [0, 0, 50]
    time = step * np.arange(count)
    white = draw.standard_normal((count, 3))
    noise = np.sqrt(0.5) * (white + _remembering(draw, (count, 3), 120.0, step)) * _SIGMA
    truth = pd.DataFrame({"time_s": time, **dict(zip("xyz", place.T, strict=True))})
    told = pd.DataFrame({"time_s": time, **dict(zip("xyz", (place + noise).T, strict=True))})
    return truth, told.assign(**dict(zip(("sx", "sy", "sz"), _SIGMA, strict=True)))


def _remembering(draw, shape, seconds, step):
    """Noise of unit variance with an exponential memory."""
    keep = np.exp(-step / seconds)
    values = draw.standard_normal(shape)
    for k in range(1, shape[0]):
        values[k] = keep * values[k - 1] + np.sqrt(1 - keep**2) * values[k]
    return values
