"""Single epochs that lie where no drone can have been.

An epoch between two others lies beside the line between them by at most

    a (t - t0) (t1 - t) / 2,

a being the largest acceleration; what is more than that and six standard deviations, as stated and
as all of them scatter, is an error of the file or of the receiver. Only one that stands alone is
told: its neighbours agree with theirs once it is out. Where they do not, the track jumps or is bad
all over. A drone can move by less than that; where it does so once in a flight and nowhere else by
half as much, that is worth a sentence.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.geometry import OUTLIER, robust_scale

# Two g: multicopters that survey tilt by 35 degrees (0.7 g) and fall by one g at most.
MOST_M_S2 = 20.0
_SIGMAS = 6.0
# A movement is singular where every other of the piece is smaller by this factor.
_SINGULAR = 2.5
_FEWEST = 12
_REACH = 2  # epochs on either side through which the cubic goes


def wild_epochs(track: pd.DataFrame, pieces: pd.DataFrame) -> dict[int, float]:
    """Rows of the track that stand alone, and how far each is off, m.

    track: time_s, x, y, z (m), optional sx, sy, sz; pieces: of `segments`.
    """
    time, position = (track[c].to_numpy(float) for c in ("time_s", ["x", "y", "z"]))
    sigma = np.zeros(len(track))
    if {"sx", "sy", "sz"} <= set(track):
        sigma = np.nan_to_num(np.linalg.norm(track[["sx", "sy", "sz"]].to_numpy(float), axis=1))
    found: dict[int, float] = {}
    for piece in pieces.itertuples():
        rows = np.arange(piece.first, piece.last + 1)
        usual = 0.0
        if len(rows) > 4:
            usual = float(np.median(_beside(time[rows], position[rows], sigma[rows])[0]))
        while len(rows) > 4:
            off, allowed = _beside(time[rows], position[rows], sigma[rows], usual)
            k = int(np.argmax(off / allowed))
            rest = np.delete(rows, k + 1)
            near = rest[max(k - 1, 0) : k + 3]
            left, most = _beside(time[near], position[near], sigma[near], usual)
            if off[k] <= allowed[k] or (left > most).any():
                break
            found[int(rows[k + 1])] = float(off[k])
            rows = rest
    return found


def _beside(time, position, sigma, usual=0.0) -> tuple[np.ndarray, np.ndarray]:
    """How far inner epochs lie beside the line between their neighbours, and may at most, m."""
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    share = (before / (before + after))[:, None]
    off = position[1:-1] - (1 - share) * position[:-2] - share * position[2:]
    off = np.linalg.norm(off, axis=1)
    noise = np.maximum(np.sqrt(sigma[:-2] ** 2 + sigma[1:-1] ** 2 + sigma[2:] ** 2), usual)
    return off, 0.5 * MOST_M_S2 * before * after + _SIGMAS * noise


class Singular(NamedTuple):
    """An epoch off the cubic through its neighbours: time (s), axis, by how much (m), next most."""

    time_s: float
    axis: str
    off: float
    others: float


def singular_epochs(track: pd.DataFrame, pieces: pd.DataFrame) -> list[Singular]:
    """Epochs that leave the curve of their neighbours as no other does; one an axis and piece.

    track, pieces: as of `wild_epochs`. The curve is the cubic through two epochs on either side.
    """
    found = []
    for piece in pieces.itertuples():
        part = track.iloc[piece.first : piece.last + 1]
        if len(part) < _FEWEST:
            continue
        time = part["time_s"].to_numpy(float)
        for axis in "xyz":
            sigma = np.zeros(len(part))
            if f"s{axis}" in part:
                sigma = np.nan_to_num(part[f"s{axis}"].to_numpy(float))
            off, noise = _beside_cubic(time, part[axis].to_numpy(float), sigma)
            k = int(np.argmax(off))
            others = off[np.abs(np.arange(len(off)) - k) > _REACH].max(initial=0.0)
            if off[k] > max(_SINGULAR * others, OUTLIER * noise[k]):
                found.append(Singular(time[k + _REACH], axis, float(off[k]), float(others)))
    return found


def _beside_cubic(time, value, sigma) -> tuple[np.ndarray, np.ndarray]:
    """How far epochs lie off the cubic through two on either side, and the sigma of that."""
    n = len(time) - 2 * _REACH
    near = [slice(k, k + n) for k in range(2 * _REACH + 1) if k != _REACH]
    here = slice(_REACH, _REACH + n)
    off, variance = value[here].copy(), sigma[here] ** 2
    for one in near:
        weight = np.ones(n)
        for other in near:
            if other != one:
                weight *= (time[here] - time[other]) / (time[one] - time[other])
        off -= weight * value[one]
        variance += (weight * sigma[one]) ** 2
    off = np.abs(off)
    return off, np.maximum(np.sqrt(variance), robust_scale(off))
