"""Times as Modified Julian Days, as MicMac writes them: text, or its XML.

Text: `IMAGE DAY` for images, `DAY X Y Z QUALITY` for a track; its time system is not part of the
form, a comment line may name it (`# GPST`). XML: a track (DicoGpsFlottant) or image times
(DicoImgsTime), in GPS time: MicMac adds the leap seconds to UTC when it makes them. Neither names
its coordinates; geocentric ones are known by their size.

Six printed decimals are steps of 86 ms: a time is off by up to 43 ms, half a metre at 11 m/s.

Source: MicMac, ParamChantierPhotogram.xml, its converter from RTKLIB, and its text exports.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.text import TextRows
from corridor.core.gnss.time import DAY_S, mjd_day, on_one_day
from corridor.core.gnss.track import GEOCENTRIC, POSITION, Track
from corridor.core.textfile import Xml, read_lines

TITLE = "MicMac XML, Modified Julian Days"

_XML = re.compile(r"<(DicoGpsFlottant|OneGpsDGF|DicoImgsTime|CpleImgTime)\b")
# 1968 to 2132
_DAY = re.compile(r"[4-9]\d{4}(?:\.\d*)?")
_SYSTEM = re.compile(r"\b(GPST|UTC(?:[+-]\d{1,2}:\d{2})?|JST|TAI|BDT)\b")
_SIGMAS = ["sx", "sy", "sz"]
_FINE_S = 2e-3


def recognise(head: str) -> bool:
    """Whether it is MicMac's XML, or the first row a name and a day, or a day and a position."""
    if _XML.search(head):
        return True
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith("#"))
    first = next(lines, "").split()
    if len(first) == 2:
        return _is_day(first[1]) and "." in first[1]
    return len(first) in (4, 5) and _is_day(first[0]) and "." in first[0]


def read(path: Path) -> Track | Exposures:
    """The image times, or the track, with a note on what the printed decimals cost."""
    lines = read_lines(path)
    if _XML.search("\n".join(lines)):
        return _of_xml("\n".join(lines), path)
    named = {match[1] for line in lines if line.startswith("#") for match in _SYSTEM.finditer(line)}
    system = named.pop() if len(named) == 1 else None
    rows = TextRows.of_lines(path, lines, skip=("#",))
    width = len(rows.fields[0])
    rows.expect(width, "the first row", "correct or delete the row")
    if width == 2:
        return _exposures(rows, system)
    return _track(rows, system, ["x", "y", "z", "quality"][: width - 1])


def _of_xml(text: str, path: Path) -> Track | Exposures:
    """Rows in messages count the entries of the file."""
    root = Xml.parse(text.encode(), path).element
    epochs, images = (list(root.iter(tag)) for tag in ("OneGpsDGF", "CpleImgTime"))
    if epochs:
        parts, names = [("TimePt", 1), ("Pt", 3)], [*POSITION]
        if any(epoch.find("Incertitude") is not None for epoch in epochs):
            parts.append(("Incertitude", 3))
            names += _SIGMAS
        if all(epoch.find("TagPt") is not None for epoch in epochs):
            parts.append(("TagPt", 1))
            names.append("quality")
        return _track(_entries(epochs, parts, path), "GPST", names)
    if images:
        return _exposures(_entries(images, [("NameIm", 0), ("TimeIm", 1)], path), "GPST")
    raise InputError(f"{path.name} holds no epochs and no image times; write the file again")


def _entries(entries, parts, path) -> TextRows:
    """The words of the elements of each entry; parts: of tag and how many (0: a name)."""
    rows = TextRows(path, ((at, []) for at in range(1, len(entries) + 1)), " of its entries")
    for k, (entry, fields) in enumerate(zip(entries, rows.fields, strict=True)):
        for tag, count in parts:
            text = (entry.findtext(tag) or "").strip()
            if tag == "Incertitude" and entry.find(tag) is None:
                text = "nan nan nan"
            if not text:
                raise rows.wrong(k, f"{tag} is missing; write the file again")
            words = text.split() if count else [text]
            if count and len(words) != count:
                raise rows.wrong(
                    k, f"{tag} has {len(words)} numbers, not {count}; write the file again"
                )
            fields += words
    return rows


