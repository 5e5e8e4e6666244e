"""Whether antenna positions between the epochs of a track are as good as their sigmas say.

python -m benchmarks.tracks [--each 28] [--first 0] [--only WORD ...] [--json FILE] [--short]

Tracks of a drone that flies strips, stops and turns, every rate with every air and every fault of
`RATES`, `AIRS` and `FAULTS`; photographs between the epochs, whose true places are known. For each
kind: the root of the mean square of errors over sigmas, of plan and height, of what is not refused;
how many lie beyond five sigmas, and of how many of their tracks `gnss` says nothing.
"""

import argparse
import json
import time
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from benchmarks.draws import ratio
from corridor.core.errors import InputError
from corridor.core.gnss import interpolate

RATES = (1.0, 5.0, 10.0)
# Nothing; gusts of 0.2 m/s, as a wing and its mass make them; a position shaken with a flat
# spectrum up to a frequency, cm and Hz.
AIRS = {"calm": (0, 0), "gusts": (0, 0), "2 cm to 1 Hz": (0.02, 1.0), "5 cm to 2 Hz": (0.05, 2.0)}
FAULTS = ("none", "gaps", "float", "false epochs", "wrong sigmas", "slow noise")
SIGMA = np.array([0.008, 0.008, 0.015])
_FINE_S, _SPEED, _LEG_S, _LEGS, _EVERY_S = 0.02, 5.0, 24.0, 5, 1.7
_LOWEST_HZ, _GUST_M_S, _GUST_S = 0.05, 0.2, (1.0, 0.4)
# By how much stated sigmas are too small; of false epochs; of a float solution (it states so).
_TOO_SMALL, _FALSE_M, _FLOAT_M, _SLOW, _SLOW_S = 2.7, 0.4, 0.2, 0.7, 60.0
_SAID_ANYHOW = "correlated in time"


def way(rng, air):
    """Times (n,) and positions (n, 3) of a flight of strips, in steps of `_FINE_S`."""
    count = round(_LEGS * _LEG_S / _FINE_S)
    fine = _FINE_S * np.arange(count)
    leg, into = np.divmod(fine, _LEG_S)
    velocity = np.zeros((count, 3))
    aside = into > 0.85 * _LEG_S
    velocity[~aside, 0] = _SPEED * np.where(leg % 2 == 0, 1, -1)[~aside]
    velocity[aside, 1] = _SPEED / 2
    velocity = gaussian_filter1d(velocity, 0.8 / _FINE_S, axis=0, mode="nearest")
    if air == "gusts":
        blown = rng.standard_normal((count + 1000, 3))
        for lag in _GUST_S:
            keep = np.exp(-_FINE_S / lag)
            blown = lfilter([1 - keep], [1, -keep], blown, axis=0)
        velocity += _GUST_M_S * (blown / blown.std(axis=0))[1000:] * [1, 1, 0.5]
    place = np.cumsum(velocity, axis=0) * _FINE_S + [0, 0, 50]
    size, highest = AIRS[air]
    if size:
        spectrum = np.fft.rfft(rng.standard_normal((count, 3)), axis=0)
        frequency = np.fft.rfftfreq(count, _FINE_S)
        spectrum[(frequency > highest) | (frequency < _LOWEST_HZ)] = 0
        shaken = np.fft.irfft(spectrum, count, axis=0)
        place += size * shaken / shaken.std(axis=0)
    return fine, place


