"""Tables of a block: track.csv (time_s, x, y, z, ...) and images.csv (image, time_s, ...).

Both count time_s on one clock, whose time system and day are not stated, and are in the local
metres of the block.
"""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from corridor.errors import InputError
from corridor.gnss.epochs import in_order
from corridor.gnss.exposures import Exposures
from corridor.gnss.text import number
from corridor.gnss.track import Track
from corridor.textfile import read_lines

TITLE = "track.csv or images.csv of a block"

_TRACK = ("time_s", "x", "y", "z")
_TRACK_TOO = ("sx", "sy", "sz", "quality", "vx", "vy", "vz")


def recognise(head: str) -> bool:
    """Whether the header line has the needed columns, but for one that may be misspelt."""
    names = set(_names(head.splitlines()[0])) if head.splitlines() else set()
    return (
        len(names & set(_TRACK)) >= 3
        or {"image", "time_s"} <= names
        or ("image" in names and ("camera" in names or "x" in names))
    )


def read(path: Path) -> Track | Exposures:
    """The track, or the exposures: whichever the header says."""
    names, cells, rows = (_parquet if path.suffix == ".parquet" else _csv)(path)
    twice = [name for name in names if name and names.count(name) > 1]
    if twice:
        raise InputError(f"{path.name}, row 1: column {twice[0]} is there twice; delete one")
    table = dict(zip(names, cells, strict=True))
    if "image" in table:
        return _exposures(path, table, rows)
    return _track(path, table, rows)


def _track(path: Path, table: dict, rows: np.ndarray) -> Track:
    _need(path, table, _TRACK)
    columns = {name: _numbers(path, table, name, rows, needed=True) for name in _TRACK}
    for name in _TRACK_TOO:
        if name in table:
            columns[name] = _numbers(path, table, name, rows, needed=False)
    frame = pd.DataFrame(columns)
    if "flight" in table:
        frame["flight"] = pd.Series([cell or "" for cell in table["flight"]], dtype="str")
    frame, notes = in_order(frame, rows, path)
    return Track(frame, None, None, None, path, notes=notes)


def _exposures(path: Path, table: dict, rows: np.ndarray) -> Exposures:
    _need(path, table, ("image", "time_s"))
    images = [cell or "" for cell in table["image"]]
    for k, name in enumerate(images):
        if not name:
            raise InputError(f"{path.name}, row {rows[k]}: image is empty; name it")
    time = _numbers(path, table, "time_s", rows, needed=False)
    frame = pd.DataFrame({"image": pd.Series(images, dtype="str"), "time_s": time})
    if {"x", "y", "z"} <= set(table):
        for name in "xyz":
            frame[name] = _numbers(path, table, name, rows, needed=False)
    if "flight" in table:
        frame["flight"] = pd.Series([cell or "" for cell in table["flight"]], dtype="str")
    unknown = np.isnan(time)
    if unknown.all():
        raise InputError(f"{path.name}: no image has a time; fill the column time_s")
    notes = ()
    if unknown.any():
        first = rows[int(np.argmax(unknown))]
        notes = (
            f"{path.name}: {int(unknown.sum())} of {len(images)} images have no time_s (first in "
            f"row {first})",
        )
    return Exposures(frame, None, None, None, path, notes=notes)


def _need(path: Path, table: dict, needed: tuple[str, ...]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise InputError(
            f"{path.name}, row 1: column {missing[0]} is missing (there are {', '.join(table)}); "
            "add it to the header"
        )


def _numbers(path: Path, table: dict, name: str, rows: np.ndarray, needed: bool) -> np.ndarray:
    cells = table[name]
    values = np.empty(len(cells))
    for k, cell in enumerate(cells):
        if cell is None or cell == "":
            if needed:
                raise InputError(
                    f"{path.name}, row {rows[k]}: {name} is empty; fill it in or delete the row"
                )
            values[k] = math.nan
        else:
            values[k] = number(cell, path, int(rows[k]), name)
    return values


def _csv(path: Path):
    lines = read_lines(path)
    reader = csv.reader(lines)
    records = [(reader.line_num, record) for record in reader if record]
    names = [name.strip() for name in records[0][1]]
    if len(names) == 1:
        raise InputError(
            f"{path.name}, row 1: the cells are not separated by commas; save the file comma "
            "separated, with decimal points"
        )
    for row, record in records[1:]:
        if len(record) != len(names):
            raise InputError(
                f"{path.name}, row {row}: {len(record)} cells where the header has {len(names)}; "
                "separate cells by commas, and write numbers with a decimal point"
            )
    if len(records) == 1:
        raise InputError(f"{path.name} holds no rows below its header; write the file again")
    cells = [
        [cell.strip() for cell in column]
        for column in zip(*(r for _, r in records[1:]), strict=True)
    ]
    return names, cells, np.array([row for row, _ in records[1:]])


def _parquet(path: Path):
    try:
        frame = pd.read_parquet(path)
    except (pa.ArrowInvalid, OSError, ValueError) as error:
        raise InputError(f"{path.name} is not a Parquet file; write it again") from error
    cells = [
        [None if pd.isna(value) else str(value) for value in frame[name]] for name in frame.columns
    ]
    return list(frame.columns), cells, np.arange(1, len(frame) + 1)


def _names(header: str) -> list[str]:
    return [name.strip() for name in re.split("[,;\t]", header)]
