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

from corridor.core.errors import InputError
from corridor.core.gnss.text import TextRows
from corridor.core.gnss.time import (
    DAY_S,
    day_after,
    day_of,
    gps_day,
    leap_seconds,
    on_one_day,
    seconds_of_clock,
)
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track
from corridor.core.textfile import read_lines

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
    columns = _columns(path, lines[at - 1], lines[at])
    rows = TextRows.of_lines(path, lines, at + 1)
    if not len(rows):
        raise InputError(f"{path.name} holds no epochs; process the track again")
    remedy = "delete the row, or export the file again if it is cut off"
    rows.expect(columns[-1].last, "the header", remedy)
    found = _Table(columns, rows)
    day, system, time, notes = _times(found)
    table = pd.DataFrame({"time_s": time})
    crs = _positions(table, found)
    for key, names in _NUMBERS.items():
        column = found.find(*names)
        if column:
            table[key] = found.sigmas(column) if key[0] == "s" else found.numbers(column)
    horizontal = found.find("SDHoriz", "SDHz")
    if horizontal and "sx" not in table:
        table["sx"] = table["sy"] = found.sigmas(horizontal)
    quality = found.find("Q")
    if quality:
        own = found.numbers(quality)
        table["quality"] = np.array([_QUALITY.get(int(value), np.nan) for value in own], float)
        table["grafnav_quality"] = own
    order = ["time_s", "x", "y", "z", *_NUMBERS, "quality", "grafnav_quality"]
    table = table[[name for name in order if name in table]]
    return Track.of_rows(table, rows.at, path, day, system, crs, notes)


def _columns(path: Path, names: str, units: str) -> list[_Column]:
    """Columns in order, with the fields of a row that are theirs."""
    spans = [(match[0], match.end()) for match in re.finditer(r"\S+", names)]
    unit_of: dict[int, str] = {}
    for match in re.finditer(r"\(([^()]*)\)", units):
        free = [k for k in range(len(spans)) if k not in unit_of]
        if not free:
            raise InputError(
                f"{path.name} has more units than columns ({names.strip()[:60]}); export it again, "
                "with columns between blanks"
            )
        nearest = min(free, key=lambda k: abs(spans[k][1] - match.end()))
        unit_of[nearest] = " ".join(match[1].split())
    columns, place = [], 0
    for k, (name, _) in enumerate(spans):
        unit = unit_of.get(k, "")
        width = 3 if len(re.findall(r"[A-Za-z]+", unit)) == 3 and " " in unit else 1
        columns.append(_Column(name, unit, place, place + width))
        place += width
    return columns


@dataclass(frozen=True)
class _Table:
    """The columns, and the rows that they are of; what is asked for comes in SI units."""

    columns: list[_Column]
    rows: TextRows

    def find(self, *names: str, unit: str | None = None) -> _Column | None:
        for name in names:
            for column in self.columns:
                if column.name == name and (unit is None or column.unit.lower() == unit.lower()):
                    return column
        return None

    def numbers(self, column: _Column) -> np.ndarray:
        return _UNIT_M.get(column.unit, 1.0) * self.rows.numbers(column.first, column.name)

    def sigmas(self, column: _Column) -> np.ndarray:
        return _UNIT_M.get(column.unit, 1.0) * self.rows.sigmas(column.first, column.name)

    def degrees(self, column: _Column) -> np.ndarray:
        return self.rows.degrees(column.first, column.last, column.name)

    def clock(self, name: str) -> np.ndarray | None:
        """Seconds of the day of a column in hours, minutes and seconds."""
        column = self.find(name, unit="HMS")
        if column is None:
            return None
        texts = self.rows.texts(column.first)
        seconds = [seconds_of_clock(text) for text in texts]
        if None in seconds:
            k = seconds.index(None)
            raise self.rows.wrong(
                k, f"{name} = {texts[k]!r} is not a time, as 5:54:22.200; correct or delete the row"
            )
        return np.array(seconds)

    def dates(self, *names: str) -> list[str] | None:
        """The day of each row."""
        column = self.find(*names)
        if column is None or column.unit.upper() not in _DATE_ORDER:
            return None
        order = _DATE_ORDER[column.unit.upper()]
        dates: dict[str, str] = {}
        texts = self.rows.texts(column.first)
        for k, text in enumerate(texts):
            if text not in dates:
                try:
                    parts = [int(part) for part in re.split(r"[/.-]", text)]
                    dates[text] = day_of(*(parts[place] for place in order))
                except (ValueError, IndexError):
                    raise self.rows.wrong(
                        k,
                        f"{column.name} = {text!r} is not a date ({column.unit}); correct or "
                        "delete the row",
                    ) from None
        return [dates[text] for text in texts]

    def lacks(self, *names: str, remedy: str) -> InputError:
        has = ", ".join(
            f"{one.name} ({one.unit})" if one.unit else one.name for one in self.columns
        )
        what = " and ".join(name for name in names if not self.find(name))
        return InputError(f"{self.rows.path.name} lacks {what} (it has {has}); {remedy}")


