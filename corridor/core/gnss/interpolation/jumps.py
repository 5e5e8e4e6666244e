"""Where a track jumps: what epochs before and after say of one moment lies apart.

A drone moves on between two epochs as it did before the first and will after the second; where it
brakes or turns there, the two curves meet within the interval. Where they do not, by many sigmas as
stated and as all around scatter, and nowhere near as much, the positions jump: a wrong ambiguity,
another base, heights of two kinds. Which side is right the track does not say, but where it jumps
back after a few epochs these are false.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.geometry import robust_scale
from corridor.core.gnss.interpolation.segmenting import stated_sigmas

# Epochs on either side of a jump: a parabola through them follows one that brakes.
_REACH = 3
# What stands out: in sigmas; against what is this many intervals away, by this share; of so many.
_SIGMAS, _NEAR, _LONE, _FEWEST = 7.0, 16, 0.5, 24
# A multicopter reaches its largest tilt, 0.7 g, within 0.7 s: m/s^3. Parabolas through three epochs
# on either side of such a motion lie apart by this share of it, times the cube of the interval.
_JERK, _OF_JERK = 10.0, 0.625
# Epochs that are false together; those beside them by which that is judged, and by how much better
# they then lie on one curve than with a jump for good.
_RUN, _BESIDE, _BETTER = 4, 6, 0.3
# Of a zigzag, what is left at two steps; a sigma where none is stated, m.
_GONE, _UNSTATED_M = 0.5, 0.02
# Moments about the middle of the interval, in intervals.
_TRIED = np.linspace(-0.5, 0.5, 11)


class Jump(NamedTuple):
    """Row of the first epoch after it, its time, s, and by how much x, y, z grow, m."""

    row: int
    time_s: float
    by: np.ndarray

    @property
    def size(self) -> float:
        """Its length, m."""
        return float(np.linalg.norm(self.by))


def jumps(track: pd.DataFrame, pieces: pd.DataFrame) -> tuple[list[Jump], dict[int, float]]:
    """Where the positions of a track jump for good, and the rows where they jump for some epochs,
    with how far they are off, m.

    track: time_s, x, y, z (m), optional sx, sy, sz; pieces: of `segments`.
    """
    time, position = (track[c].to_numpy(float) for c in ("time_s", ["x", "y", "z"]))
    stated = stated_sigmas(track)
    found: list[Jump] = []
    false: dict[int, float] = {}
    for piece in pieces.itertuples():
        rows = np.arange(piece.first, piece.last + 1)
        if len(rows) < _FEWEST:
            continue
        for pair, (by, noise) in enumerate(
            told(time[rows], position[rows], stated[rows]) for told in (_apart, _pair_off)
        ):
            first = _REACH - pair
            for k in _alone(by, noise, np.diff(time[rows])[first - 1 :][: len(by)]):
                row = int(k) + first
                run, off = _run(time[rows], position[rows], row)
                if len(run):
                    false |= dict.fromkeys(rows[run].tolist(), off)
                elif not pair:
                    found.append(Jump(int(rows[row]), float(time[rows[row]]), by[k]))
    found = [jump for jump in found if not any(abs(jump.row - row) <= _RUN for row in false)]
    return found, false


def _alone(by: np.ndarray, noise: np.ndarray, step: np.ndarray) -> list[int]:
    """Rows of differences (n, 3), m, that stand out by their noise and the scatter of all, beyond
    what a drone flies within a step (n,), s, and alone."""
    from scipy.ndimage import maximum_filter1d  # at first use: few blocks have a track

    scatter = np.array([robust_scale(axis) for axis in by.T])
    size = np.linalg.norm(by / np.maximum(np.maximum(noise, scatter), 1e-9), axis=1)
    metres = np.linalg.norm(by, axis=1)
    # Of all epochs that it takes the widest interval counts.
    most = _OF_JERK * _JERK * maximum_filter1d(step, 2 * _REACH - 1) ** 3
    found = []
    for k in np.flatnonzero((size > _SIGMAS) & (metres > most)):
        near = np.arange(max(int(k) - _NEAR, 0), min(int(k) + _NEAR + 1, len(size)))
        beside = near[np.abs(near - k) >= _REACH + _RUN]
        if size[k] == size[near].max() and metres[beside].max(initial=0.0) <= _LONE * metres[k]:
            found.append(int(k))
    return found


def _pair_off(time, position, stated) -> tuple[np.ndarray, np.ndarray]:
    """How far two epochs (their mean) lie off the cubic through two on either side (n, 3), m, and
    the standard deviation of that; the first row is of the third and fourth epoch."""
    n = len(time) - 5
    rows = np.arange(n)[:, None] + [0, 1, 4, 5]
    weight = sum(curve_weights(time[rows], time[2 + k : 2 + k + n]) for k in (0, 1)) / 2
    by = (position[2 : 2 + n] + position[3 : 3 + n]) / 2
    by = by - np.einsum("nk,nka->na", weight, position[rows])
    noise = np.einsum("nk,nka->na", weight**2, stated[rows] ** 2)
    return by, np.sqrt(noise + (stated[2 : 2 + n] ** 2 + stated[3 : 3 + n] ** 2) / 4)


def _run(time: np.ndarray, position: np.ndarray, row: int) -> tuple[np.ndarray, float]:
    """The few epochs beside a jump before a row that lie off one curve of all others, if any do,
    and by how much, m."""
    start, end = max(row - _RUN - _BESIDE, 0), min(row + _RUN + _BESIDE, len(time))
    near = np.arange(start, end)
    since = (time[near] - time[row]) / (time[end - 1] - time[start])
    # Of a few epochs the parabolas of both ends overlap: the jump may seem to be in their middle.
    runs = [
        near[(near >= a) & (near < a + n)]
        for n in range(2, _RUN + 1)
        for a in range(row - n, row + _REACH)
    ]
    steps = [near < 0, *(near >= a for a in range(row - _RUN, row + _RUN + 1))]
    aside = [*steps, *(np.isin(near, run) for run in runs)]
    left, off = [], []
    for one in aside:
        design = np.column_stack([since**k for k in range(4)] + [one])
        solved = np.linalg.lstsq(design, position[near], rcond=None)[0]
        left.append(float(np.sum((position[near] - design @ solved) ** 2)))
        off.append(float(np.linalg.norm(solved[-1])))
    best, least = int(np.argmin(left[len(steps) :])), min(left[: len(steps)])
    better = left[len(steps) + best] < _BETTER * least
    return (runs[best] if better else near[:0]), off[len(steps) + best]


def _apart(time, position, stated) -> tuple[np.ndarray, np.ndarray]:
    """How far the curves before and after each interval lie apart where they are nearest (m, 3), m,
    and the standard deviation of that in its middle."""
    n = len(time) - 2 * _REACH + 1
    first = np.arange(n)
    left, right = first[:, None] + np.arange(_REACH), first[:, None] + _REACH + np.arange(_REACH)
    start, end = time[left[:, -1]], time[right[:, 0]]
    best = np.full(n, np.inf)
    by, noise = (np.zeros((n, 3)) for _ in range(2))
    for share in _TRIED:
        at = (start + end) / 2 + share * (end - start)
        one, other = (curve_weights(time[rows], at) for rows in (left, right))
        apart = np.einsum("nk,nka->na", other, position[right])
        apart -= np.einsum("nk,nka->na", one, position[left])
        nearer = np.linalg.norm(apart, axis=1) < best
        by[nearer], best[nearer] = apart[nearer], np.linalg.norm(apart, axis=1)[nearer]
        if share == 0:
            noise = np.einsum("nk,nka->na", one**2, stated[left] ** 2)
            noise = np.sqrt(noise + np.einsum("nk,nka->na", other**2, stated[right] ** 2))
    return by, noise


def curve_weights(time: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weights (n, k) of the epochs at times (n, k) in the curve through them, at moments (n,)."""
    out = np.ones(time.shape)
    for one in range(time.shape[1]):
        for other in range(time.shape[1]):
            if other != one:
                out[:, one] *= (at - time[:, other]) / (time[:, one] - time[:, other])
    return out


def alternating(track: pd.DataFrame, pieces: pd.DataFrame) -> float:
    """How far every second epoch lies beside the others, m: two receivers in one file; else 0.

    Second differences of what is flown or shaken grow with the lag between epochs, those of noise
    stay as they are; those of a zigzag are gone at two steps.
    """
    position = track[["x", "y", "z"]].to_numpy(float)
    usual = float(np.median(stated_sigmas(track))) or _UNSTATED_M
    for piece in pieces.itertuples():
        rows = slice(piece.first, piece.last + 1)
        if piece.epochs < _FEWEST:
            continue
        one, two = (
            np.linalg.norm(near[2 * n :] - 2 * near[n:-n] + near[: -2 * n], axis=1)
            for near in (position[rows],)
            for n in (1, 2)
        )
        size = float(np.median(one))
        if size > _SIGMAS * np.sqrt(6) * usual and np.median(two) < _GONE * size:
            return size / 2
    return 0.0
