"""Errors of measurement: how large, how heavy their tails, how long they remember."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what is measured.

    tie_px, mark_px: px an axis. spread: of the logarithm of each tie observation's own sigma.
    nu: degrees of freedom of Student's t, 0 for the normal distribution. gross: share of tie
    observations that are wrong matches. gnss_white_m, gnss_coloured_m: (3,) m, gnss_tau_s:
    correlation time. control_m: (3,) m of surveyed points, control and check.
    velocity: m/s an axis; gyro_deg_s: degrees/s an axis.
    """

    tie_px: float = 0.3
    spread: float = 0.0
    nu: float = 0.0
    gross: float = 0.0
    mark_px: float = 0.3
    gnss_white_m: tuple[float, float, float] = (0.008, 0.008, 0.016)
    gnss_coloured_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gnss_tau_s: float = 60.0
    control_m: tuple[float, float, float] = (0.002, 0.002, 0.003)
    velocity: float = 0.01
    gyro_deg_s: float = 0.005


NONE = Noise(0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * 3, (0.0,) * 3, 60.0, (0.0,) * 3, 0.0, 0.0)
_COLOURED = {"gnss_white_m": (0.005, 0.005, 0.010), "gnss_coloured_m": (0.008, 0.008, 0.016)}
NOISES = {
    "none": NONE,
    "clean": Noise(),
    "outliers": Noise(gross=0.05),
    "heavy_tails": Noise(nu=3.0, spread=0.4),
    "coarse": Noise(tie_px=0.5, mark_px=0.5),
    "coloured_gnss": Noise(**_COLOURED),
    "everyday": Noise(spread=0.3, nu=5.0, gross=0.005, **_COLOURED),
}


def of_ties(count, noise, rng):
    """Errors (n, 2), px, which (n,) are wrong matches, and the sigma (n,) of each, px."""
    sigma = noise.tie_px * np.exp(noise.spread * rng.standard_normal(count) - noise.spread**2)
    error = rng.standard_normal((count, 2))
    tail = rng.chisquare(noise.nu or 1.0, count)
    if noise.nu:
        # One tail for both axes: a bad match is bad in x and in y. Of variance one where nu > 2.
        size = np.sqrt((noise.nu - 2) / noise.nu) if noise.nu > 2 else 1.0
        error *= size * np.sqrt(noise.nu / tail)[:, None]
    error *= sigma[:, None]
    wrong = rng.random(count) < noise.gross
    far = rng.uniform(3, 30, count)
    way = rng.uniform(0, 2 * np.pi, count)
    error[wrong] += (far[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1))[wrong]
    return error, wrong, sigma


def of_gnss(time, group, noise, rng):
    """Errors (n, 3), m, at times (n,) s: white, and exponentially correlated within a group."""
    white = rng.standard_normal((len(time), 3)) * noise.gnss_white_m
    shock = rng.standard_normal((len(time), 3))
    memory = np.zeros((len(time), 3))
    for k in np.unique(group):
        rows = np.flatnonzero(group == k)
        rows = rows[np.argsort(time[rows])]
        keep = np.exp(-np.diff(time[rows]) / noise.gnss_tau_s)
        memory[rows[0]] = shock[rows[0]]
        for n in range(1, len(rows)):
            memory[rows[n]] = (
                keep[n - 1] * memory[rows[n - 1]] + np.sqrt(1 - keep[n - 1] ** 2) * shock[rows[n]]
            )
    return white + memory * noise.gnss_coloured_m
