"""Tables of a block: track.csv (time_s, x, y, z, ...) and images.csv (image, time_s, ...).

Both count time_s on one clock, whose time system and day are not stated, and are in the local
metres of the block.
"""

import re
from pathlib import Path

import pandas as pd

from corridor.core.block import LAYOUTS, SIGMAS, Layout, place, read_columns, row_numbers
from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.track import Track

TITLE = "track.csv (time_s, x, y, z) or images.csv (image, time_s) of a block"

_TRACK = LAYOUTS["track"]
_EXPOSURES = Layout(("image", "time_s"), optional=("x", "y", "z", "flight"), empty=("time_s",))


def recognise(head: str) -> bool:
    """Whether the header line has the needed columns, but for one that may be misspelt."""
    names = set(re.split(r"\s*[,;\t]\s*", head.splitlines()[0].strip())) if head else set()
    return (
        len(names & set(_TRACK.needed)) >= 3
        or {"image", "time_s"} <= names
        or ("image" in names and ("camera" in names or "x" in names))
    )


def read(path: Path) -> Track | Exposures:
    """The track, or the exposures: whichever the header says."""
    if path.suffix == ".parquet":
        names = read_columns(path, Layout(())).columns
    else:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            names = re.split(r"\s*[,;\t]\s*", file.readline().strip())
    layout = _EXPOSURES if "image" in names else _TRACK
    frame = read_columns(path, layout)
    if not len(frame):
        raise InputError(f"{path.name} holds no rows below its header; write the file again")
    for name in layout.needed:
        unknown = frame[name].isna().to_numpy()
        if unknown.any() and name not in layout.empty:
            raise InputError(
                f"{place(path, int(unknown.argmax()))}: {name} is empty; fill it in or delete the "
                "row"
            )
    for name in set(SIGMAS) & set(frame):
        wrong = (frame[name] <= 0).to_numpy()
        if wrong.any():
            row = int(wrong.argmax())
            raise InputError(
                f"{place(path, row)}: {name} = {frame[name].iloc[row]:g} is not a standard "
                "deviation; write a positive number or leave the cell empty"
            )
    frame = frame[[name for name in layout.listed if name in frame]]
    if "flight" in frame:
        frame["flight"] = frame["flight"].fillna("").astype("str")
    return _track(path, frame) if layout is _TRACK else _exposures(path, frame)


def _track(path: Path, frame: pd.DataFrame) -> Track:
    last = [name for name in frame if name == "flight"]
    frame = frame[[*frame.columns.drop(last), *last]]
    return Track.of_rows(frame, row_numbers(path, len(frame)), path)


def _exposures(path: Path, frame: pd.DataFrame) -> Exposures:
    twice = frame["image"].duplicated().to_numpy()
    if twice.any():
        row = int(twice.argmax())
        raise InputError(
            f"{place(path, row)}: image {frame['image'].iloc[row]} occurs twice; give each its name"
        )
    if not {"x", "y", "z"} <= set(frame):
        frame = frame[[name for name in frame if name not in "xyz"]]
    unknown = frame["time_s"].isna().to_numpy()
    if unknown.all():
        raise InputError(f"{path.name}: no image has a time; fill the column time_s")
    notes: tuple[str, ...] = ()
    if unknown.any():
        notes = (
            f"{path.name}: {int(unknown.sum())} of {len(frame)} images have no time_s (first in "
            f"{place(path, int(unknown.argmax())).rpartition(', ')[2]})",
        )
    return Exposures(frame, None, None, None, path, notes=notes)