def track(rng, rate, fault, fine, place):
    """What a receiver writes of it."""
    every = round(1 / rate / _FINE_S)
    rows = np.arange(int(rng.integers(every)), len(fine), every)
    count = len(rows)
    noise = rng.standard_normal((count, 3))
    if fault == "slow noise":
        slow, keep = rng.standard_normal((count, 3)), np.exp(-1 / rate / _SLOW_S)
        for n in range(1, count):
            slow[n] = keep * slow[n - 1] + np.sqrt(1 - keep**2) * slow[n]
        noise = np.sqrt(1 - _SLOW) * noise + np.sqrt(_SLOW) * slow
    noise *= SIGMA * (_TOO_SMALL if fault == "wrong sigmas" else 1)
    sigma, quality = np.tile(SIGMA, (count, 1)), np.ones(count)
    if fault == "float":
        begin = int(rng.integers(count // 5, count // 2))
        loose = slice(begin, begin + count // 5)
        noise[loose] += _FLOAT_M * rng.standard_normal(3)
        sigma[loose], quality[loose] = np.hypot(SIGMA, _FLOAT_M), 2
    if fault == "false epochs":
        wrong = rng.choice(np.arange(6, count - 6, 8), max(count // 60, 2), replace=False)
        noise[wrong] += _FALSE_M * rng.standard_normal((len(wrong), 3))
    table = pd.DataFrame({"time_s": fine[rows], "quality": quality})
    table[["x", "y", "z"]] = place[rows] + noise
    table[["sx", "sy", "sz"]] = sigma
    if fault == "gaps":
        gone = np.zeros(count, bool)
        for begin in rng.uniform(10, fine[-1] - 10, 3):
            gone |= (table["time_s"] > begin) & (table["time_s"] < begin + rng.uniform(1, 6))
        table = table[~gone].reset_index(drop=True)
    return table


def measured(number, rate, air, fault):
    """Errors over sigma (n, 3) of what is not refused, how many were asked, and the notes."""
    kind = (RATES.index(rate), list(AIRS).index(air), FAULTS.index(fault))
    rng = np.random.default_rng([number, *kind])
    fine, place = way(rng, air)
    epochs = track(rng, rate, fault, fine, place)
    at = np.arange(epochs["time_s"].iloc[0] + 0.3, epochs["time_s"].iloc[-1], _EVERY_S)
    at = at + rng.uniform(-0.3, 0.3, len(at))
    at = at[at < epochs["time_s"].iloc[-1]]
    found = interpolate(epochs, at)
    good = (found.table["why"] == "").to_numpy()
    true = np.stack([np.interp(at, fine, one) for one in place.T], axis=1)
    off = found.table[["x", "y", "z"]].to_numpy() - true
    return (off / found.table[["sx", "sy", "sz"]].to_numpy())[good], len(at), found


def row(rate, air, fault, numbers):
    """What all tracks of a kind say."""
    plan, height, asked, kept, far, silent = [], [], 0, 0, 0, 0
    for number in numbers:
        try:
            off, many, found = measured(number, rate, air, fault)
        except InputError:
            continue
        asked, kept = asked + many, kept + len(off)
        beyond = int((np.abs(off) > 5).any(axis=1).sum())
        far += beyond
        silent += bool(beyond) and all(_SAID_ANYHOW in note for note in found.notes)
        if len(off):
            plan.append(np.mean(off[:, :2] ** 2))
            height.append(np.mean(off[:, 2] ** 2))
    return {
        "rate": rate, "air": air, "fault": fault, "tracks": len(numbers),
        "plan": ratio(np.array(plan)), "height": ratio(np.array(height)),
        "asked": asked, "refused": asked - kept, "beyond_5": far, "silent_tracks": silent,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--each", type=int, default=28, help="tracks of each kind (default 28)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--only", nargs="*", default=[], help="kinds whose names have these words")
    parser.add_argument("--short", action="store_true", help="two of each kind")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    numbers = range(options.first, options.first + (2 if options.short else options.each))
    rows = []
    for rate, air, fault in product(RATES, AIRS, FAULTS):
        name = f"{rate:g} Hz, {air}, {fault}"
        if not all(word in name for word in options.only):
            continue
        began = time.process_time()
        found = row(rate, air, fault, numbers)
        rows.append(found)
        print(
            f"{name:34s} plan {found['plan']['ratio']:.2f} height {found['height']['ratio']:.2f}; "
            f"{found['refused']} of {found['asked']} refused, {found['beyond_5']} beyond 5 sigmas, "
            f"{found['silent_tracks']} tracks without a word; {time.process_time() - began:.1f} s",
            flush=True,
        )
        if options.json:
            options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
