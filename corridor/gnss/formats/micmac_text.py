"""MicMac's text with a format line: `#F=N_X_Y_Z`, then rows of these columns.

The character before `F=` starts a comment; `_` or blanks separate the names: N image, X Y Z
position, Ix Iy Iz its standard deviations, S something to skip; W and Sec together are GPS week
and seconds. A row of 0 0 0 with a standard deviation of -1 is MicMac's word for no position.

Source: MicMac, cReadObject and InterpImTM.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.exposures import Exposures
from corridor.gnss.text import number
from corridor.gnss.time import gps_day, on_one_day
from corridor.textfile import read_lines

TITLE = "MicMac text (#F=N_X_Y_Z)"

_FORMAT = re.compile(r"(\S)F=(\S.*)")
_KEYS = {"X": "x", "Y": "y", "Z": "z", "Ix": "sx", "Iy": "sy", "Iz": "sz"}


def recognise(head: str) -> bool:
    """Whether the first line is a format line."""
    match = _FORMAT.match(head.splitlines()[0].strip() if head.splitlines() else "")
    return bool(match) and "N" in re.split(r"[_\s]+", match[2])


def read(path: Path) -> Exposures:
    """Positions of images, times where the format has week and seconds.

    The file names no coordinates (crs None).
    """
    lines = read_lines(path)
    comment, names = _FORMAT.match(lines[0].strip()).groups()
    names = re.split(r"[_\s]+", names.strip())
    timed = {"W", "Sec"} <= set(names)
    images, stamps, values, rows = [], [], [], []
    keys = [key for name, key in _KEYS.items() if name in names]
    for row, line in enumerate(lines[1:], 2):
        if not line.strip() or line.startswith(comment):
            continue
        fields = line.split()
        if len(fields) != len(names):
            raise InputError(
                f"{path.name}, row {row}: {len(fields)} fields where {lines[0].strip()} has "
                f"{len(names)}; correct or delete the row"
            )
        cell = dict(zip(names, fields, strict=True))
        images.append(cell["N"])
        rows.append(row)
        if timed:
            week = number(cell["W"], path, row, "W")
            stamps.append(gps_day(int(week), number(cell["Sec"], path, row, "Sec")))
        values.append([number(cell[name], path, row, name) for name in _KEYS if name in names])
    if not images:
        raise InputError(f"{path.name} holds no images; write the file again")
    table = pd.DataFrame({"image": pd.Series(images, dtype="str")})
    day, time = on_one_day(stamps) if timed else (None, [np.nan] * len(images))
    table["time_s"] = np.array(time, dtype=float)
    table[keys] = np.array(values, dtype=float).reshape(len(images), len(keys))
    _check_names(table, rows, path)
    notes = ()
    if {"x", "y", "z"} <= set(keys):
        empty = (table[["x", "y", "z"]] == 0).all(axis=1)
        if {"sx", "sy", "sz"} <= set(keys):
            empty &= (table[["sx", "sy", "sz"]] < 0).any(axis=1)
            unknown = (table[["sx", "sy", "sz"]] < 0).any(axis=1)
            table.loc[unknown, ["sx", "sy", "sz"]] = np.nan
        count = int(empty.sum())
        if count:
            table.loc[empty, ["x", "y", "z"]] = np.nan
            notes = (f"{path.name}: {count} of {len(table)} images have no position (0 0 0)",)
    return Exposures(table, day, "GPST" if timed else None, None, path, notes=notes)


def _check_names(table: pd.DataFrame, rows: list[int], path: Path) -> None:
    twice = table["image"].duplicated().to_numpy()
    if twice.any():
        k = int(np.argmax(twice))
        raise InputError(
            f"{path.name}, row {rows[k]}: image {table['image'].iloc[k]!r} is there twice; delete "
            "one row"
        )
