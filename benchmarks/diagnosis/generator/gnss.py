"""The receiver: one position a second, and what somebody made of them."""

import numpy as np
import pandas as pd

from .world import antenna

GAP_S = 6.0


def epochs(scene, gaps, rng):
    """Times (n,) s and flights (n,) of the receiver's epochs, losses of the fix left out."""
    spans = scene.trajectory.span
    time = np.concatenate([np.arange(a, b + 0.5) for a, b in spans])
    flight = np.concatenate([np.full(int(b - a) + 1, k) for k, (a, b) in enumerate(spans)])
    lost = np.zeros(len(time), dtype=bool)
    for moment in rng.choice(scene.trajectory.exposure, gaps, replace=False):
        lost |= np.abs(time - moment) < GAP_S / 2
    return time[~lost], flight[~lost]


def track(scene, world, time, flight, error, stated):
    """track.csv; error: (n, 3) m; stated: (3,) standard deviations, m."""
    position = antenna(scene, world, time, flight) + error
    names = np.array(scene.flights)[flight]
    return pd.DataFrame(
        {
            "time_s": time, **dict(zip("xyz", position.T, strict=True)), "flight": names,
            **dict(zip(("sx", "sy", "sz"), stated, strict=True)), "quality": 1,
        }
    )  # fmt: skip


def between(time, value, group, when, which):
    """Values (m, 3) at moments (m,) by the cubic through four epochs (n,), NaN across a gap.

    Newton's divided differences; group, which: flights of the epochs and the moments.
    """
    out = np.full((len(when), 3), np.nan)
    for k in np.unique(group):
        rows, mine = np.flatnonzero(group == k), np.flatnonzero(which == k)
        t, v = time[rows], value[rows]
        first = np.clip(np.searchsorted(t, when[mine]) - 2, 0, len(t) - 4)
        a = t[first[:, None] + np.arange(4)]
        c = v[first[:, None] + np.arange(4)].copy()
        for level in range(1, 4):
            span = (a[:, level:] - a[:, :-level])[:, :, None]
            c[:, level:] = (c[:, level:] - c[:, level - 1 : -1]) / span
        found = c[:, 3]
        for level in (2, 1, 0):
            found = c[:, level] + (when[mine] - a[:, level])[:, None] * found
        found[(np.diff(a, axis=1) > 1.5).any(axis=1)] = np.nan
        out[mine] = found
    return out
