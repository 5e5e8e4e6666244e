"""Readout times that others have published, by camera: a prior, and a check of a measurement.

The table beside this package, `published_readout_times.csv`, holds 1,223 of them with method and
source. They count all rows (rows times row time); `readout_ms` of `Readout` runs from the first
to the last. Modes of one camera differ by factors and sources by 5 to 10 per cent.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

_TABLE = "published_readout_times.csv"
_FAR = 0.2  # of the nearest published value: further off is worth a word


@dataclass(frozen=True)
class PublishedReadout:
    """One published readout time, all rows, milliseconds; sigma_ms None where there is none."""

    make: str
    model: str
    mode: str
    readout_ms: float
    sigma_ms: float | None
    method: str
    source: str


@lru_cache(maxsize=1)
def published_table() -> tuple[PublishedReadout, ...]:
    """All published readout times."""
    text = (files("corridor.photographs") / _TABLE).read_text(encoding="utf-8")
    return tuple(
        PublishedReadout(
            row["make"],
            row["model"],
            row["mode"],
            float(row["readout_ms"]),
            float(row["sigma_ms"]) if row["sigma_ms"] else None,
            row["method"],
            row["source"],
        )
        for row in csv.DictReader(text.splitlines())
    )


def published_readouts(camera: str) -> list[PublishedReadout]:
    """Published readout times of the cameras whose make and model contain every word of a name.

    camera: as EXIF or a person writes it ("Hasselblad L1D-20c", "mavic 2 pro"); case, blanks
    and dashes do not matter.
    """
    words = [_plain(word) for word in re.split(r"[\s,]+", camera) if _plain(word)]
    if not words:
        return []
    found = []
    for row in published_table():
        whole = _plain(f"{row.make}{row.model}{row.mode}")
        if all(word in whole for word in words):
            found.append(row)
    return found


def compared(make: str, model: str, readout_ms: float) -> tuple[list[PublishedReadout], str | None]:
    """Published values of the camera that took a photograph, and a warning where all are far.

    make, model: from EXIF; empty: nothing is known.
    """
    if not model:
        return [], None
    wanted = _plain(model)
    found = [
        row
        for row in published_table()
        if _plain(row.model) == wanted
        and (not make or _plain(row.make) in _plain(make) or _plain(make) in _plain(row.make))
    ]
    if not found:
        return [], None
    nearest = min(found, key=lambda row: abs(row.readout_ms / readout_ms - 1))
    if abs(nearest.readout_ms / readout_ms - 1) <= _FAR:
        return found, None
    return found, (
        f"the nearest published readout time of a {model} is {nearest.readout_ms:g} ms "
        f"({nearest.mode or 'mode not stated'}; {nearest.source}): check speed, picture size and "
        "mode"
    )


def _plain(text):
    return re.sub(r"[^a-z0-9]+", "", text.lower())
