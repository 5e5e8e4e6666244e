"""How the antenna moves between two epochs.

Each axis has position, velocity and acceleration. Two white noises drive it: gusts shake the
velocity (a random acceleration, the constant-velocity model of the textbooks), and the autopilot
changes the acceleration (a random jerk). Gusts blow all along the flight with one density; the
jerk's density goes up and down with what the drone does (see `regimes`). A fourth state, where it
is asked for, is the slow error of the satellite positions: a first-order Gauss-Markov process of
unit variance.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
2001, sections 6.2.2 and 6.2.3 (discretised continuous white noise acceleration and jerk).
"""

from typing import NamedTuple

import numpy as np

from corridor.core.gnss.slow_noise import SlowNoise

MOTION = 3  # position, velocity, acceleration


class Steps(NamedTuple):
    """Matrices of every different step of time, and which of them leads to each row."""

    which: np.ndarray  # (n,) int64
    F: np.ndarray  # (u, d, d) transition
    gust: np.ndarray  # (u, d, d) covariance a unit of acceleration density, m^2/s^3
    jerk: np.ndarray  # (u, d, d) covariance a unit of jerk density, m^2/s^5


def steps(times: np.ndarray, correlation_s: float | None) -> Steps:
    """Exact discretisation of the continuous model, from each of `times` (n,) to the next.

    times: seconds, not decreasing; the step to the first row is zero.
    correlation_s: time constant of the slow error, s; None: no such state (d = 3, else 4).
    """
    # A nanosecond at 100 m/s is a tenth of a micrometre; rounding makes equal steps equal.
    step, which = np.unique(np.round(np.diff(times, prepend=times[:1]), 9), return_inverse=True)
    d = MOTION + (correlation_s is not None)
    F, gust, jerk = (np.zeros((len(step), d, d)) for _ in range(3))
    h = step
    F[:, range(d), range(d)] = 1
    F[:, 0, 1] = F[:, 1, 2] = h
    F[:, 0, 2] = h**2 / 2
    gust[:, 0, 0] = h**3 / 3
    gust[:, 0, 1] = gust[:, 1, 0] = h**2 / 2
    gust[:, 1, 1] = h
    jerk[:, 0, 0] = h**5 / 20
    jerk[:, 0, 1] = jerk[:, 1, 0] = h**4 / 8
    jerk[:, 0, 2] = jerk[:, 2, 0] = h**3 / 6
    jerk[:, 1, 1] = h**3 / 3
    jerk[:, 1, 2] = jerk[:, 2, 1] = h**2 / 2
    jerk[:, 2, 2] = h
    if correlation_s is not None:
        F[:, MOTION, MOTION] = SlowNoise(correlation_s).memory(h)
    return Steps(which.reshape(-1).astype(np.int64), F, gust, jerk)


def before_the_flight(d: int) -> np.ndarray:
    """Covariance (d, d) of the state before the first epoch, position relative to that epoch.

    Wide for any drone: 100 m, 50 m/s, 10 m/s^2; the slow error has its unit variance.
    """
    return np.diag([100.0**2, 50.0**2, 10.0**2, 1.0][:d])
