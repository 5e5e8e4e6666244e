"""What every track must keep: rising times, one position an epoch, numbers that can be."""

from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.time import clock

POSITION = ["x", "y", "z"]


def in_order(
    table: pd.DataFrame, rows: np.ndarray, path: Path
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The table without copies of epochs, and notes on what was left out.

    table: columns of a track; times must rise within each flight. rows: (n,) lines of the file.
    Raises InputError where the time goes back, or one epoch has two positions.
    """
    if not len(table):
        raise InputError(f"{path.name} holds no epochs; write the track again")
    time = table["time_s"].to_numpy()
    same_flight = np.ones(len(table) - 1, dtype=bool)
    if "flight" in table:
        names = table["flight"].to_numpy()
        same_flight = names[1:] == names[:-1]
    step = np.diff(time)
    back = same_flight & (step < 0)
    if back.any():
        k = int(np.argmax(back))
        raise InputError(
            f"{path.name}, row {rows[k + 1]}: the time goes back by {-step[k]:.6g} s, from "
            f"{clock(time[k])} in row {rows[k]} to {clock(time[k + 1])}; sort the rows by time, or "
            "put each flight into a file of its own"
        )
    twice = same_flight & (step == 0)
    if not twice.any():
        return table, ()
    position = table[POSITION].to_numpy()
    differ = twice & (position[1:] != position[:-1]).any(axis=1)
    if differ.any():
        k = int(np.argmax(differ))
        raise InputError(
            f"{path.name}, row {rows[k + 1]}: the epoch {clock(time[k])} stands in row {rows[k]} "
            "too, with another position; delete the wrong one"
        )
    copies = np.append(False, twice)
    count, first = int(copies.sum()), rows[int(np.argmax(copies))]
    note = f"{path.name}: {count} epoch{'s' * (count > 1)} written twice (first in row {first}), "
    note += "the copies were left out"
    return table[~copies].reset_index(drop=True), (note,)


def check_geographic(table: pd.DataFrame, rows: np.ndarray, path: Path) -> None:
    """Raise InputError where a longitude (x) or latitude (y), degrees, cannot be."""
    wrong = (table["y"].abs() > 90) | (table["x"].abs() > 360)
    if wrong.any():
        k = int(np.argmax(wrong.to_numpy()))
        raise InputError(
            f"{path.name}, row {rows[k]}: latitude {table['y'].iloc[k]:g} and longitude "
            f"{table['x'].iloc[k]:g} are no place on Earth; correct or delete the row"
        )


def without_placeholders(table: pd.DataFrame, path: Path, what: str) -> tuple[np.ndarray, tuple]:
    """(n,) bool: the rows with a position, and a note on those that are 0 0 0."""
    empty = (table[POSITION] == 0).all(axis=1).to_numpy()
    count = int(empty.sum())
    if not count:
        return ~empty, ()
    note = f"{path.name}: {count} {what}{'s' * (count > 1)} at 0 0 0 left out: no position"
    return ~empty, (note,)