def _exposures(rows: TextRows, system: str | None) -> Exposures:
    day, time, resolution, notes = _times(rows, 1)
    table = pd.DataFrame({"image": pd.Series(rows.texts(0), dtype="str"), "time_s": time})
    return Exposures(table, day, system, None, rows.path, notes=notes, resolution_s=resolution)


def _track(rows: TextRows, system: str | None, names: list[str]) -> Track:
    day, time, resolution, coarse = _times(rows, 0)
    table = pd.DataFrame({"time_s": time})
    for field, name in enumerate(names, 1):
        table[name] = (rows.sigmas if name in _SIGMAS else rows.numbers)(field, name)
    if set(_SIGMAS) <= set(table) and not np.isfinite(table[_SIGMAS]).any(axis=None):
        table = table.drop(columns=_SIGMAS)
    empty, notes, name = (table[POSITION] == 0).all(axis=1).to_numpy(), [], rows.path.name
    if empty.any():
        count = int(empty.sum())
        notes.append(f"{name}: {count} epoch{'s' * (count > 1)} at 0 0 0 left out: no position")
    table, at = table[~empty].reset_index(drop=True), rows.at[~empty]
    if resolution:
        _check_apart(table, at, resolution, rows.path)
    distance = np.linalg.norm(table[POSITION].to_numpy(), axis=1)
    geocentric = bool(((distance > 6.3e6) & (distance < 6.5e6)).all())
    if not geocentric:
        notes.append(
            f"{name} does not name its coordinates: they were taken for local metres, east, "
            "north, up"
        )
    crs = GEOCENTRIC if geocentric else None
    track = Track.of_rows(table, at, rows.path, day, system, crs, notes)
    return replace(track, notes=(*track.notes, *coarse))


def _is_day(text: str) -> bool:
    """Whether a text is a Modified Julian Day between 1968 and 2132."""
    return bool(_DAY.fullmatch(text))


def _times(rows: TextRows, field: int) -> tuple[str, list[float], float | None, tuple[str, ...]]:
    """Day, seconds of it, and where the printed days are coarse, their step (s) and a note."""
    texts = rows.texts(field)
    for k, text in enumerate(texts):
        if not _is_day(text):
            raise rows.wrong(
                k,
                f"{text!r} is not a Modified Julian Day, as 57552.628579273; correct or delete the "
                "row",
            )
    day, time = on_one_day([mjd_day(text) for text in texts])
    decimals = max(len(text.partition(".")[2]) for text in texts)
    step = DAY_S * 10.0**-decimals
    if step < _FINE_S:
        return day, time, None, ()
    count = {1: "one decimal", 0: "no decimals"}.get(decimals, f"{decimals} decimals")
    size = f"{step / 2 * 1e3:.0f} ms" if step < 2 else f"{step / 2:.3g} s"
    note = (
        f"{rows.path.name}: Modified Julian Days with {count} are off by up to {size}; write nine "
        "decimals"
    )
    return day, time, step, (note,)


def _check_apart(table: pd.DataFrame, rows: np.ndarray, step: float, path: Path) -> None:
    """Raise InputError where epochs fall on one printed time, which is too coarse for them."""
    same = (np.diff(table["time_s"]) == 0) & (np.diff(table["x"]) != 0)
    if same.any():
        raise InputError(
            f"{path.name}, row {rows[int(np.argmax(same)) + 1]}: two epochs have one printed time, "
            f"because its decimals are steps of {step * 1e3:.0f} ms; write nine decimals of the "
            "Modified Julian Day"
        )
