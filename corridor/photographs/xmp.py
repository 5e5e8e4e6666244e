"""XMP as the makers of drones write it.

Positions of DJI's XMP have more digits than EXIF's; older drones misspell longitude
(`GpsLongtitude`). RTK flags: 50 fixed, 32 to 49 float, 16 single, 0 none.

Source: DJI's and Parrot's developer documents; Pix4D, "Specifications of xmp.camera tags".
"""

from __future__ import annotations

import base64
import binascii
from xml.etree import ElementTree

import numpy as np

# Names of a temperature of the camera, as makers write them, the nearest to the lens first.
_TEMPERATURES = (
    "LensTemperature", "SensorTemperature", "ImagerTemperatureC", "CameraTemperature",
    "DetectorTemperature",
)  # fmt: skip
_GYRO = np.dtype([("us", "<u8"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("flag", "<i4")])


def tags_of(packet: bytes | str | None) -> dict[str, str]:
    """Attributes and elements of an XMP packet by their local name; the first of a name counts."""
    data = packet.encode() if isinstance(packet, str) else bytes(packet or b"")
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


def number(tags: dict[str, str], *names: str) -> float | None:
    """The first finite number among tags of these names."""
    for name in names:
        try:
            value = float(tags[name])
        except (KeyError, ValueError):
            continue
        if np.isfinite(value):
            return value
    return None


def position(tags: dict[str, str]) -> tuple[float | None, float | None, float | None]:
    """Latitude, longitude (degrees), height (m)."""
    return (
        number(tags, "GpsLatitude", "Latitude"),
        number(tags, "GpsLongitude", "GpsLongtitude", "Longitude", "Longtitude"),
        number(tags, "AbsoluteAltitude"),
    )


def sigma(tags: dict[str, str]) -> tuple[float, float, float] | None:
    """Standard deviations of the position: east, north, up, m."""
    found = tuple(number(tags, key) for key in ("RtkStdLon", "RtkStdLat", "RtkStdHgt"))
    if None not in found and min(found) > 0:
        return found
    plan, up = number(tags, "GPSXYAccuracy"), number(tags, "GPSZAccuracy")
    return (plan, plan, up) if plan and up and min(plan, up) > 0 else None


def attitude(tags: dict[str, str]) -> tuple[float | None, float | None, float | None]:
    """Yaw, pitch, roll of the gimbal or the camera, degrees as written."""
    return tuple(number(tags, f"Gimbal{name}Degree", name) for name in ("Yaw", "Pitch", "Roll"))


def temperature(tags: dict[str, str]) -> tuple[float | None, str]:
    """Temperature of the camera, degrees Celsius, and the tag that says so."""
    for name in _TEMPERATURES:
        value = number(tags, name)
        if value is not None and -60 < value < 150:
            return value, name
    return None, ""


def velocity(tags: dict[str, str]) -> tuple[tuple[float, float, float] | None, str]:
    """East, north, up, m/s, and the tags that say so."""
    words = tags.get("IMULinearVelocity", "").replace(",", " ").split()
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if len(found) == 3 and np.isfinite(found).all():
        return found, "IMULinearVelocity"
    # DJI since the Phantom 4: north, east, down, to a tenth.
    north, east, down = (number(tags, f"Flight{axis}Speed") for axis in "XYZ")
    if None in (north, east, down):
        return None, ""
    return (east, north, -down), "FlightXSpeed, FlightYSpeed, FlightZSpeed"


def gyroscope(tags: dict[str, str]) -> np.ndarray | None:
    """Parrot's IMUAngularVelocity, base64 of 24-byte samples at 1 kHz: us, x, y, z (rad/s)."""
    text = tags.get("IMUAngularVelocity", "")
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
