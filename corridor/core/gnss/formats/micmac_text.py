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

from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.text import TextRows
from corridor.core.gnss.time import gps_day, on_one_day
from corridor.core.textfile import read_lines

TITLE = "MicMac text (#F=N_X_Y_Z)"

_FORMAT = re.compile(r"(\S)F=(\S.*)")
_KEYS = {"X": "x", "Y": "y", "Z": "z", "Ix": "sx", "Iy": "sy", "Iz": "sz"}


def recognise(head: str) -> bool:
    """Whether the first line is a format line."""
    match = _FORMAT.match(head.splitlines()[0].strip() if head.splitlines() else "")
    return match is not None and "N" in re.split(r"[_\s]+", match[2])


def read(path: Path) -> Exposures:
    """Positions of images, times where the format has week and seconds.

    The file names no coordinates (crs None).
    """
    lines = read_lines(path)
    match = _FORMAT.match(lines[0].strip())
    assert match is not None  # as `recognise` found
    comment, names = match[1], re.split(r"[_\s]+", match[2].strip())
    rows = TextRows.of_lines(path, lines, 1, skip=(comment,))
    rows.expect(len(names), lines[0].strip(), "correct or delete the row")
    if not len(rows):
        raise InputError(f"{path.name} holds no images; write the file again")
    timed = {"W", "Sec"} <= set(names)
    day, time = None, [np.nan] * len(rows)
    if timed:
        weeks, seconds = (rows.numbers(names.index(key), key) for key in ("W", "Sec"))
        stamps = zip(weeks, seconds, strict=True)
        day, time = on_one_day([gps_day(int(week), second) for week, second in stamps])
    images = pd.Series(rows.texts(names.index("N")), dtype="str")
    table = pd.DataFrame({"image": images, "time_s": time})
    for name, key in _KEYS.items():
        if name in names:
            table[key] = rows.numbers(names.index(name), name)
    twice = images.duplicated().to_numpy()
    if twice.any():
        k = int(np.argmax(twice))
        raise rows.wrong(k, f"image {images[k]!r} is there twice; delete one row")
    notes: tuple[str, ...] = ()
    if {"x", "y", "z"} <= set(table):
        empty = (table[["x", "y", "z"]] == 0).all(axis=1)
        if {"sx", "sy", "sz"} <= set(table):
            unknown = (table[["sx", "sy", "sz"]] < 0).any(axis=1)
            empty &= unknown
            table.loc[unknown, ["sx", "sy", "sz"]] = np.nan
        if empty.any():
            table.loc[empty, ["x", "y", "z"]] = np.nan
            notes = (
                f"{path.name}: {int(empty.sum())} of {len(table)} images have no position (0 0 0)",
            )
    return Exposures(table, day, "GPST" if timed else None, None, path, notes=notes)
