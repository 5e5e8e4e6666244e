"""RTKLIB's solution, .pos: latitude, longitude, height; geocentric; or east, north, up.

What the last line of the header says: the time system, the kind of coordinates, the separator,
the columns. Standard deviations come north first for latitude and longitude, x, y, z for
geocentric, east first for a baseline. Co-deviations are signed roots: cov = v |v|.

Source: RTKLIB manual 2.4.2, appendix B.1.
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.epochs import check_geographic, in_order
from corridor.gnss.text import degrees, number, sigma
from corridor.gnss.time import day_of, gps_day, on_one_day, time_system
from corridor.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track
from corridor.textfile import read_lines

TITLE = "RTKLIB .pos"

_COLUMNS = re.compile(
    r"^%\s*(?P<system>[A-Z]{3,5})\b.*?(?P<first>latitude\(deg\)|latitude\(d'\"\)|x-ecef\(m\)"
    r"|e-baseline\(m\))(?P<between>.*?)(?:longitude|y-ecef|n-baseline)"
)
_BARE = re.compile(r"^\s*(\d{4}[/-]\d{2}[/-]\d{2}[\s,;]+\d{1,2}:\d{2}:\d{2}|\d{3,4}\s+\d+\.\d+\s)")
_DATE = re.compile(r"(\d{2,4})[/-](\d{1,2})[/-](\d{1,2})")
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)")
_FLOAT = re.compile(r"[+-]?\d+(?:\.\d+)?")

_POSITION = {
    "latitude": "y", "longitude": "x", "height": "z",
    "x-ecef": "x", "y-ecef": "y", "z-ecef": "z",
    "e-baseline": "x", "n-baseline": "y", "u-baseline": "z",
}  # fmt: skip
_ORDER = [
    "time_s", "x", "y", "z", "sx", "sy", "sz", "cxy", "cyz", "czx", "vx", "vy", "vz",
    "svx", "svy", "svz", "quality",
]  # fmt: skip
_AXIS = {"e": "x", "n": "y", "u": "z", "x": "x", "y": "y", "z": "z"}
_PAIR = {"xy": "cxy", "yx": "cxy", "yz": "cyz", "zy": "cyz", "zx": "czx", "xz": "czx"}


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
    header = next((line for line in reversed(lines) if _COLUMNS.match(line)), None)
    if header is None:
        raise InputError(
            f"{path.name}, row 1: the header is missing, so time system and kind of coordinates "
            "are unknown; write the file again with RTKLIB's output option Header on"
        )
    found = _COLUMNS.match(header)
    try:
        system = time_system(found["system"])
    except InputError as error:
        raise InputError(f"{path.name}, row {lines.index(header) + 1}: {error}") from None
    separator = found["between"].strip()
    day, table, rows, notes = _epochs(lines, header, separator, path)
    if _is_backward(lines) and len(table) > 1 and (np.diff(table["time_s"]) <= 0).all():
        table, rows = table[::-1].reset_index(drop=True), rows[::-1]
        notes.append(f"{path.name} is a backward solution: its rows were put in order of time")

    crs, origin = GEOGRAPHIC, None
    if found["first"].startswith("x-ecef"):
        crs = GEOCENTRIC
    elif found["first"].startswith("e-baseline"):
        crs, origin = None, _reference(lines, path)
        if origin is None:
            notes.append(
                f"{path.name} has no ref pos: its east, north, up have no place in the world"
            )
    else:
        check_geographic(table, rows, path)
    # The day is that of the first row of the file, which may be the last of the flight.
    table, copies = in_order(table, rows, path)
    if "quality" in table and (table["quality"] == 5).all():
        notes.append(f"{path.name}: all epochs are single positions, good to metres only")
    return Track(
        table=table,
        day=day,
        time_system=system,
        crs=crs,
        source=path,
        notes=(*notes, *copies),
        origin=origin,
    )


def _epochs(lines, header, separator, path) -> tuple[str, pd.DataFrame, np.ndarray, list[str]]:
    """Day, columns of the track, row of each epoch, and notes on what was left out."""
    layout = _layout(header, separator)
    keys = [key for key, *_ in layout]
    width = _count(header, separator)
    stamps, values, rows = [], [], []
    dropped = 0
    for row, line in enumerate(lines, 1):
        if not line.strip() or line.startswith(("%", "$")):
            continue
        fields = _fields(line, separator)
        stamp = _stamp(fields, path, row)
        if len(fields) < width:
            raise InputError(
                f"{path.name}, row {row}: {len(fields)} fields where the header has "
                f"{width}; delete the row, or write the file again if it is cut off"
            )
        record = [
            _value(fields[first:last], key, path, row, name) for key, first, last, name in layout
        ]
        if "quality" in keys and record[keys.index("quality")] == 0:
            dropped += 1
            continue
        stamps.append(stamp)
        values.append(record)
        rows.append(row)
    if not values:
        raise InputError(f"{path.name} holds no positions; process the track again")
    day, time = on_one_day(stamps)
    table = pd.DataFrame(np.array(values, dtype=float), columns=keys)
    for name in ("cxy", "cyz", "czx"):
        if name in table:
            table[name] = table[name] * table[name].abs()
    table["time_s"] = time
    notes = [f"{path.name}: {dropped} rows without solution (Q 0) left out"] if dropped else []
    return day, table[[name for name in _ORDER if name in table]], np.array(rows), notes


def _fields(line: str, separator: str) -> list[str]:
    """Fields of a row: date and time, or week and seconds, are the first two.

    Between separators that can be seen a field may be empty; it must not make others move up.
    """
    if not separator:
        return line.split()
    fields = [field.strip() for field in line.split(separator)]
    return [*fields[0].split(), *fields[1:]]


def _layout(header: str, separator: str) -> list[tuple[str, int, int, str]]:
    """Column of the track, first field, field after the last, name in the header."""
    names = _fields(header.lstrip("% "), separator)
    place, layout = 2, []
    for name in names[1:]:
        base = name.partition("(")[0]
        width = 3 if "d'\"" in name else 1
        key = _key(base)
        if key and key not in (entry[0] for entry in layout):
            layout.append((key, place, place + width, base))
        place += width
    return layout


def _key(name: str) -> str | None:
    if name in _POSITION:
        return _POSITION[name]
    if name == "Q":
        return "quality"
    for pattern, prefix in (
        (r"sdv([enuxyz])", "sv"),
        (r"sd([enuxyz])", "s"),
        (r"v([enuxyz])", "v"),
    ):
        match = re.fullmatch(pattern, name)
        if match:
            return prefix + _AXIS[match[1]]
    match = re.fullmatch(r"sd([enuxyz])([enuxyz])", name)
    return _PAIR.get(_AXIS[match[1]] + _AXIS[match[2]]) if match else None


def _count(header: str, separator: str) -> int:
    """Fields of a row that the header promises."""
    names = _fields(header.lstrip("% "), separator)
    return len(names) + 1 + sum(2 for name in names if "d'\"" in name)


def _value(parts: list[str], key: str, path: Path, row: int, name: str) -> float:
    if key in ("x", "y", "z"):
        return degrees(parts, path, row, name)
    if key[0] == "s":
        return sigma(parts[0], path, row, name)
    if key[0] == "c" and parts[0].lower().lstrip("+-") == "nan":
        return np.nan
    return number(parts[0], path, row, name)


def _stamp(fields: list[str], path: Path, row: int) -> tuple[str, float]:
    if len(fields) < 2:
        raise InputError(f"{path.name}, row {row}: there is no position; delete the row")
    date, time = _DATE.fullmatch(fields[0]), _CLOCK.fullmatch(fields[1])
    if date and time and float(time[3]) < 61 and int(time[2]) < 60 and int(time[1]) < 25:
        try:
            day = day_of(*(int(part) for part in date.groups()))
            return day, 3600.0 * int(time[1]) + 60.0 * int(time[2]) + float(time[3])
        except ValueError:
            pass
    elif re.fullmatch(r"\d{1,4}", fields[0]) and not date:
        week = int(fields[0])
        seconds = number(fields[1], path, row, "seconds of the week")
        if week < 1024:
            raise InputError(
                f"{path.name}, row {row}: GPS week {week} is before August 1999, so the weeks are "
                "counted modulo 1024; add 1024 or 2048 to them"
            )
        if 0 <= seconds <= 604800:
            return gps_day(week, seconds)
    if re.fullmatch(r"\d{1,2}:\d{2}:\d{2},\d*", fields[1]):
        raise InputError(
            f"{path.name}, row {row}: the time {fields[1]!r} has a decimal comma; write numbers "
            "with a decimal point"
        )
    raise InputError(
        f"{path.name}, row {row}: {fields[0]} {fields[1]} is not a time, as 2024/06/24 "
        "08:20:00.000 or 2320 116400.000; correct or delete the row"
    )


def _is_backward(lines: list[str]) -> bool:
    return any(re.match(r"%\s*solution\s*:\s*backward", line, re.I) for line in lines)


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
                from corridor.gnss.coordinates import convert

                longitude, latitude, height = convert(values, GEOCENTRIC, GEOGRAPHIC)[0]
                return float(latitude), float(longitude), float(height)
            return values[0], values[1], values[2]
    return None
