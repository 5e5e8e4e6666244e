"""CSRS-PPP's solution, .pos: one epoch a row, in GPS time, with what holds of 95 %.

Names of the columns stand in a row that begins with DIR; rows of the solution begin with FWD or
BWD, its direction, of which the backward one knows the whole flight.

Source: CSRS-PPP user guide, "Output files" (Natural Resources Canada).
"""

import re
from pathlib import Path

import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss.text import TextRows
from corridor.core.gnss.time import day_of, on_one_day, seconds_of_clock
from corridor.core.gnss.track import GEOGRAPHIC, Track
from corridor.core.textfile import read_lines

TITLE = "CSRS-PPP .pos"

_HEADER = re.compile(r"DIR\s+FRAME\b.*\bLATDD\b")
_QUANTILE = 1.96  # standard deviations of 95 %
_SIGMAS = {"sx": "SDLON(95%)", "sy": "SDLAT(95%)", "sz": "SDHGT(95%)"}


def recognise(head: str) -> bool:
    """Whether the row of names is among the first lines."""
    return any(map(_HEADER.match, head.splitlines()))


def read(path: Path) -> Track:
    """The track in a .pos. Raises InputError naming file and row."""
    lines = read_lines(path)
    at = next(k for k, line in enumerate(lines) if _HEADER.match(line))
    names = {name.partition("SS.")[0]: k for k, name in enumerate(lines[at].split())}
    needed = ["FRAME", "YEAR-MM-DD", "HR:MN:", "LATDD", "LONDD", "HGT(m)", *_SIGMAS.values()]
    lacking = [name for name in needed if name not in names]
    if lacking:
        raise InputError(f"{path.name} has no column {', '.join(lacking)}; fetch the file again")
    way = "BWD" if any(line.startswith("BWD") for line in lines) else "FWD"
    kept = [line if line.startswith(way) else "" for line in lines]
    rows = TextRows.of_lines(path, kept, at + 1)
    if not len(rows):
        raise InputError(f"{path.name} holds no epochs; process the flight again as kinematic")
    remedy = "delete the row, or fetch the file again if it is cut off"
    rows.expect(names["HGT(m)"] + 1, "the header", remedy, more=True)
    day, time = on_one_day([_stamp(rows, k, names) for k in range(len(rows))])
    table = pd.DataFrame({"time_s": time})
    for axis, name in (("x", "LONDD"), ("y", "LATDD")):
        table[axis] = rows.degrees(names[name], names[name] + 3, name)
    table["z"] = rows.numbers(names["HGT(m)"], "HGT(m)")
    for axis, name in _SIGMAS.items():
        table[axis] = rows.sigmas(names[name], name) / _QUANTILE
    frame, notes = rows.fields[0][names["FRAME"]], []
    if not frame.startswith(("ITRF", "IGS", "IGb")):
        notes.append(f"{path.name} is in {frame}, which lies up to some metres from WGS 84")
    order = table["time_s"].argsort(kind="stable")
    table = table.iloc[order].reset_index(drop=True)
    return Track.of_rows(table, rows.at[order], path, day, "GPST", GEOGRAPHIC, notes)


def _stamp(rows: TextRows, k: int, names: dict[str, int]) -> tuple[str, float]:
    """Day and seconds of it of a row."""
    date, clock = (rows.fields[k][names[name]] for name in ("YEAR-MM-DD", "HR:MN:"))
    seconds = seconds_of_clock(clock)
    try:
        day = day_of(*map(int, date.split("-")))
    except (ValueError, TypeError):
        day = ""
    if not day or seconds is None:
        raise rows.wrong(k, f"{date} {clock} is not a time; correct or delete the row")
    return day, seconds
