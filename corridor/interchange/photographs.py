"""What photographs say of themselves: time, position, attitude, temperature, gyroscope.

EXIF through Pillow, XMP as XML. Positions of DJI's XMP have more digits than EXIF's; older drones
misspell longitude (`GpsLongtitude`). RTK flags: 50 fixed, 32 to 49 float, 16 single, 0 none. Times
come from the readers of corridor.gnss (EXIF, or DJI's .MRK where one lies in the folder).

Source: EXIF 2.32 (CIPA DC-008); DJI's and Parrot's developer documents; Pix4D, "Specifications of
xmp.camera tags".
"""

from __future__ import annotations

import base64
import binascii
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from PIL import Image, UnidentifiedImageError

from corridor.errors import InputError

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png")

_GPS, _EXIF = 0x8825, 0x8769
_AMBIENT, _CREATED, _CREATED_DECIMALS = 37888, 36868, 37522
_FOCAL_MM, _FOCAL_35 = 37386, 41989
# Names of a temperature of the camera, as makers write them, the nearest to the lens first.
_TEMPERATURES = (
    "LensTemperature", "SensorTemperature", "ImagerTemperatureC", "CameraTemperature",
    "DetectorTemperature",
)  # fmt: skip
_GYRO = np.dtype([("us", "<u8"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("flag", "<i4")])
# Where a maker gives no standard deviation: of a code receiver, of a float and a fixed solution.
_ASSUMED = {50: (0.03, 0.03, 0.06), 34: (0.5, 0.5, 1.0), 16: (3.0, 3.0, 6.0)}


@dataclass(frozen=True)
class Photograph:
    """One photograph's header; None where it does not say.

    lat_deg, lon_deg (WGS 84), height (m, as written: of the ellipsoid or the sea). sigma: east,
    north, up, m. flag: DJI's quality. yaw, pitch, roll: degrees of the gimbal or the camera, as
    written. temperature_c and what it is of. gyro: samples us, x, y, z (rad/s, axes of the maker);
    created_s: seconds since start at the first row. line_ns: time of a row as the header says.
    velocity: east, north, up, m/s. tags: every XMP entry as text.
    """

    path: Path
    width: int
    height_px: int
    make: str = ""
    model: str = ""
    orientation: int = 1
    focal_mm: float | None = None
    focal_35_mm: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    height: float | None = None
    sigma: tuple[float, float, float] | None = None
    flag: int | None = None
    yaw: float | None = None
    pitch: float | None = None
    roll: float | None = None
    temperature_c: float | None = None
    temperature_of: str = ""
    line_ns: float | None = None
    velocity: tuple[float, float, float] | None = None
    created_s: float | None = None
    gyro: np.ndarray | None = None
    tags: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """File name."""
        return self.path.name


def photographs_in(folder: Path) -> list[Path]:
    """Photographs of a folder and the folders in it, in order. Raises InputError without any."""
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; name the folder of the photographs")
    found = sorted(
        file
        for file in folder.rglob("*")
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
    )
    if not found:
        raise InputError(f"{folder} holds no photograph ({', '.join(SUFFIXES)}); name another")
    return found


def read_photograph(path: Path) -> Photograph:
    """What the header of a photograph says. Raises InputError where it cannot be read."""
    try:
        with Image.open(path) as picture:
            size = picture.size
            exif = picture.getexif()
            main = dict(exif)
            gps, inner = dict(exif.get_ifd(_GPS)), dict(exif.get_ifd(_EXIF))
            packet = picture.info.get("xmp") or main.get(700)
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path.name} cannot be read as a photograph ({type(error).__name__}); take it out of "
            "the folder"
        ) from None
    tags = _xmp(packet) if packet else {}
    lat, lon, height = _position(gps, tags)
    flag = _number(tags, "RtkFlag")
    temperature, of = _temperature(tags, inner)
    return Photograph(
        path=path,
        width=size[0],
        height_px=size[1],
        make=_text(main.get(271)),
        model=_text(main.get(272)),
        orientation=int(main.get(274, 1) or 1),
        focal_mm=_ratio(inner.get(_FOCAL_MM)),
        focal_35_mm=_ratio(inner.get(_FOCAL_35)),
        lat_deg=lat,
        lon_deg=lon,
        height=height,
        sigma=_sigma(tags),
        flag=int(flag) if flag is not None else None,
        yaw=_first(tags, "GimbalYawDegree", "Yaw"),
        pitch=_first(tags, "GimbalPitchDegree", "Pitch"),
        roll=_first(tags, "GimbalRollDegree", "Roll"),
        temperature_c=temperature,
        temperature_of=of,
        line_ns=_number(tags, "LineReadoutTime"),
        velocity=_velocity(tags),
        created_s=_since_start(inner),
        gyro=_gyro(tags),
        tags=tags,
    )


def _text(value) -> str:
    return str(value or "").replace("\0", "").strip()


def _ratio(value) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if np.isfinite(number) and number > 0 else None


def _xmp(packet: bytes | str) -> dict[str, str]:
    """Attributes and elements of an XMP packet by their local name; the first of a name counts."""
    data = packet.encode() if isinstance(packet, str) else bytes(packet)
    start, end = data.find(b"<x:xmpmeta"), data.rfind(b"</x:xmpmeta>")
    if start < 0 or end < 0 or b"<!ENTITY" in data:
        return {}
    try:
        root = ElementTree.fromstring(data[start : end + len(b"</x:xmpmeta>")])
    except (ElementTree.ParseError, ValueError, LookupError):
        return {}
    tags: dict[str, str] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            tags.setdefault(key.rpartition("}")[2], value)
        text = (element.text or "").strip()
        if text:
            tags.setdefault(element.tag.rpartition("}")[2], text)
    return tags