def _positions(table: pd.DataFrame, found: _Table) -> str:
    """Fill x, y, z; returns the CRS."""
    latitude, longitude = found.find("Latitude"), found.find("Longitude")
    height = found.find("H-Ell")
    geocentric = [found.find(f"{axis}-ECEF") for axis in "XYZ"]
    if latitude and longitude and height:
        table["x"], table["y"] = found.degrees(longitude), found.degrees(latitude)
        table["z"] = found.numbers(height)
        return GEOGRAPHIC
    if all(geocentric):
        for key, column in zip("xyz", geocentric, strict=True):
            assert column is not None
            table[key] = found.numbers(column)
        return GEOCENTRIC
    remedy = "export it again with heights above the ellipsoid"
    raise found.lacks("Latitude", "Longitude", "H-Ell", remedy=remedy)


def _times(found: _Table) -> tuple[str | None, str, np.ndarray, list[str]]:
    """Day, time system, seconds since that day's 00:00, notes."""
    gps, utc = found.clock("GPSTime"), found.clock("UTCTime")
    gps_date, utc_date = found.dates("GPSDate", "Date"), found.dates("UTCDate")
    week, seconds = found.find("Week", "GPSWeek"), found.find("GPSTime", unit="sec")
    notes, name = [], found.rows.path.name
    if gps is not None and utc is not None and utc_date is not None:
        apart = np.round((gps - utc) % DAY_S, 3)
        leap = leap_seconds(utc_date[0])
        if (apart != leap).any():
            k = int(np.argmax(apart != leap))
            raise found.rows.wrong(
                k,
                f"GPS time and UTC are {apart[k]:g} s apart, but {leap} s on {utc_date[k]}; export "
                "the file again with the right UTC offset",
            )
        notes.append(f"{name} states GPS time and UTC, {leap} s apart as they should be")
    if gps is not None and gps_date is None and utc_date is not None:
        # In the first seconds of a GPS day it is still the day before in UTC.
        late = [second < leap_seconds(day) for second, day in zip(gps, utc_date, strict=True)]
        gps_date = [day_after(day) if k else day for day, k in zip(utc_date, late, strict=True)]
    for date, clock, system in ((gps_date, gps, "GPST"), (utc_date, utc, "UTC")):
        if date is not None and clock is not None:
            day, time = on_one_day(list(zip(date, clock.tolist(), strict=True)))
            return day, system, np.array(time), notes
    if week and seconds:
        stamps = zip(found.numbers(week), found.numbers(seconds), strict=True)
        day, time = on_one_day([gps_day(int(week), second) for week, second in stamps])
        return day, "GPST", np.array(time), notes
    for named, system, clock in (("GPSTime", "GPST", gps), ("UTCTime", "UTC", utc)):
        column = found.find(named, unit="sec")
        if clock is None and column:
            clock = found.numbers(column)
        if clock is not None:
            notes.append(f"{name} states no date, only {named}")
            return None, system, _unwrapped(clock), notes
    raise found.lacks("GPSTime in sec or HMS", remedy="export it again with date and GPS time")


def _unwrapped(seconds: np.ndarray) -> np.ndarray:
    """Without the step back of a whole day (or week) at midnight."""
    step = np.diff(seconds, prepend=seconds[0])
    length = DAY_S if seconds.max() <= DAY_S else 7 * DAY_S
    return seconds + length * np.cumsum(step < -length / 2)
