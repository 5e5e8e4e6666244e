"""Tracks and moments of exposure from files of any format.

A module of the folder `formats` that has `recognise(head)` is a format: it tells its files by their
first lines, and `read(path)` returns a Track or Exposures.
"""

import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss import formats as folder
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.formats import block_table, exif, pospac
from corridor.core.gnss.track import Track
from corridor.core.textfile import disguised, read_lines

_HEAD_LINES = 80
_EVENTS = re.compile(r"(?i)(^|[_\-. ])events?\.(pos|txt)(\.gz)?$")
# What files of receivers say at their head that are no positions yet.
_RAW = {
    "OBSERVATION DATA": "a receiver's observations (RINEX)",
    "NAVIGATION DATA": "orbits of satellites (RINEX)",
    "GNSS NAV DATA": "orbits of satellites (RINEX)",
    "COMPACT RINEX": "a receiver's observations (RINEX, packed)",
    # Binary ones begin so.
    "\xb5b": "a receiver's raw data (u-blox UBX)",
    "$@": "a receiver's raw data (Septentrio SBF)",
    "\xd3\0": "a receiver's raw data (RTCM)",
}
# Of what was no receiver's; of a binary log its first two characters are looked at.
_NONE = {
    r"^UL$": "the log of a drone (ULog)",
    r"<gpx\b|<kml\b": "a track for maps, without standard deviations",
    r"(?m)^\d+\s*\n\d\d:\d\d:\d\d,\d+ -->": "the subtitles of a drone's video",
    r"(?i)\bOSD\.|CUSTOM\.date|height_above_takeoff": "the log of a drone's flight",
}
_NMEA = re.compile(r"(?m)^\$[A-Z]{4,5},")
_WAY_ON = "as the track.csv of a block (time_s, x, y, z, sx, sy, sz in metres), and name that"
_SBET = (
    "a trajectory of POSPac, but neither whole records of an SBET nor text with TIME, LATITUDE, "
    f"LONGITUDE, ROLL, PITCH and HEADING: export it so, or write its columns {_WAY_ON}"
)


def read_track(path: str | Path) -> Track:
    """The track in a file; the format is told by the content.

    RTKLIB and CSRS-PPP .pos, GrafNav text, POSPac text and SBET (with attitudes), MicMac XML or
    text, track.csv (.parquet) of a block. A folder: the track.csv in it. Text may be packed (.gz).
    Raises InputError, one sentence naming file, row and remedy.
    """
    path = Path(path)
    if path.is_dir():
        table = _table_in(path, "track")
        if table is None:
            raise InputError(f"{path.name} holds no track.csv; name the file of the track")
        path = table
    track = _read(path)
    if not isinstance(track, Track):
        raise InputError(f"{path.name} holds image times, not a track; name the file of the track")
    return track


def read_exposures(path: str | Path) -> Exposures:
    """Moments of exposure in a file; the format is told by the content.

    DJI .MRK, RTKLIB's NAME_events.pos (positions at the exposures, numbered from 1), MicMac XML or
    text, Modified Julian Days, images.csv (.parquet) of a block. A
    folder: images.csv in it, else the EXIF of the photographs in it.
    Raises InputError, one sentence naming file, row and remedy.
    """
    path = Path(path)
    if path.is_dir():
        table = _table_in(path, "images")
        if table is None:
            return exif.read(path)
        path = table
    exposures = _read(path)
    if isinstance(exposures, Exposures):
        return exposures
    if not _EVENTS.search(path.name):
        raise InputError(
            f"{path.name} holds a track, not image times; name the file of the images (RTKLIB's "
            "positions at the exposures end in _events.pos)"
        )
    return _of_events(exposures)


def _of_events(track: Track) -> Exposures:
    """Exposures from a processing program's positions at the events of a camera, from 1 on."""
    columns = [c for c in ("time_s", "x", "y", "z", "sx", "sy", "sz") if c in track.table]
    table = track.table[columns].copy()
    table.insert(0, "number", pd.array(np.arange(len(table)) + 1, dtype="Int64"))
    return Exposures(
        table, track.day, track.time_system, track.crs, track.source, track.notes, counted=True
    )


def _formats() -> list:
    """The modules of the folder `formats` that are formats of text files."""
    found = [import_module(f"{folder.__name__}.{i.name}") for i in iter_modules(folder.__path__)]
    return [module for module in found if hasattr(module, "recognise")]


def _read(path: Path) -> Track | Exposures:
    """What is in a file of any format.

    Raises InputError where no format recognises it.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist; correct the path")
    if path.suffix == ".parquet":
        return block_table.read(path)
    if other := disguised(path):
        raise InputError(f"{path.name} is {other}")
    if pospac.is_sbet(path):
        return pospac.read_sbet(path)
    if path.suffix.lower() in (".out", ".sbet") and "sbet" in path.name.lower():
        raise InputError(f"{path.name} is {_SBET}")
    with path.open("rb") as file:
        start = file.read(2).decode("latin-1")
    head = start if start in (*_RAW, "UL") else "\n".join(read_lines(path)[:_HEAD_LINES])
    if not head.strip():
        raise InputError(f"{path.name} is empty; write the file again")
    for module in _formats():
        if module.recognise(head):
            return module.read(path)
    told = {**_RAW, **dict.fromkeys(_NMEA.findall(head), "a receiver's messages (NMEA)")}
    for sign, what in told.items():
        if sign in head:
            raise InputError(
                f"{path.name} holds {what}, no positions; process it (RTKLIB, Emlid Studio, "
                "GrafNav) and give the result, such as a .pos and its _events.pos"
            )
    for sign, what in _NONE.items():
        if re.search(sign, head):
            raise InputError(
                f"{path.name} is {what}: its positions are too coarse for a survey. Give the "
                "track of the GNSS receiver, or let the photographs' own positions do (--photos)"
            )
    points = re.sub(r"(?<=\d),(?=\d)", ".", head)
    named = next((module for module in _formats() if module.recognise(points)), None)
    if named is not None:
        raise InputError(
            f"{path.name} looks like {named.TITLE}, with decimal commas; write numbers with a "
            "decimal point, or export it again"
        )
    if "POSPAC" in head.upper() or "SBET" in head.upper():
        raise InputError(f"{path.name} is {_SBET}")
    titles = ", ".join(module.TITLE for module in _formats())
    raise InputError(
        f"{path.name} is in no format that is known, or its header is missing; give "
        f"{titles}; write the columns of another program {_WAY_ON}"
    )


def _table_in(folder: Path, name: str) -> Path | None:
    """The file of a table in a block folder."""
    files = (folder / f"{name}{suffix}" for suffix in (".csv", ".parquet"))
    return next((file for file in files if file.is_file()), None)
