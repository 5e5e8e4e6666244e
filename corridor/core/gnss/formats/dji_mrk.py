"""DJI's time marks, Timestamp.MRK: one row an exposure, in GPS time.

Number, seconds of the GPS week, [week], offset from the antenna to the camera in mm north, east
and V, latitude, longitude, height above the ellipsoid, standard deviations north, east, up in m,
flag. V is positive down. The position is the camera's already: the offset has been applied.

Source: DJI Zenmuse P1 user manual 1.2, image log file ("after compensation").
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.time import WEEK_S, gps_day, on_one_day
from corridor.core.gnss.track import GEOGRAPHIC
from corridor.core.textfile import read_lines

TITLE = "DJI .MRK"

_NUMBER = r"([+-]?\d+(?:\.\d*)?)"
_ROW = re.compile(
    rf"\s*(\d+)\s+(\d+(?:\.\d*)?)\s+\[\s*(\d+)\s*\]\s+{_NUMBER}\s*,\s*N\s+{_NUMBER}\s*,\s*E\s+"
    rf"{_NUMBER}\s*,\s*V\s+{_NUMBER}\s*,\s*Lat\s+{_NUMBER}\s*,\s*Lon\s+{_NUMBER}\s*,\s*Ellh\s+"
    rf"{_NUMBER}\s*,\s*{_NUMBER}\s*,\s*{_NUMBER}\s+(\d+)\s*,\s*Q\s*"
)
_LIKE = re.compile(r"\s*\d+\s+\d+(\.\d*)?\s+\[\s*\d+\s*\]\s")
_COLUMNS = [
    "offset_n", "offset_e", "offset_u", "y", "x", "z", "sy", "sx", "sz", "flag",
]  # fmt: skip

_FIXED = 50


def status(flag: int) -> str:
    """What DJI's positioning status says, in words.

    Source: DJI Mavic 3E/3T user manual, RtkFlag (0, 16, 32 to 49, 50).
    """
    if flag == 16:
        return "a single position, good to metres"
    if 32 <= flag < _FIXED:
        return "a float solution, good to decimetres or metres"
    return {0: "no position", _FIXED: "a fix, good to centimetres"}.get(
        flag, "which DJI does not describe and which is not taken for a fix"
    )


def recognise(head: str) -> bool:
    """Whether the first row is a time mark."""
    first = next((line for line in head.splitlines() if line.strip()), "")
    return bool(_LIKE.match(first))


def read(path: Path) -> Exposures:
    """Exposures of a .MRK; x, y, z are longitude, latitude, height; offsets in metres, up."""
    numbers, stamps, values = [], [], []
    before, last, restarts = 0.0, 0, 0
    for row, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        match = _ROW.fullmatch(line)
        if match is None:
            raise InputError(
                f"{path.name}, row {row}: {line.strip()[:40]!r} is not a time mark of DJI; correct "
                "or delete the row"
            )
        number, seconds, week, *rest = match.groups()
        if int(week) < 1024 or float(seconds) > 604800:
            raise InputError(
                f"{path.name}, row {row}: second {seconds} of GPS week {week} is not a time of a "
                "drone flight; correct the week, counted from 1980, or delete the row"
            )
        # Some marks keep the week in which a flight began, while its seconds begin anew.
        restarts += before - float(seconds) > WEEK_S / 2 and int(week) == last
        before, last = float(seconds), int(week)
        numbers.append(int(number))
        stamps.append(gps_day(int(week) + restarts, float(seconds)))
        values.append([float(text) for text in rest])
    day, time = on_one_day(stamps)
    table = pd.DataFrame(np.array(values), columns=_COLUMNS)
    table[["offset_n", "offset_e", "offset_u"]] *= [1e-3, 1e-3, -1e-3]
    table.insert(0, "number", pd.array(numbers, dtype="Int64"))
    table.insert(1, "time_s", time)
    table["flag"] = table["flag"].astype("Int64")
    notes = []
    if restarts:
        notes.append(
            f"{path.name}: the seconds of the week begin anew and the week does not change, which "
            "was counted on"
        )
    none = (table["flag"] == 0).to_numpy(dtype=bool)
    if none.any():
        table.loc[none, ["x", "y", "z", "sx", "sy", "sz"]] = np.nan
        notes.append(f"{path.name}: marks without position (flag 0): {int(none.sum())}")
    for flag, many in table["flag"].value_counts().sort_index().items():
        if flag not in (0, _FIXED):
            notes.append(
                f"{path.name}: the on-board position of {many} of {len(table)} marks is not an RTK "
                f"fix: flag {flag}, {status(flag)}; take positions from a processed track"
            )
    order = ["number", "time_s", "x", "y", "z", "sx", "sy", "sz", "flag"]
    order += ["offset_e", "offset_n", "offset_u"]
    return Exposures(table[order], day, "GPST", GEOGRAPHIC, path, notes=tuple(notes))
