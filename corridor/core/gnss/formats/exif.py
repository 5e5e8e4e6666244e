"""Times of photographs, from their EXIF.

`DateTimeOriginal` has whole seconds; `SubSecTimeOriginal` is a string of decimals ("05" is 0.05 s,
"5" is 0.5 s). The camera's clock shows a zone's time, which `OffsetTimeOriginal` names; where it
is missing the time system is not known.

Source: EXIF 2.32 (CIPA DC-008), tags 36867, 37521, 36881.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.time import on_one_day, time_system
from corridor.core.gnss.track import GEOGRAPHIC

if TYPE_CHECKING:
    from corridor.core.photographs import Metadata, Taken


def read(folder: Path) -> Exposures:
    """Times of all photographs in a folder, in order of their names, and where they were taken.

    Raises InputError where there is none, or one has no time, or zones differ.
    """
    # It needs Pillow, which a track does not.
    from corridor.core.photographs import photographs_in, read_metadata

    photos = [read_metadata(file) for file in photographs_in(folder)]
    found = of_photographs(folder, photos)
    places = np.array([[one.lon_deg, one.lat_deg, one.height or 0] for one in photos], dtype=float)
    if np.isnan(places[:, :2]).all():
        return found
    table = found.table.assign(**dict(zip("xyz", places.T, strict=True)))
    return replace(found, table=table, crs=GEOGRAPHIC)


def of_photographs(folder: Path, photos: Sequence[Metadata]) -> Exposures:
    """Times of photographs of a folder, as `read`."""
    files, taken = [photo.path for photo in photos], [_taken(photo) for photo in photos]
    zones = [time_system(f"UTC{one.zone}") if one.zone else None for one in taken]
    for file, zone in zip(files, zones, strict=True):
        if zone != zones[0]:
            raise InputError(
                f"{file.name}: its clock shows {zone or 'an unnamed zone'}, that of "
                f"{files[0].name} {zones[0] or 'an unnamed zone'}; read the images of each camera "
                "separately"
            )
    day, time = on_one_day([(one.day or "", one.seconds) for one in taken])
    table = pd.DataFrame({"image": pd.Series(names_in(folder, files), dtype="str"), "time_s": time})
    notes = ["the times are those of the camera's clock (EXIF), which nothing ties to GNSS"]
    most = max(one.decimals for one in taken)
    resolution = 10.0**-most
    if most < 3:
        notes.append(
            f"the times of {folder.name} are printed to {resolution:g} s, so each is off by up to "
            f"{resolution:g} s"
            + ("" if most else ": whole seconds are too coarse to interpolate a track")
        )
    return Exposures(
        table, day, zones[0], None, folder, notes=tuple(notes),
        resolution_s=resolution if most < 3 else None,
    )  # fmt: skip


def names_in(folder: Path, files: list[Path]) -> list[str]:
    """Names of photographs of a folder: with the folders below it, where files are named alike."""
    names = [file.name for file in files]
    if len(set(names)) == len(names):
        return names
    return [file.relative_to(folder).as_posix() for file in files]


def _taken(photo: Metadata) -> Taken:
    taken = photo.taken
    if taken is None:
        raise InputError(
            f"{photo.name} has no time of exposure in its EXIF (DateTimeOriginal); take it out of "
            "the folder, or give the times in a file"
        )
    if taken.day is None:
        raise InputError(
            f"{photo.name}: {taken.text!r} in its EXIF is not a date; give the times in a file"
        )
    return taken