def _number(tags: dict[str, str], name: str) -> float | None:
    try:
        value = float(tags[name])
    except (KeyError, ValueError):
        return None
    return value if np.isfinite(value) else None


def _first(tags: dict[str, str], *names: str) -> float | None:
    return next((value for name in names if (value := _number(tags, name)) is not None), None)


def _degrees(value, reference, negative) -> float | None:
    try:
        d, m, s = (float(part) for part in value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    angle = d + m / 60 + s / 3600
    sign = -1.0 if _text(reference).upper().startswith(negative) else 1.0
    return sign * angle if np.isfinite(angle) else None


def _position(gps, tags):
    lat = _first(tags, "GpsLatitude", "Latitude")
    lon = _first(tags, "GpsLongitude", "GpsLongtitude", "Longitude", "Longtitude")
    height = _number(tags, "AbsoluteAltitude")
    if lat is None or lon is None:
        lat = _degrees(gps.get(2), gps.get(1), "S")
        lon = _degrees(gps.get(4), gps.get(3), "W")
    if height is None:
        try:
            height = float(gps[6])
        except (KeyError, TypeError, ValueError, ZeroDivisionError):
            height = None
        below = gps.get(5)
        if height is not None and below in (1, b"\x01", "1"):
            height = -height
    if lat is None or lon is None or abs(lat) > 90 or abs(lon) > 180 or (lat, lon) == (0.0, 0.0):
        return None, None, None
    return lat, lon, height


def _sigma(tags):
    found = [_number(tags, key) for key in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")]
    if all(value is not None and value > 0 for value in found):
        return tuple(found)
    plan, up = _number(tags, "GPSXYAccuracy"), _number(tags, "GPSZAccuracy")
    return (plan, plan, up) if plan and up and min(plan, up) > 0 else None


def _temperature(tags, inner):
    for name in _TEMPERATURES:
        value = _number(tags, name)
        if value is not None and -60 < value < 150:
            return value, name
    try:
        value = float(inner[_AMBIENT])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None, ""
    return (value, "AmbientTemperature") if -60 < value < 80 else (None, "")


def _velocity(tags):
    words = tags.get("IMULinearVelocity", "").replace(",", " ").split()
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        return None
    return found if len(found) == 3 and np.isfinite(found).all() else None


def _since_start(inner) -> float | None:
    """Parrot writes seconds since its start as a date of 1970."""
    match = re.match(r"1970:01:01 (\d\d):(\d\d):(\d\d)", _text(inner.get(_CREATED)))
    if not match:
        return None
    hour, minute, second = (int(part) for part in match.groups())
    digits = re.match(r"\d*", _text(inner.get(_CREATED_DECIMALS)))[0]
    return 3600.0 * hour + 60.0 * minute + float(f"{second}.{digits or '0'}")


def _gyro(tags) -> np.ndarray | None:
    """Parrot's IMUAngularVelocity: base64 of 24-byte samples at 1 kHz."""
    text = tags.get("IMUAngularVelocity", "")
    if not text:
        return None
    try:
        data = base64.b64decode("".join(text.split()), validate=True)
    except (binascii.Error, ValueError):
        return None
    if not data or len(data) % _GYRO.itemsize:
        return None
    samples = np.frombuffer(data, _GYRO)
    rates = np.column_stack([samples[axis] for axis in "xyz"])
    rising = (np.diff(samples["us"].astype(np.int64)) > 0).all()
    return samples if np.isfinite(rates).all() and rising else None


def gyro_rates(photo: Photograph, time_s: float | None) -> pd.DataFrame | None:
    """rates.csv of one photograph: time_s, wx, wy, wz (rad/s, camera frame), image.

    time_s: of the middle row, on the block's clock; None: seconds since the camera's start.
    Parrot's axes are x forward, y right, z down; the top of the picture is forward: wx = y,
    wy = -x, wz = z. The first row lies IMUTimeOffset after the first sample. None without samples.
    """
    if photo.gyro is None:
        return None
    sample = photo.gyro["us"].astype(float) * 1e-6
    first_row = sample[0] + (_number(photo.tags, "IMUTimeOffset") or 0.0) * 1e-9
    middle = first_row + (photo.line_ns or 0.0) * 1e-9 * (photo.height_px - 1) / 2
    shift = 0.0 if time_s is None else time_s - middle
    x, y, z = (photo.gyro[axis].astype(float) for axis in "xyz")
    return pd.DataFrame({"time_s": sample + shift, "wx": y, "wy": -x, "wz": z, "image": photo.name})


def positions_of(photos: list[Photograph], notes: list[str]) -> pd.DataFrame:
    """image, lon, lat, height, sx, sy, sz (m) of the photographs that have a position.

    Where the maker states no sigma, that of the kind of solution is assumed, and said.
    """
    rows, assumed, without = [], 0, 0
    for photo in photos:
        if photo.lat_deg is None:
            continue
        without += photo.height is None
        sigma = photo.sigma
        if sigma is None:
            assumed += 1
            flag = photo.flag if photo.flag is not None else 16
            kind = 50 if flag == 50 else 34 if 32 <= flag <= 49 else 16
            sigma = _ASSUMED[kind]
        rows.append((photo.name, photo.lon_deg, photo.lat_deg, photo.height or 0.0, *sigma))
    if assumed:
        notes.append(
            f"{assumed} of {len(rows)} positions come without a standard deviation: 3 m in plan "
            "and 6 m in height were assumed where no RTK flag says better"
        )
    if without:
        notes.append(f"{without} positions have no height: 0 was taken")
    return pd.DataFrame(rows, columns=["image", "lon", "lat", "height", "sx", "sy", "sz"])
