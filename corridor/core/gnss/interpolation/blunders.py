"""Single epochs that are false: where no drone can have been, or far off for their own noise.

An epoch between two others lies beside the line between them by at most

    a (t - t0) (t1 - t) / 2,

a being the largest acceleration; what is more than that and six standard deviations, as stated and
as all of them scatter, is an error of the file or of the receiver. Only one that stands alone is
told: its neighbours agree with theirs once it is out. Where they do not, the track jumps or is bad
all over.

A smaller one is judged by the cubic through two epochs on either side: it stands out by many
sigmas, as stated and as its neighbourhood scatters, once it is out its neighbours lie on the
cubics of theirs, and it lies on the line of neither side: a drone that brakes bends the cubics of
several epochs in succession, or makes a corner. Where one
movement is larger than every other of a flight, without being false, that is worth a sentence.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.geometry import OUTLIER, robust_scale
from corridor.core.gnss.interpolation.jumps import curve_weights
from corridor.core.gnss.interpolation.regimes import GROUPS
from corridor.core.gnss.interpolation.segmenting import stated_sigmas

# Two g: multicopters that survey tilt by 35 degrees (0.7 g) and fall by one g at most.
MOST_M_S2 = 20.0
_SIGMAS = 6.0
# A movement is singular where every other of the piece is smaller by this factor.
_SINGULAR = 2.5
_FEWEST = 12
_REACH = 2  # epochs on either side through which the cubic goes
# What stands out by its own noise: so many sigmas, where 10,000 epochs have one of four; epochs
# looked at beside it and to tell the scatter; what its neighbours may be off by without it.
_OWN_SIGMAS, _LOOK, _NEIGHBOURHOOD, _QUIET, _PASSES = 6.0, 5, 41, 0.3, 8


def blunder_epochs(track: pd.DataFrame, pieces: pd.DataFrame) -> dict[int, float]:
    """Rows of the track that stand alone, and how far each is off, m.

    track: time_s, x, y, z (m), optional sx, sy, sz; pieces: of `segments`.
    """
    time, position = (track[c].to_numpy(float) for c in ("time_s", ["x", "y", "z"]))
    stated = stated_sigmas(track)
    sigma = np.linalg.norm(stated, axis=1)
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
        found |= _false(time, position, stated, rows)
    return found


def _false(time, position, stated, rows) -> dict[int, float]:
    """Rows that stand out by their own noise and alone, and how far each is off, m."""
    found: dict[int, float] = {}
    for _ in range(_PASSES):
        if len(rows) < _FEWEST:
            break
        off, noise = _off_in_sigmas(time[rows], position[rows], stated[rows])
        # Epochs on a line are off by rounding alone, beside no noise: 1 nm at least.
        in_sigmas = off / np.maximum(noise, 1e-9)
        gone: set[int] = set()
        # Height first: where a drone brakes or turns in plan, it still says what is false.
        for _, axes in reversed(GROUPS):
            size = in_sigmas[:, axes].max(axis=1)
            around = np.pad(size, 2 * _REACH)
            around = np.lib.stride_tricks.sliding_window_view(around, 4 * _REACH + 1).max(axis=1)
            for k in np.flatnonzero((size > _OWN_SIGMAS) & (size >= around)):
                row, axis = int(k) + _REACH, axes[int(np.argmax(in_sigmas[k, axes]))]
                near = np.arange(max(row - _LOOK, 0), min(row + _LOOK + 1, len(rows)))
                rest = rows[near[near != row]]
                left, _ = _beside_cubic(time[rest], position[rest, axis], stated[rest, axis])
                most = max(_QUIET * off[k, axis], _SIGMAS / 2 * noise[k, axis])
                ahead = _off_ahead(time[rows], position[rows, axis], row)
                if left.max() < most < ahead and not gone & set(near.tolist()):
                    gone.add(row)
        if not gone:
            break
        found |= {int(rows[row]): float(np.linalg.norm(off[row - _REACH])) for row in gone}
        rows = np.delete(rows, list(gone))
    return found


def _off_ahead(time, value, row) -> float:
    """How far an epoch lies off the line through two before it or two after it, the nearer one, m.

    Where a drone turns within an interval, the epoch is a corner: a cubic across it misses it,
    and the line of one side meets it, as that of neither side meets a false one.
    """
    sides = ((row - 1, row - 2), (row + 1, row + 2))
    slopes = ((value[a] - value[b]) / (time[a] - time[b]) for a, b in sides)
    return min(
        abs(value[row] - value[a] - slope * (time[row] - time[a]))
        for (a, _), slope in zip(sides, slopes, strict=True)
    )


def _off_in_sigmas(time, position, stated) -> tuple[np.ndarray, np.ndarray]:
    """How far inner epochs lie off the cubics of their neighbours (n - 4, 3), m, and the sigma of
    that, as stated and as the neighbourhood scatters."""
    off, noise = (np.empty((len(time) - 2 * _REACH, 3)) for _ in range(2))
    for axis in range(3):
        off[:, axis], noise[:, axis] = _beside_cubic(time, position[:, axis], stated[:, axis])
    from scipy.ndimage import median_filter  # at first use

    near = 1.4826 * median_filter(off, (min(_NEIGHBOURHOOD, len(off)), 1), mode="nearest")
    return off, np.maximum(noise, near)


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

    track, pieces: as of `blunder_epochs`. The curve is the cubic through two epochs on either side.
    """
    found = []
    for piece in pieces.itertuples():
        part = track.iloc[piece.first : piece.last + 1]
        if len(part) < _FEWEST:
            continue
        time = part["time_s"].to_numpy(float)
        for axis, sigma in zip("xyz", stated_sigmas(part).T, strict=True):
            off, noise = _beside_cubic(time, part[axis].to_numpy(float), sigma)
            k = int(np.argmax(off))
            others = off[np.abs(np.arange(len(off)) - k) > _REACH].max(initial=0.0)
            if off[k] > max(_SINGULAR * others, OUTLIER * noise[k]):
                found.append(Singular(time[k + _REACH], axis, float(off[k]), float(others)))
    return found


def _beside_cubic(time, value, sigma) -> tuple[np.ndarray, np.ndarray]:
    """How far epochs lie off the cubic through two on either side, and the sigma of that."""
    n = len(time) - 2 * _REACH
    here = slice(_REACH, _REACH + n)
    near = np.arange(n)[:, None] + [k for k in range(2 * _REACH + 1) if k != _REACH]
    weight = curve_weights(time[near], time[here])
    off = value[here] - (weight * value[near]).sum(axis=1)
    variance = sigma[here] ** 2 + (weight**2 * sigma[near] ** 2).sum(axis=1)
    off = np.abs(off)
    return off, np.maximum(np.sqrt(variance), robust_scale(off))
