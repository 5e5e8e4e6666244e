"""POSPac's trajectory with attitudes: its text export, and SBET (smoothed best estimate).

Text: a header with the names of the columns between commas, rows between blanks; time in seconds
of the GPS week, the week that of `Date of Mission`. Heights: that which follows the longitude. SBET
has no header: 17 doubles a record (time in seconds of the GPS week, latitude, longitude, altitude,
three velocities, roll, pitch, platform heading, wander angle, three accelerations, three angular
rates; radians, metres, low byte first). Heading from true north = platform heading - wander angle.
Roll (right side down), pitch (nose up) and heading are of the IMU, as those of an aircraft. The
standard deviations are in a file beside it, `smrmsg` where that one has `sbet` in its name: 10
doubles (time; positions north, east, down, m; three velocities; roll, pitch, heading, arc minutes).
A smoothed track does not scatter by its errors: where nothing states them, they are assumed.

Source: the header that POSPac writes before its text; POSPac MMS user guide, SBET and SMRMSG.
"""

import os
import re
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import ANGLE_SIGMAS, ANGLES, SIGMAS
from corridor.core.errors import InputError
from corridor.core.gnss.text import TextRows
from corridor.core.gnss.time import DAY_S, WEEK_S
from corridor.core.gnss.track import GEOGRAPHIC, Track
from corridor.core.textfile import read_lines

TITLE = "POSPac text or SBET"

_DATE = re.compile(r"Date of Mission:\s*(\d{4})-(\d\d)-(\d\d)")
_NUMBERS = {
    "x": "LONGITUDE", "y": "LATITUDE", "roll": "ROLL", "pitch": "PITCH", "yaw": "HEADING",
    "vx": "EAST VELOCITY", "vy": "NORTH VELOCITY", "vz": "UP VELOCITY",
}  # fmt: skip
_SIGMAS = dict(zip(("sx", "sy", "sz", *ANGLE_SIGMAS), (
    "EAST SD", "NORTH SD", "HEIGHT SD", "ROLL SD", "PITCH SD", "HEADING SD",
), strict=True))  # fmt: skip
_NEEDED = ("TIME", "LATITUDE", "LONGITUDE", "ROLL", "PITCH", "HEADING")
_RECORD = np.dtype("<f8")
_WIDTH, _WIDTH_OF_SIGMAS = 17, 10
# m; a block assumes as much of positions of which nothing is said.
_ASSUMED = (0.02, 0.02, 0.04)


def _header(lines: list[str]) -> int | None:
    """The first line that names the columns."""
    named = ({cell.strip() for cell in line.split(",")} for line in lines)
    return next((k for k, cells in enumerate(named) if cells.issuperset(_NEEDED)), None)


def recognise(head: str) -> bool:
    """Whether the first lines are those of POSPac's text with all its columns."""
    return _header(head.splitlines()) is not None


def is_sbet(path: Path) -> bool:
    """Whether a file holds whole records of which the first is a time and a place on Earth."""
    size = os.path.getsize(path)
    if not size or size % (_WIDTH * _RECORD.itemsize):
        return False
    time, lat, lon, height = np.fromfile(path, _RECORD, 4)
    # Bytes of other files are mostly numbers next to nothing.
    place = 1e-9 < abs(lat) <= np.pi / 2 and 1e-9 < abs(lon) <= np.pi and abs(height) < 1e5
    return bool(1e-3 < time < 2 * WEEK_S and place)


def read(path: Path) -> Track:
    """The track in POSPac's text. Raises InputError naming file and row."""
    lines = read_lines(path)
    at = _header(lines)
    assert at is not None  # as `recognise` found
    names = [name.strip() for name in lines[at].split(",")]
    rows = TextRows.of_lines(path, lines, at + 1, skip=("  (", " (", "("))
    if not len(rows):
        raise InputError(f"{path.name} holds no epochs; export the trajectory again")
    rows.expect(len(names), "the header", "delete the row, or export it again if it is cut off")
    found = {key: rows.numbers(names.index(name), name)
             for key, name in _NUMBERS.items() if name in names}  # fmt: skip
    found |= {key: rows.sigmas(names.index(name), name)
              for key, name in _SIGMAS.items() if name in names}  # fmt: skip
    heights = [k for k in range(names.index("LONGITUDE"), len(names)) if "HEIGHT" in names[k]][:1]
    if not heights:
        raise InputError(f"{path.name} has no height behind the longitude; export it with heights")
    found["z"] = rows.numbers(heights[0], names[heights[0]])
    time, day = rows.numbers(names.index("TIME"), "TIME"), None
    if said := next(filter(None, map(_DATE.search, lines[:at])), None):
        day = date(*map(int, said.groups())).isoformat()
        # They count from the Sunday before.
        time = time - DAY_S * (date.fromisoformat(day).isoweekday() % 7)
    return _track(path, pd.DataFrame({"time_s": time, **found}), rows.at, day)


def read_sbet(path: Path) -> Track:
    """The track in an SBET. Raises InputError naming file and record."""
    data = np.fromfile(path, _RECORD).reshape(-1, _WIDTH)
    if len(lost := np.flatnonzero(~np.isfinite(data).all(axis=1))):
        raise InputError(
            f"{path.name}, record {lost[0] + 1}: a number is not finite; export the SBET again"
        )
    angles = np.degrees(data[:, [2, 1, 7, 8]])
    table = pd.DataFrame({"time_s": data[:, 0], "x": angles[:, 0], "y": angles[:, 1]})
    table["z"] = data[:, 3]
    heading = np.degrees(data[:, 9] - data[:, 10]) % 360.0
    table[list(ANGLES[0])] = np.column_stack([angles[:, 2:], heading])
    beside = path.with_name(re.sub("(?i)sbet", "smrmsg", path.name))
    if beside != path and beside.is_file():
        size = os.path.getsize(beside)
        if not size or size % (_WIDTH_OF_SIGMAS * _RECORD.itemsize):
            raise InputError(f"{beside.name} is cut off; export it again, or take it away")
        said = np.fromfile(beside, _RECORD).reshape(-1, _WIDTH_OF_SIGMAS)
        sigma = [np.interp(data[:, 0], said[:, 0], said[:, k]) for k in (2, 1, 3, 7, 8, 9)]
        table[[*SIGMAS, *ANGLE_SIGMAS]] = np.column_stack(sigma) / [1, 1, 1, 60, 60, 60]
    return _track(path, table, np.arange(len(table)) + 1, None)


def _track(path: Path, table: pd.DataFrame, rows: np.ndarray, day: str | None) -> Track:
    notes = []
    if not set(SIGMAS) <= set(table):
        table[list(SIGMAS)] = _ASSUMED
        notes.append(
            f"{path.name} states no standard deviations, and a smoothed track does not show them: "
            f"{_ASSUMED[0]:g} m horizontally and {_ASSUMED[2]:g} m in height are assumed; export "
            "them too (smrmsg_... beside sbet_..., or the SD columns of the text)"
        )
    notes.append(
        f"{path.name}: positions and attitudes of POSPac are those of the point it was told to "
        "give (IMU, antenna or camera); lever arm and boresight are what is left"
    )
    order = ["time_s", "x", "y", "z"]
    table = table[[*order, *(name for name in table if name not in order)]]
    return Track.of_rows(table, rows, path, day, "GPST", GEOGRAPHIC, notes)
