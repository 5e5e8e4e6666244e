"""When photographs were taken, where their time stamps are rounded."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, diags_array, eye_array

# An interval so many times the usual one is a pause, which is no part of any rhythm.
_PAUSE = 3.0
# What it costs to leave a stamp, beside what it costs to change the interval: settles ties only.
_STAY = 0.01


def unrounded(stamps: np.ndarray, step: float) -> np.ndarray:
    """Times (n,) s within half a rounding step of sorted stamps, as regular as they can be.

    A timer, or a steady flight past even distances, makes even intervals: of all times that
    stamps of `step` seconds allow, these change their interval least, by the sum of amounts, but
    for pauses. A constant offset stays: whether a camera rounds or cuts off is unknown. The stamps
    themselves where there are fewer than three.
    """
    stamps = np.asarray(stamps, dtype=float)
    count = len(stamps)
    if count < 3:
        return stamps
    interval = np.diff(stamps)
    usual = max(float(np.mean(interval[interval <= _PAUSE * np.median(interval) + step])), 0.1)
    pause = interval > _PAUSE * usual + step
    weight = np.where(pause[1:] | pause[:-1], 0.0, 1.0)
    since = stamps - stamps[0]
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    order = diags_array([1.0, -1.0], offsets=[0, 1], shape=(count - 1, count))
    one, other = eye_array(count - 2), eye_array(count)
    # |bend t| and |t - stamp| are below what is to become small; times stand in order.
    rows = block_array(
        [
            [bend, -one, None], [-bend, -one, None],
            [other, None, -other], [-other, None, -other],
            [order, None, None],
        ]
    )  # fmt: skip
    most = np.concatenate(
        [np.zeros(2 * (count - 2)), since, -since, np.full(count - 1, -0.05 * step)]
    )
    cost = np.concatenate([np.zeros(count), weight, np.full(count, _STAY)])
    bounds = [(t - step / 2, t + step / 2) for t in since] + [(0, None)] * (2 * count - 2)
    found = linprog(cost, A_ub=rows.tocsc(), b_ub=most, bounds=bounds, method="highs")
    return found.x[:count] + stamps[0] if found.success else stamps
