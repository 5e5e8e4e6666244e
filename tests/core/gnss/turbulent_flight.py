"""A corridor flight with gusts, known at every moment: strips, turns, a drone that is shaken.

The motion is continuous: the autopilot's velocity changes with bounded jerk, the gusts are two
first-order lags behind white noise, as the air and the mass of a drone make them.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

STEP = 0.01
SIGMA = np.array([0.007, 0.007, 0.0098])  # 13.9 mm in 3D


@dataclass(frozen=True)
class Flight:
    """position and velocity: functions of the time; turning: of the time, bool."""

    end: float
    position: CubicSpline
    velocity: CubicSpline
    turns: np.ndarray  # (k, 2) from, to

    def turning(self, time):
        """Whether the drone brakes, turns or speeds up."""
        time = np.asarray(time)[:, None]
        return ((time >= self.turns[:, 0]) & (time <= self.turns[:, 1])).any(axis=1)


def fly(seed, strips=6, length=150.0, speed=3.0, brake=6.0, across=12.0, gust=0.2, lags=(1.0, 0.4)):
    """strips of `length` m at `speed` m/s, `across` m apart; `brake`: s from strip to turn.

    gust: standard deviation of the shaken velocity, m/s; half of it in height.
    """
    rng = np.random.default_rng(seed)
    legs, turns, now = [], [], 0.0
    for strip in range(strips):
        sense = 1 if strip % 2 == 0 else -1
        legs.append((length / speed, (sense * speed, 0.0, 0.0)))
        now += legs[-1][0]
        if strip < strips - 1:
            aside = brake + 2.0
            legs.append((aside, (0.0, across / aside, 0.1 * sense)))
            turns.append((now, now + aside + brake))
            now += aside
    time = np.arange(0.0, now, STEP)
    velocity = np.zeros((len(time), 3))
    start, before = 0.0, np.array(legs[0][1])
    for duration, wanted in legs:
        wanted = np.array(wanted)
        rows = (time >= start) & (time < start + duration)
        u = np.clip((time[rows] - start) / brake, 0, 1)[:, None]
        velocity[rows] = before + (wanted - before) * u**2 * (3 - 2 * u)
        before, start = wanted, start + duration
    shaken = rng.normal(size=(len(time) + 5000, 3))
    for lag in lags:
        a = np.exp(-STEP / lag)
        shaken = lfilter([1 - a], [1, -a], shaken, axis=0)
    shaken = shaken[5000:]
    velocity += shaken * gust * np.array([1.0, 1.0, 0.5]) / shaken.std(axis=0)
    place = np.cumsum((velocity[1:] + velocity[:-1]) / 2 * STEP, axis=0)
    place = np.vstack([np.zeros(3), place])
    return Flight(
        now - STEP, CubicSpline(time, place), CubicSpline(time, velocity), np.array(turns)
    )


def slow_noise(rng, time, correlation_s):
    """First-order Gauss-Markov, unit variance, three axes, at times (n,): (n, 3)."""
    noise = rng.normal(size=(len(time), 3))
    for k, step in enumerate(np.diff(time), start=1):
        a = np.exp(-step / correlation_s)
        noise[k] = a * noise[k - 1] + np.sqrt(1 - a * a) * noise[k]
    return noise


def observed(flight, seed, interval=1.0, slow=0.0, correlation_s=60.0, velocity=None):
    """The receiver's track (a table) with noise of SIGMA, a share `slow` of it correlated.

    velocity: sigma of the velocities, m/s; None: none.
    """
    rng = np.random.default_rng([seed, 1])
    time = np.arange(0.35, flight.end - 0.5, interval)
    noise = np.sqrt(1 - slow) * rng.normal(size=(len(time), 3))
    if slow:
        noise += np.sqrt(slow) * slow_noise(rng, time, correlation_s)
    table = pd.DataFrame({"time_s": time})
    table[["x", "y", "z"]] = flight.position(time) + SIGMA * noise
    table[["sx", "sy", "sz"]] = np.tile(SIGMA, (len(time), 1))
    if velocity is not None:
        table[["vx", "vy", "vz"]] = (
            flight.velocity(time) + rng.normal(size=(len(time), 3)) * velocity
        )
    return table


def exposures(track, seed, count=1500):
    """Times anywhere between the first and the last epoch."""
    time = track["time_s"].to_numpy()
    return np.sort(np.random.default_rng([seed, 2]).uniform(time[0], time[-1], count))
