"""MicMac's XML: a track (DicoGpsFlottant) or image times (DicoImgsTime).

Times are Modified Julian Days in GPS time: MicMac adds the leap seconds to UTC when it makes
them. The file does not name its coordinates; geocentric ones are known by their size.

Source: MicMac, ParamChantierPhotogram.xml, and its converter from RTKLIB.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from corridor.errors import InputError
from corridor.gnss.epochs import in_order, without_placeholders
from corridor.gnss.exposures import Exposures
from corridor.gnss.formats.modified_julian_day import coarse, is_day, stamp
from corridor.gnss.text import number, sigma
from corridor.gnss.time import on_one_day
from corridor.gnss.track import GEOCENTRIC, Track
from corridor.textfile import read_lines

TITLE = "MicMac XML"


def recognise(head: str) -> bool:
    """Whether the first lines are a track or image times of MicMac."""
    return bool(re.search(r"<(DicoGpsFlottant|OneGpsDGF|DicoImgsTime|CpleImgTime)\b", head))


def read(path: Path) -> Track | Exposures:
    """The track, or the image times; rows in messages count the entries of the file."""
    try:
        root = ElementTree.fromstring("\n".join(read_lines(path)).encode())
    except ElementTree.ParseError as error:
        raise InputError(
            f"{path.name}, row {error.position[0]}: the XML is broken or ends early; write the "
            "file again"
        ) from None
    epochs = list(root.iter("OneGpsDGF"))
    if epochs:
        return _track(path, epochs)
    images = list(root.iter("CpleImgTime"))
    if images:
        return _exposures(path, images)
    raise InputError(f"{path.name} holds no epochs and no image times; write the file again")


def _track(path: Path, epochs) -> Track:
    texts = [_text(epoch, "TimePt", path, k) for k, epoch in enumerate(epochs, 1)]
    stamps = [stamp(text, path, k) for k, text in enumerate(texts, 1)]
    day, time = on_one_day(stamps)
    table = pd.DataFrame(
        [_three(epoch, "Pt", path, k, number) for k, epoch in enumerate(epochs, 1)],
        columns=["x", "y", "z"],
    )
    table.insert(0, "time_s", time)
    sigmas = [
        _three(epoch, "Incertitude", path, k, sigma)
        if epoch.find("Incertitude") is not None
        else [np.nan] * 3
        for k, epoch in enumerate(epochs, 1)
    ]
    if np.isfinite(sigmas).any():
        table[["sx", "sy", "sz"]] = sigmas
    if all(epoch.find("TagPt") is not None for epoch in epochs):
        tags = [_text(epoch, "TagPt", path, k) for k, epoch in enumerate(epochs, 1)]
        table["quality"] = [number(tag, path, k, "TagPt") for k, tag in enumerate(tags, 1)]
    keep, notes = without_placeholders(table, path, "epoch")
    entries = np.arange(1, len(table) + 1)[keep]
    table, copies = in_order(table[keep].reset_index(drop=True), entries, path)
    distance = np.linalg.norm(table[["x", "y", "z"]].to_numpy(), axis=1)
    geocentric = bool(((distance > 6.3e6) & (distance < 6.5e6)).all())
    if not geocentric:
        notes += (
            f"{path.name} does not name its coordinates: they were taken for local metres, east, "
            "north, up",
        )
    _, coarse_notes = coarse(texts, path)
    return Track(
        table,
        day,
        "GPST",
        GEOCENTRIC if geocentric else None,
        path,
        notes=(*notes, *copies, *coarse_notes),
    )


def _exposures(path: Path, images) -> Exposures:
    texts = [_text(image, "TimeIm", path, k) for k, image in enumerate(images, 1)]
    day, time = on_one_day([stamp(text, path, k) for k, text in enumerate(texts, 1)])
    names = [_text(image, "NameIm", path, k) for k, image in enumerate(images, 1)]
    table = pd.DataFrame({"image": pd.Series(names, dtype="str"), "time_s": time})
    resolution, notes = coarse(texts, path)
    return Exposures(table, day, "GPST", None, path, notes=notes, resolution_s=resolution)


def _text(entry, tag: str, path: Path, k: int) -> str:
    found = entry.find(tag)
    text = (found.text or "").strip() if found is not None else ""
    if not text or (tag in ("TimePt", "TimeIm") and not is_day(text)):
        says = f"{tag} = {text!r} is not a Modified Julian Day" if text else f"{tag} is missing"
        raise InputError(f"{path.name}, row {k} of its entries: {says}; write the file again")
    return text


def _three(entry, tag: str, path: Path, k: int, how) -> list[float]:
    parts = _text(entry, tag, path, k).split()
    if len(parts) != 3:
        raise InputError(
            f"{path.name}, row {k} of its entries: {tag} has {len(parts)} numbers, not 3; write "
            "the file again"
        )
    return [how(part, path, k, tag) for part in parts]
