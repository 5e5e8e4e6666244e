"""GrafNav's (Waypoint's) text export: a header, names of the columns, units below them, rows.

Which columns there are is the user's choice; they are found by name and unit. Names are aligned
to the right with their units; some (Q, NS) have no unit.

Source: headers of GrafNav 8.90 and 9.00 exports, which describe their columns.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.epochs import check_geographic, in_order
from corridor.gnss.text import degrees, number, sigma
from corridor.gnss.time import DAY_S, day_after, day_of, gps_day, leap_seconds, on_one_day
from corridor.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track
from corridor.textfile import read_lines

TITLE = "GrafNav text"

_UNITS = re.compile(r"^\s*(?:\([^()]*\)\s*){2,}$")
_DATE_ORDER = {"YMD": (0, 1, 2), "MDY": (2, 0, 1), "DMY": (2, 1, 0)}
# GrafNav counts from 1, best, to 6, worst; kept in the column grafnav_quality.
_QUALITY = {1: 1, 2: 2, 3: 2, 4: 2, 5: 4, 6: 5}
_UNIT_M = {"m": 1.0, "ft": 0.3048, "m/s": 1.0, "km/h": 1 / 3.6}

# Column of the track: names in GrafNav.
_NUMBERS = {
    "sx": ("SDEast", "SDE"), "sy": ("SDNorth", "SDN"), "sz": ("SDHeight", "SDUp", "SDH"),
    "vx": ("VEast",), "vy": ("VNorth",), "vz": ("VUp",),
    "svx": ("SDVEast", "VESD"), "svy": ("SDVNorth", "VNSD"), "svz": ("SDVUp", "VUpSD"),
}  # fmt: skip


@dataclass(frozen=True)
class _Column:
    name: str
    unit: str
    first: int
    last: int


def recognise(head: str) -> bool:
    """Whether the first lines are those of GrafNav."""
    lines = head.splitlines()
    named = any("GrafNav" in line for line in lines) or any(
        line.startswith("Project:") for line in lines
    )
    table = any(
        _UNITS.match(below) and ("Latitude" in line or "X-ECEF" in line)
        for line, below in zip(lines, lines[1:], strict=False)
    )
    return named or table


def read(path: Path) -> Track:
    """The track in a GrafNav text, in GPS time where the file has it.

    One horizontal standard deviation (SDHoriz) is taken for east and for north.
    """
    lines = read_lines(path)
    at = next((k for k in range(1, len(lines)) if _UNITS.match(lines[k])), None)
    if at is None:
        raise InputError(
            f"{path.name} has no header with names and units of the columns; export it again with "
            "the header on"
        )
    columns = _columns(lines[at - 1], lines[at])
    width = columns[-1].last
    rows = [row for row, line in enumerate(lines[at + 1 :], at + 2) if line.strip()]
    split = [lines[row - 1].split() for row in rows]
    if not rows:
        raise InputError(f"{path.name} holds no epochs; process the track again")
    for row, fields in zip(rows, split, strict=True):
        if len(fields) != width:
            raise InputError(
                f"{path.name}, row {row}: {len(fields)} fields where the header has {width}; "
                "delete the row, or export the file again if it is cut off"
            )

    day, system, time, notes = _times(columns, split, rows, path)
    table = {"time_s": time}
    crs = _positions(table, columns, split, rows, path)
    for key, names in _NUMBERS.items():
        column = _find(columns, *names)
        if column:
            table[key] = _values(column, split, rows, path, sigma if key[0] == "s" else number)
    horizontal = _find(columns, "SDHoriz", "SDHz")
    if horizontal and "sx" not in table:
        table["sx"] = _values(horizontal, split, rows, path, sigma)
        table["sy"] = table["sx"].copy()
    quality = _find(columns, "Q")
    if quality:
        own = _values(quality, split, rows, path, number)
        table["quality"] = np.array([_QUALITY.get(int(value), np.nan) for value in own])
        table["grafnav_quality"] = own
    order = ["time_s", "x", "y", "z", *_NUMBERS, "quality", "grafnav_quality"]
    frame = pd.DataFrame({name: table[name] for name in order if name in table}).astype(float)
    at_row = np.array(rows)
    if crs == GEOGRAPHIC:
        check_geographic(frame, at_row, path)
    frame, copies = in_order(frame, at_row, path)
    return Track(frame, day, system, crs, path, notes=(*notes, *copies))


def _columns(names: str, units: str) -> list[_Column]:
    """Columns in order, with the fields of a row that are theirs."""
    spans = [(match[0], match.end()) for match in re.finditer(r"\S+", names)]
    unit_of: dict[int, str] = {}
    for match in re.finditer(r"\(([^()]*)\)", units):
        free = [k for k in range(len(spans)) if k not in unit_of]
        nearest = min(free, key=lambda k: abs(spans[k][1] - match.end()))
        unit_of[nearest] = " ".join(match[1].split())
    columns, place = [], 0
    for k, (name, _) in enumerate(spans):
        unit = unit_of.get(k, "")
        width = 3 if len(re.findall(r"[A-Za-z]+", unit)) == 3 and " " in unit else 1
        columns.append(_Column(name, unit, place, place + width))
        place += width
    return columns


def _find(columns: list[_Column], *names: str, unit: str | None = None) -> _Column | None:
    for name in names:
        for column in columns:
            if column.name == name and (unit is None or column.unit.lower() == unit.lower()):
                return column
    return None


def _values(column: _Column, split, rows, path: Path, how) -> np.ndarray:
    factor = _UNIT_M.get(column.unit, 1.0)
    place = column.first
    return factor * np.array(
        [
            how(fields[place], path, row, column.name)
            for fields, row in zip(split, rows, strict=True)
        ]
    )


def _positions(table: dict, columns, split, rows, path: Path) -> str:
    """Fill x, y, z; returns the CRS."""
    latitude, longitude = _find(columns, "Latitude"), _find(columns, "Longitude")
    height = _find(columns, "H-Ell")
    geocentric = [_find(columns, f"{axis}-ECEF") for axis in "XYZ"]
    if latitude and longitude and height:
        for key, column in (("x", longitude), ("y", latitude)):
            table[key] = np.array(
                [
                    degrees(fields[column.first : column.last], path, row, column.name)
                    for fields, row in zip(split, rows, strict=True)
                ]
            )
        table["z"] = _values(height, split, rows, path, number)
        return GEOGRAPHIC
    if all(geocentric):
        for key, column in zip("xyz", geocentric, strict=True):
            table[key] = _values(column, split, rows, path, number)
        return GEOCENTRIC
    has = ", ".join(column.name for column in columns)
    raise InputError(
        f"{path.name} lacks Latitude, Longitude and H-Ell (it has {has}); export it again with "
        "heights above the ellipsoid"
    )


def _times(columns, split, rows, path: Path):
    """Day, time system, seconds since that day's 00:00, notes."""
    gps = _clock(columns, "GPSTime", split, rows, path)
    utc = _clock(columns, "UTCTime", split, rows, path)
    gps_date = _dates(columns, ("GPSDate", "Date"), split, rows, path)
    utc_date = _dates(columns, ("UTCDate",), split, rows, path)
    week = _find(columns, "Week", "GPSWeek")
    seconds = _find(columns, "GPSTime", unit="sec")
    notes = []
    if gps is not None and utc is not None and utc_date is not None:
        apart = np.round((gps - utc) % DAY_S, 3)
        leap = leap_seconds(utc_date[0])
        if (apart != leap).any():
            k = int(np.argmax(apart != leap))
            raise InputError(
                f"{path.name}, row {rows[k]}: GPS time and UTC are {apart[k]:g} s apart, but "
                f"{leap} s on {utc_date[k]}; export the file again with the right UTC offset"
            )
        notes.append(f"{path.name} states GPS time and UTC, {leap} s apart as they should be")
    if gps is not None and gps_date is not None:
        return _dated(gps_date, gps, "GPST", notes)
    if gps is not None and utc_date is not None:
        # In the first seconds of a GPS day it is still the day before in UTC.
        late = [second < leap_seconds(day) for second, day in zip(gps, utc_date, strict=True)]
        dates = [day_after(day) if k else day for day, k in zip(utc_date, late, strict=True)]
        return _dated(dates, gps, "GPST", notes)
    if utc is not None and utc_date is not None:
        return _dated(utc_date, utc, "UTC", notes)
    if week and seconds:
        weeks = _values(week, split, rows, path, number)
        within = _values(seconds, split, rows, path, number)
        stamps = [gps_day(int(w), s) for w, s in zip(weeks, within, strict=True)]
        day, time = on_one_day(stamps)
        return day, "GPST", np.array(time), notes
    for name, system in (("GPSTime", "GPST"), ("UTCTime", "UTC")):
        clock = gps if system == "GPST" else utc
        column = _find(columns, name, unit="sec")
        if clock is None and column:
            clock = _values(column, split, rows, path, number)
        if clock is not None:
            notes.append(f"{path.name} states no date, only {name}")
            return None, system, _unwrapped(clock), notes
    has = ", ".join(column.name for column in columns)
    raise InputError(
        f"{path.name} lacks GPSTime and UTCTime (it has {has}); export it again with date and GPS "
        "time"
    )


