"""Where a track is one flight without a hole: nothing is interpolated from one piece to another.

A piece ends at a gap, where the column `flight` changes, and where the drone stood for a minute
between two flights (battery change). Short gaps do not end a piece: the smoother says itself how
little it knows there.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from corridor.core.errors import InputError

_GAP_S = 10.0
_STANDING_S = 60.0
_WINDOW_S = 10.0
_STILL_M = 0.3


def segments(track: pd.DataFrame, jumps: Sequence[int] = ()) -> pd.DataFrame:
    """Pieces of a track, in the order of its rows.

    track: columns time_s, x, y, z (metres), optional flight; times rise within each flight.
    jumps: rows before which the positions jump. A piece ends there, and where two epochs are
    further apart than 10 s, and than ten usual intervals.
    Returns first, last (rows, both included), start_s, end_s, epochs, interval_s (usual),
    flight ("" where not named) and begins: why it does ("track", "flight", "gap", "jump",
    "standing").
    Two pieces cut where the drone stood share the epoch of the cut.
    Raises InputError, naming the epoch (from 1), where times do not rise or are not numbers.
    """
    time = track["time_s"].to_numpy(dtype=float)
    n = len(time)
    if n < 2:
        raise InputError(f"a track of {n} epochs cannot be interpolated; give at least two")
    unknown = ~np.isfinite(track[["time_s", "x", "y", "z"]].to_numpy(dtype=float)).all(axis=1)
    if unknown.any():
        raise InputError(
            f"epoch {int(np.argmax(unknown)) + 1} of the track has no time or no position; "
            "delete the row"
        )
    flight = track["flight"].astype(str).to_numpy() if "flight" in track else np.full(n, "")
    step = np.diff(time)
    other = flight[1:] != flight[:-1]
    wrong = (step <= 0) & ~other
    if wrong.any():
        k = int(np.argmax(wrong))
        what = "goes back" if step[k] < 0 else "stands still"
        raise InputError(
            f"epoch {k + 2} of the track: the time {what} at {time[k + 1]:.3f} s; sort the rows by "
            "time and keep one an epoch"
        )
    usual = float(np.median(step[~other])) if (~other).any() else 1.0
    gap = (step > max(_GAP_S, 10 * usual)) & ~other
    cuts = {0: "track"}
    cuts |= dict.fromkeys(jumps, "jump")
    cuts |= dict.fromkeys((np.flatnonzero(gap) + 1).tolist(), "gap")
    cuts |= dict.fromkeys((np.flatnonzero(other) + 1).tolist(), "flight")
    rows: list = []
    bounds = [*sorted(cuts), n]
    for first, end in zip(bounds[:-1], bounds[1:], strict=True):
        begins = cuts[first]
        for middle in _stands(track.iloc[first:end]):
            rows.append(
                (first, first + middle, begins)
                if not rows or begins != "standing"
                else (rows[-1][1], first + middle, begins)
            )
            begins = "standing"
        start = rows[-1][1] if begins == "standing" else first
        rows.append((start, end - 1, begins))
    table = pd.DataFrame(rows, columns=["first", "last", "begins"])
    table["start_s"], table["end_s"] = time[table["first"]], time[table["last"]]
    table["epochs"] = table["last"] - table["first"] + 1
    table["interval_s"] = [
        float(np.median(np.diff(time[a : b + 1]))) if b > a else np.nan
        for a, b in zip(table["first"], table["last"], strict=True)
    ]
    table["flight"] = flight[table["first"]]
    return table


def stated_sigmas(track: pd.DataFrame) -> np.ndarray:
    """Standard deviations (n, 3), m, that epochs state; 0 where they do not."""
    if not {"sx", "sy", "sz"} <= set(track):
        return np.zeros((len(track), 3))
    return np.nan_to_num(track[["sx", "sy", "sz"]].to_numpy(float))


def _stands(piece: pd.DataFrame) -> list[int]:
    """Middle rows of the periods in which the drone stood between two flights."""
    time = piece["time_s"].to_numpy(dtype=float)
    if time[-1] - time[0] < _STANDING_S:
        return []
    place = piece[["x", "y", "z"]].to_numpy(dtype=float)
    size = max(int(round(_WINDOW_S / np.median(np.diff(time)))), 2)
    # Noise of float epochs must not look like flying.
    reach = _STILL_M + 6 * stated_sigmas(piece).max(axis=1, initial=0.0)
    from scipy.ndimage import maximum_filter1d, minimum_filter1d  # at first use

    span = maximum_filter1d(place, size, axis=0) - minimum_filter1d(place, size, axis=0)
    still = (span <= reach[:, None]).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    return [
        int((a + b) // 2)
        for a, b in edges.reshape(-1, 2)
        if a > 0 and b < len(time) and time[b - 1] - time[a] >= _STANDING_S
    ]
