"""EXIF as fields of `Metadata`; what is missing or makes no sense is left out.

Source: EXIF 2.32 (CIPA DC-008).
"""

import re
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np
from PIL import Image

_GPS, _INNER = 0x8825, 0x8769
_PLANE_UNIT, _MM = 41488, {2: 25.4, 3: 10.0, 4: 1.0}
_MOMENT = re.compile(r"(\d{4})[:/-](\d{2})[:/-](\d{2})[ T](\d{2}):(\d{2}):(\d{2})")


@dataclass(frozen=True)
class Taken:
    """When a photograph was taken, by the camera's own clock.

    text: as written. day: "2024-06-24", None where the calendar has no such day. seconds: of the
    day. decimals: how many it has ("05" is 0.05 s, "5" is 0.5 s). zone: "+07:00", or "" where the
    zone of the clock is not told.
    """

    text: str
    day: str | None
    seconds: float
    decimals: int
    zone: str


def facts_of(picture: Image.Image) -> tuple[dict[str, Any], bytes | None, bytes | str | None]:
    """Fields of `Metadata`, the maker's note, and the XMP packet that a TIFF keeps in its tags.

    Raises what Pillow raises.
    """
    tags = picture.getexif()
    gps, inner = dict(tags.get_ifd(_GPS)), dict(tags.get_ifd(_INNER))
    orientation, ambient = _number(tags.get(274)), _number(inner.get(37888))
    per_mm, unit = _positive(inner.get(41486)), _MM.get(inner.get(_PLANE_UNIT, 2))
    wide, high = _positive(inner.get(40962)), _positive(inner.get(40963))
    height = _number(gps.get(6))
    # 1: below the sea; of EXIF 3.0, which knows the ellipsoid, 3 as well.
    if height is not None and gps.get(5) in (1, 3, b"\x01", b"\x03", "1", "3"):
        height = -height
    facts = {
        "make": _text(tags.get(271)),
        "model": _text(tags.get(272)),
        "orientation": next((k for k in range(1, 9) if k == orientation), 1),
        "exposure_s": _positive(inner.get(33434)),
        "focal_mm": _positive(inner.get(37386)),
        "focal_35_mm": _positive(inner.get(41989)),
        "pixels_per_mm": per_mm / unit if per_mm and unit else None,
        "written_size": (int(wide), int(high)) if wide and high else None,
        "serial": _text(inner.get(42033)),
        "taken": _taken(*(_text(inner.get(tag)) for tag in (36867, 37521, 36881))),
        "height": height,
    }
    if ambient is not None and -60 < ambient < 80:
        facts |= {"temperature_c": ambient, "temperature_of": "AmbientTemperature"}
    lat, lon = _degrees(gps.get(2), gps.get(1), "NS"), _degrees(gps.get(4), gps.get(3), "EW")
    if lat is not None and lon is not None:
        facts |= {"lat_deg": lat, "lon_deg": lon}
    note = inner.get(37500)
    return facts, note if isinstance(note, bytes) else None, tags.get(700)


def _taken(moment: str, decimals: str, zone: str) -> Taken | None:
    match = _MOMENT.match(moment)
    if not match:
        return None
    year, month, day, hour, minute, second = (int(part) for part in match.groups())
    try:
        at = date(year, month, day).isoformat()
    except ValueError:
        at = None
    digits = re.sub(r"\D.*", "", decimals, flags=re.DOTALL)
    seconds = 3600.0 * hour + 60.0 * minute + float(f"{second}.{digits or '0'}")
    zone = zone if re.fullmatch(r"[+-]\d{2}:\d{2}", zone) else ""
    return Taken(match[0], at, seconds, len(digits), zone)


def _text(value) -> str:
    # Text ends at the first zero; what some cameras leave behind it is none.
    value = value.decode("latin-1") if isinstance(value, bytes) else value
    return str(value or "").partition("\0")[0].strip()


def _number(value) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if np.isfinite(number) else None


def _positive(value) -> float | None:
    number = _number(value)
    return number if number is not None and number > 0 else None


def _degrees(value, reference, sides) -> float | None:
    """Signed degrees; None also where nobody says on which side of the equator or of Greenwich:
    a survey in the other hemisphere would be mirrored."""
    try:
        d, m, s = (float(part) for part in value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    angle = d + m / 60 + s / 3600
    side = _text(reference).upper()[:1]
    known = side in tuple(sides) or angle < 0
    return (-angle if side == sides[1] else angle) if np.isfinite(angle) and known else None