def _dated(dates: list[str], seconds: np.ndarray, system: str, notes: list[str]):
    day, time = on_one_day(list(zip(dates, seconds.tolist(), strict=True)))
    return day, system, np.array(time), notes


def _unwrapped(seconds: np.ndarray) -> np.ndarray:
    """Without the step back of a whole day (or week) at midnight."""
    step = np.diff(seconds, prepend=seconds[0])
    length = DAY_S if seconds.max() <= DAY_S else 7 * DAY_S
    return seconds + length * np.cumsum(step < -length / 2)


def _clock(columns, name: str, split, rows, path: Path) -> np.ndarray | None:
    """Seconds of the day of a column in hours, minutes and seconds."""
    column = _find(columns, name, unit="HMS")
    if column is None:
        return None
    seconds = []
    for fields, row in zip(split, rows, strict=True):
        match = re.fullmatch(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)", fields[column.first])
        if not match:
            raise InputError(
                f"{path.name}, row {row}: {name} = {fields[column.first]!r} is not a time, as "
                "5:54:22.200; correct or delete the row"
            )
        seconds.append(3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3]))
    return np.array(seconds)


def _dates(columns, names, split, rows, path: Path) -> list[str] | None:
    column = _find(columns, *names)
    if column is None or column.unit.upper() not in _DATE_ORDER:
        return None
    order = _DATE_ORDER[column.unit.upper()]
    known: dict[str, str] = {}
    dates = []
    for fields, row in zip(split, rows, strict=True):
        text = fields[column.first]
        if text not in known:
            try:
                parts = [int(part) for part in re.split(r"[/.-]", text)]
                known[text] = day_of(*(parts[k] for k in order))
            except (ValueError, IndexError):
                raise InputError(
                    f"{path.name}, row {row}: {column.name} = {text!r} is not a date "
                    f"({column.unit}); correct or delete the row"
                ) from None
        dates.append(known[text])
    return dates
