"""EXIF as plain values; None where a tag is missing or makes no sense.

Source: EXIF 2.32 (CIPA DC-008).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date

import numpy as np
from PIL import Image

_MAKE, _MODEL, _ORIENTATION, _XMP = 271, 272, 274, 700
_GPS, _INNER = 0x8825, 0x8769
_EXPOSURE, _FOCAL_MM, _FOCAL_35, _WIDTH, _HEIGHT = 33434, 37386, 41989, 40962, 40963
_AMBIENT, _MAKER_NOTE = 37888, 37500
_PLANE, _PLANE_UNIT, _MM = 41486, 41488, {2: 25.4, 3: 10.0, 4: 1.0}
_ORIGINAL, _ORIGINAL_DECIMALS, _ORIGINAL_ZONE = 36867, 37521, 36881
_CREATED, _CREATED_DECIMALS = 36868, 37522
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


class Exif:
    """The tags of one picture; each property is one fact. Raises what Pillow raises."""

    def __init__(self, picture: Image.Image):
        tags = picture.getexif()
        self._main = dict(tags)
        self._gps, self._inner = dict(tags.get_ifd(_GPS)), dict(tags.get_ifd(_INNER))

    @property
    def xmp(self) -> bytes | str | None:
        """The XMP packet of a TIFF."""
        return self._main.get(_XMP)

    @property
    def make(self) -> str:
        """The camera's maker."""
        return _text(self._main.get(_MAKE))

    @property
    def model(self) -> str:
        """The camera's model."""
        return _text(self._main.get(_MODEL))

    @property
    def orientation(self) -> int:
        """1 to 8; 1: the rows are stored as they are shown."""
        value = _number(self._main.get(_ORIENTATION))
        return int(value) if value in range(1, 9) else 1

    @property
    def exposure_s(self) -> float | None:
        """Time of exposure, s."""
        return _positive(self._inner.get(_EXPOSURE))

    @property
    def focal_mm(self) -> float | None:
        """Focal length, mm."""
        return _positive(self._inner.get(_FOCAL_MM))

    @property
    def focal_35_mm(self) -> float | None:
        """Focal length of the same view on 35 mm film."""
        return _positive(self._inner.get(_FOCAL_35))

    @property
    def pixels_per_mm(self) -> float | None:
        """Pixels a millimetre of the sensor, across."""
        number, unit = _positive(self._inner.get(_PLANE)), self._inner.get(_PLANE_UNIT, 2)
        return number / _MM[unit] if number and unit in _MM else None

    @property
    def written_size(self) -> tuple[int, int] | None:
        """Width and height that the camera wrote, px."""
        size = _positive(self._inner.get(_WIDTH)), _positive(self._inner.get(_HEIGHT))
        return None if None in size else (int(size[0]), int(size[1]))

    @property
    def ambient_c(self) -> float | None:
        """Temperature about the camera."""
        value = _number(self._inner.get(_AMBIENT))
        return value if value is not None and -60 < value < 80 else None

    @property
    def maker_note(self) -> bytes | None:
        """What the maker adds in a form of its own."""
        value = self._inner.get(_MAKER_NOTE)
        return value if isinstance(value, bytes) else None

    @property
    def taken(self) -> Taken | None:
        """The moment of exposure."""
        text = _text(self._inner.get(_ORIGINAL))
        match = _MOMENT.match(text)
        if not match:
            return None
        year, month, day, hour, minute, second = (int(part) for part in match.groups())
        try:
            at = date(year, month, day).isoformat()
        except ValueError:
            at = None
        seconds, decimals = _seconds(
            hour, minute, second, _text(self._inner.get(_ORIGINAL_DECIMALS))
        )
        zone = re.fullmatch(r"[+-]\d{2}:\d{2}", _text(self._inner.get(_ORIGINAL_ZONE)))
        return Taken(match[0], at, seconds, decimals, zone[0] if zone else "")

    @property
    def since_start_s(self) -> float | None:
        """Seconds since the camera was switched on: Parrot writes them as a date of 1970."""
        match = _MOMENT.match(_text(self._inner.get(_CREATED)))
        if not match or not match[0].startswith("1970:01:01 "):
            return None
        clock = (int(part) for part in match.groups()[3:])
        return _seconds(*clock, _text(self._inner.get(_CREATED_DECIMALS)))[0]

    @property
    def position(self) -> tuple[float | None, float | None, float | None]:
        """Latitude, longitude (degrees), height (m)."""
        height = _number(self._gps.get(6))
        if height is not None and self._gps.get(5) in (1, b"\x01", "1"):
            height = -height
        return (
            _degrees(self._gps.get(2), self._gps.get(1), "S"),
            _degrees(self._gps.get(4), self._gps.get(3), "W"),
            height,
        )


def _text(value) -> str:
    return str(value or "").replace("\0", "").strip()


def _number(value) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if np.isfinite(number) else None


def _positive(value) -> float | None:
    number = _number(value)
    return number if number is not None and number > 0 else None


def _degrees(value, reference, negative) -> float | None:
    try:
        d, m, s = (float(part) for part in value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    angle = d + m / 60 + s / 3600
    sign = -1.0 if _text(reference).upper().startswith(negative) else 1.0
    return sign * angle if np.isfinite(angle) else None


def _seconds(hour, minute, second, decimals) -> tuple[float, int]:
    digits = re.match(r"\d*", decimals)[0]
    return 3600.0 * hour + 60.0 * minute + float(f"{second}.{digits or '0'}"), len(digits)
