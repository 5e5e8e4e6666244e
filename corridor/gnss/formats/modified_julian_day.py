"""Times as Modified Julian Days: `IMAGE DAY` for images, `DAY X Y Z QUALITY` for a track.

Six printed decimals are steps of 86 ms: a time is off by up to 43 ms, half a metre at 11 m/s.
The time system is not part of the form; a comment line may name it (`# GPST`).

Source: MicMac's text exports of tracks and image times.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.epochs import in_order, without_placeholders
from corridor.gnss.exposures import Exposures
from corridor.gnss.text import number
from corridor.gnss.time import DAY_S, mjd_day, on_one_day
from corridor.gnss.track import GEOCENTRIC, Track
from corridor.textfile import read_lines

TITLE = "Modified Julian Days"

# 1968 to 2132
_DAY = re.compile(r"[4-9]\d{4}(?:\.\d*)?")
_SYSTEM = re.compile(r"\b(GPST|UTC(?:[+-]\d{1,2}:\d{2})?|JST|TAI|BDT)\b")
_FINE_S = 2e-3


def recognise(head: str) -> bool:
    """Whether the first row is a name and a day, or a day and a position."""
    first = next((line for line in head.splitlines() if _is_data(line)), "").split()
    if len(first) == 2:
        return is_day(first[1]) and "." in first[1]
    return len(first) in (4, 5) and is_day(first[0]) and "." in first[0]


def read(path: Path) -> Track | Exposures:
    """The image times, or the track, with a note on what the printed decimals cost."""
    lines = read_lines(path)
    named = {match[1] for line in lines if line.startswith("#") for match in _SYSTEM.finditer(line)}
    system = named.pop() if len(named) == 1 else None
    rows = [(row, line.split()) for row, line in enumerate(lines, 1) if _is_data(line)]
    width = len(rows[0][1])
    for row, fields in rows:
        if len(fields) != width:
            raise InputError(
                f"{path.name}, row {row}: {len(fields)} fields where the first row has {width}; "
                "correct or delete the row"
            )
    place = 1 if width == 2 else 0
    texts = [fields[place] for _, fields in rows]
    stamps = [stamp(text, path, row) for text, (row, _) in zip(texts, rows, strict=True)]
    day, time = on_one_day(stamps)
    resolution, notes = coarse(texts, path)
    if width == 2:
        table = pd.DataFrame(
            {"image": pd.Series([fields[0] for _, fields in rows], dtype="str"), "time_s": time}
        )
        return Exposures(table, day, system, None, path, notes=notes, resolution_s=resolution)
    names = ["x", "y", "z", "quality"][: width - 1]
    table = pd.DataFrame(
        [
            [number(text, path, row, name) for text, name in zip(fields[1:], names, strict=True)]
            for row, fields in rows
        ],
        columns=names,
    )
    table.insert(0, "time_s", time)
    keep, empty = without_placeholders(table, path, "epoch")
    at = np.array([row for row, _ in rows])[keep]
    table = table[keep].reset_index(drop=True)
    if resolution:
        _check_apart(table, at, resolution, path)
    table, copies = in_order(table, at, path)
    distance = np.linalg.norm(table[["x", "y", "z"]].to_numpy(), axis=1)
    geocentric = bool(((distance > 6.3e6) & (distance < 6.5e6)).all())
    if not geocentric:
        empty += (
            f"{path.name} does not name its coordinates: they were taken for local metres, east, "
            "north, up",
        )
    crs = GEOCENTRIC if geocentric else None
    return Track(table, day, system, crs, path, notes=(*empty, *copies, *notes))


def is_day(text: str) -> bool:
    """Whether a text is a Modified Julian Day between 1968 and 2132."""
    return bool(_DAY.fullmatch(text))


def stamp(text: str, path: Path, row: int) -> tuple[str, float]:
    """Day and seconds of the day. Raises InputError where it is no Modified Julian Day."""
    if not is_day(text):
        raise InputError(
            f"{path.name}, row {row}: {text!r} is not a Modified Julian Day, as 57552.628579273; "
            "correct or delete the row"
        )
    return mjd_day(text)


def coarse(texts: list[str], path: Path) -> tuple[float | None, tuple[str, ...]]:
    """Step of printed days in seconds, and a note, where it is coarse; else None and no note."""
    decimals = max(len(text.partition(".")[2]) for text in texts)
    step = DAY_S * 10.0**-decimals
    if step < _FINE_S:
        return None, ()
    count = {1: "one decimal", 0: "no decimals"}.get(decimals, f"{decimals} decimals")
    size = f"{step / 2 * 1e3:.0f} ms" if step < 2 else f"{step / 2:.3g} s"
    note = (
        f"{path.name}: Modified Julian Days with {count} are off by up to {size}; write nine "
        "decimals"
    )
    return step, (note,)


def _check_apart(table: pd.DataFrame, rows: np.ndarray, step: float, path: Path) -> None:
    """Raise InputError where epochs fall on one printed time, which is too coarse for them."""
    same = (np.diff(table["time_s"]) == 0) & (np.diff(table["x"]) != 0)
    if same.any():
        raise InputError(
            f"{path.name}, row {rows[int(np.argmax(same)) + 1]}: two epochs have one printed time, "
            f"because its decimals are steps of {step * 1e3:.0f} ms; write nine decimals of the "
            "Modified Julian Day"
        )


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")
