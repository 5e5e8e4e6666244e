"""Times of photographs, from their EXIF.

`DateTimeOriginal` has whole seconds; `SubSecTimeOriginal` is a string of decimals ("05" is 0.05 s,
"5" is 0.5 s). The camera's clock shows a zone's time, which `OffsetTimeOriginal` names; where it
is missing the time system is not known.

Source: EXIF 2.32 (CIPA DC-008), tags 36867, 37521, 36881.
"""

import re
from pathlib import Path

import pandas as pd
from PIL import Image, UnidentifiedImageError

from corridor.errors import InputError
from corridor.gnss.exposures import Exposures
from corridor.gnss.time import day_of, on_one_day, time_system

_EXIF, _ORIGINAL, _DECIMALS, _ZONE = 0x8769, 36867, 37521, 36881
_SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png")
_TIME = re.compile(r"(\d{4})[:/-](\d{2})[:/-](\d{2})[ T](\d{2}):(\d{2}):(\d{2})")


def read(folder: Path) -> Exposures:
    """Times of all photographs in a folder, in order of their names.

    Raises InputError where there is none, or one has no time, or zones differ.
    """
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in _SUFFIXES)
    if not files:
        raise InputError(
            f"{folder.name} holds neither images.csv nor photographs; name the folder or file of "
            "the images"
        )
    stamps, zones, decimals = [], [], []
    for file in files:
        stamp, digits, zone = _time(file)
        stamps.append(stamp)
        zones.append(zone)
        decimals.append(digits)
    for file, zone in zip(files, zones, strict=True):
        if zone != zones[0]:
            raise InputError(
                f"{file.name}: its clock shows {zone or 'an unnamed zone'}, that of "
                f"{files[0].name} {zones[0] or 'an unnamed zone'}; read the images apart"
            )
    day, time = on_one_day(stamps)
    table = pd.DataFrame({"image": pd.Series([f.name for f in files], dtype="str"), "time_s": time})
    notes = ["the times are those of the camera's clock (EXIF), which nothing ties to GNSS"]
    most = max(decimals)
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


def _time(file: Path) -> tuple[tuple[str, float], int, str | None]:
    """Day and seconds of the day, how many decimals they have, the time system or None."""
    try:
        with Image.open(file) as picture:
            tags = picture.getexif().get_ifd(_EXIF)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        raise InputError(
            f"{file.name} cannot be read as a photograph; take it out of the folder"
        ) from None
    match = _TIME.match(str(tags.get(_ORIGINAL, "")).strip())
    if not match:
        raise InputError(
            f"{file.name} has no time of exposure in its EXIF (DateTimeOriginal); take it out of "
            "the folder, or give the times in a file"
        )
    try:
        year, month, date, hour, minute, second = (int(part) for part in match.groups())
        day = day_of(year, month, date)
    except ValueError:
        raise InputError(
            f"{file.name}: {match[0]!r} in its EXIF is no date; give the times in a file"
        ) from None
    digits = re.match(r"\d*", str(tags.get(_DECIMALS, "")).strip())[0]
    seconds = 3600.0 * hour + 60.0 * minute + float(f"{second}.{digits or '0'}")
    zone = re.fullmatch(r"[+-]\d{2}:\d{2}", str(tags.get(_ZONE, "")).strip(" \0"))
    return (day, seconds), len(digits), time_system(f"UTC{zone[0]}") if zone else None
