"""RTKLIB's solution, .pos: latitude, longitude, height; geocentric; or east, north, up.

What the last line of the header says: the time system, the kind of coordinates, the separator,
the columns. Standard deviations come north first for latitude and longitude, x, y, z for
geocentric, east first for a baseline. Co-deviations are signed roots: cov = v |v|; the track has
correlations in their place.

Source: RTKLIB manual 2.4.2, appendix B.1.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import RHO, SIGMAS, made_possible
from corridor.core.errors import InputError
from corridor.core.gnss.text import TextRows, degrees, number
from corridor.core.gnss.time import day_of, gps_day, on_one_day, seconds_of_clock, time_system
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, POSITION, Track
from corridor.core.textfile import read_lines

TITLE = "RTKLIB .pos"

_COLUMNS = re.compile(
    r"^%\s*(?P<system>[A-Z]{3,9})\b.*?(?P<first>latitude\(deg\)|latitude\(d'\"\)|x-ecef\(m\)"
    r"|e-baseline\(m\))(?P<between>.*?)(?:longitude|y-ecef|n-baseline)"
)
_BARE = re.compile(r"^\s*(\d{4}[/-]\d{2}[/-]\d{2}[\s,;]+\d{1,2}:\d{2}:\d{2}|\d{3,4}\s+\d+\.\d+\s)")
_DATE = re.compile(r"(\d{2,4})[/-](\d{1,2})[/-](\d{1,2})")
_FLOAT = re.compile(r"[+-]?\d+(?:\.\d+)?")

_ORDER = [
    "time_s", "x", "y", "z", "sx", "sy", "sz", *RHO, "vx", "vy", "vz",
    "svx", "svy", "svz", "quality",
]  # fmt: skip
_AXIS = {"e": "x", "n": "y", "u": "z", "x": "x", "y": "y", "z": "z"}
_PAIR = {pair: name for name in RHO for pair in (name[-2:], name[:-3:-1])}
# Column of the track by its name in the header.
_KEYS = {
    "latitude": "y", "longitude": "x", "height": "z", "Q": "quality",
    **{f"{axis}-ecef": axis for axis in "xyz"},
    **{f"{axis}-baseline": _AXIS[axis] for axis in "enu"},
    **{f"{said}{axis}": f"{key}{_AXIS[axis]}"
       for said, key in (("sd", "s"), ("v", "v"), ("sdv", "sv")) for axis in _AXIS},
    **{f"sd{a}{b}": _PAIR[_AXIS[a] + _AXIS[b]]
       for a in _AXIS for b in _AXIS if _AXIS[a] != _AXIS[b]},
}  # fmt: skip


def recognise(head: str) -> bool:
    """Whether the first lines are a .pos, with its header or without."""
    lines = [line for line in head.splitlines() if line.strip()]
    if any(_COLUMNS.match(line) for line in lines):
        return True
    comment = any(line.startswith("%") and "program" in line for line in lines[:3])
    rows = [line for line in lines if not line.startswith("%")]
    return comment or bool(rows and _BARE.match(rows[0]) and len(_fields(rows[0], "")) >= 7)


def read(path: Path) -> Track:
    """The track in a .pos. An e, n, u baseline has its place in the world from `ref pos`."""
    lines = read_lines(path)
    headers = [line for line in lines if _COLUMNS.match(line)]
    header = headers[-1] if headers else None
    if len({tuple(line.split()) for line in headers}) > 1:
        raise InputError(
            f"{path.name} holds several solutions with different headers (time system or columns): "
            "put each into a file of its own"
        )
    if header is None:
        raise InputError(
            f"{path.name}, row 1: the header is missing, so time system and kind of coordinates "
            "are unknown; write the file again with RTKLIB's output option Header on, or put the "
            "header line of such a file (% GPST latitude(deg) longitude(deg) height(m) Q ns ...) "
            "before the first row"
        )
    found = _COLUMNS.match(header)
    assert found is not None  # as `recognise` found
    try:
        system = time_system(found["system"])
    except InputError as error:
        raise InputError(f"{path.name}, row {lines.index(header) + 1}: {error}") from None
    separator = found["between"].strip()
    day, table, at, notes = _epochs(lines, header, separator, path)
    backward = any(re.match(r"%\s*solution\s*:\s*backward", line, re.I) for line in lines)
    if backward and len(table) > 1 and (np.diff(table["time_s"]) <= 0).all():
        table, at = table[::-1].reset_index(drop=True), at[::-1]
        notes.append(f"{path.name} is a backward solution: its rows were put in order of time")
    crs: str | None = GEOGRAPHIC
    origin = None
    if found["first"].startswith("x-ecef"):
        crs = GEOCENTRIC
    elif found["first"].startswith("e-baseline"):
        crs, origin = None, _reference(lines, path)
        if origin is None:
            notes.append(
                f"{path.name} has no ref pos: its east, north, up have no place in the world"
            )
    if any(re.search(r"height=\S+/geodetic", line) for line in lines if line.startswith("%")):
        notes.append(
            f"{path.name}: its heights are above the geoid, as its header says, and stay so; for "
            "heights above the ellipsoid write it again with RTKLIB's output option Ellipsoidal"
        )
    if "quality" in table and (table["quality"] == 5).all():
        notes.append(f"{path.name}: all epochs are single positions, good to metres only")
    # The day is that of the first row of the file, which may be the last of the flight.
    track = Track.of_rows(table, at, path, day, system, crs, notes)
    return replace(track, origin=origin)


def _epochs(lines, header, separator, path) -> tuple[str, pd.DataFrame, np.ndarray, list[str]]:
    """Day, columns of the track, row of each epoch, and notes on what was left out."""
    layout, width = _layout(header, separator)
    rows = TextRows.of_lines(
        path, lines, skip=("%", "$"), split=lambda line: _fields(line, separator)
    )
    stamps = [_stamp(rows, k) for k in range(len(rows))]
    remedy = "delete the row, or write the file again if it is cut off"
    rows.expect(width, "the header", remedy, more=True)
    found = {key: _column(rows, key, *place) for key, place in layout.items()}
    known = found.get("quality", np.ones(len(rows))) != 0
    if not known.any():
        raise InputError(f"{path.name} holds no positions; process the track again")
    day, time = on_one_day([stamp for stamp, kept in zip(stamps, known, strict=True) if kept])
    table = pd.DataFrame(found)[[name for name in _ORDER if name in found]][known]
    table = _with_correlations(table.reset_index(drop=True))
    table.insert(0, "time_s", time)
    dropped = int((~known).sum())
    notes = [f"{path.name}: {dropped} rows without solution (Q 0) left out"] if dropped else []
    return day, table, rows.at[known], notes


def _column(rows: TextRows, key: str, first: int, last: int, name: str) -> np.ndarray:
    if key in POSITION:
        return rows.degrees(first, last, name)
    if key[0] == "s":
        return rows.sigmas(first, name)
    return rows.numbers(first, name, unknown=key in RHO)


def _with_correlations(table: pd.DataFrame) -> pd.DataFrame:
    """The table with correlations in place of co-deviations; without them where one is missing."""
    names = [name for name in RHO if name in table]
    if len(names) < len(RHO) or not set(SIGMAS) <= set(table):
        return table.drop(columns=names)
    root, sigma = table[names].to_numpy(), table[list(SIGMAS)].to_numpy()
    variance = np.stack([sigma[:, i] * sigma[:, j] for i, j in ((0, 1), (0, 2), (1, 2))], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.where(variance > 0, root * np.abs(root) / variance, 0.0)
    table[names] = made_possible(np.nan_to_num(rho))
    return table


def _fields(line: str, separator: str) -> list[str]:
    """Fields of a row: date and time, or week and seconds, are the first two.

    Between separators that can be seen a field may be empty; it must not make others move up.
    """
    if not separator:
        return line.split()
    fields = [field.strip() for field in line.split(separator)]
    return [*fields[0].split(), *fields[1:]]


def _layout(header: str, separator: str) -> tuple[dict[str, tuple[int, int, str]], int]:
    """First field, field after the last and name of each column; fields that a row must have."""
    place = 2
    layout: dict[str, tuple[int, int, str]] = {}
    for name in _fields(header.lstrip("% "), separator)[1:]:
        base = name.partition("(")[0]
        width = 3 if "d'\"" in name else 1
        if base in _KEYS:
            layout.setdefault(_KEYS[base], (place, place + width, base))
        place += width
    return layout, place


def _stamp(rows: TextRows, k: int) -> tuple[str, float]:
    """Day and seconds of it of a row."""
    if len(rows.fields[k]) < 2:
        mark = next((mark for mark in ";," if mark in "".join(rows.fields[k])), None)
        if mark is not None:
            raise rows.wrong(
                k, f"{mark!r} stands between the fields, not in the header; write the file again"
            )
        raise rows.wrong(k, "the position is missing; delete the row")
    first, second = rows.fields[k][:2]
    date, seconds = _DATE.fullmatch(first), seconds_of_clock(second)
    if date and seconds is not None:
        try:
            return day_of(*(int(part) for part in date.groups())), seconds
        except ValueError:
            pass
    elif re.fullmatch(r"\d{1,4}", first) and not date:
        week = int(first)
        seconds = number(second, rows.path, int(rows.at[k]), "seconds of the week")
        if week < 1024:
            raise rows.wrong(
                k,
                f"GPS week {week} is before August 1999, so the weeks are counted modulo 1024; add "
                "1024 or 2048 to them",
            )
        if 0 <= seconds <= 604800:
            return gps_day(week, seconds)
    if re.fullmatch(r"\d{1,2}:\d{2}:\d{2},\d*", second):
        raise rows.wrong(
            k, f"the time {second!r} has a decimal comma; write numbers with a decimal point"
        )
    raise rows.wrong(
        k,
        f"{first} {second} is not a time, as 2024/06/24 08:20:00.000 or 2320 116400.000; correct "
        "or delete the row",
    )


def _reference(lines: list[str], path: Path) -> tuple[float, float, float] | None:
    """Latitude, longitude (degrees), height of `ref pos`.

    Its columns have a fixed width: they run together where the longitude is below -99.
    """
    for row, line in enumerate(lines, 1):
        if line.startswith("%") and re.search(r"\b(ref|slave) pos\b", line):
            parts = _FLOAT.findall(line.partition(":")[2])
            if len(parts) == 7:
                return (
                    degrees(parts[:3], path, row, "ref pos"),
                    degrees(parts[3:6], path, row, "ref pos"),
                    float(parts[6]),
                )
            if len(parts) != 3:
                continue
            values = [float(part) for part in parts]
            if np.linalg.norm(values) > 6.0e6:
                from corridor.core.gnss.coordinates import convert

                longitude, latitude, height = convert(np.array(values), GEOCENTRIC, GEOGRAPHIC)[0]
                return float(latitude), float(longitude), float(height)
            return values[0], values[1], values[2]
    return None
