"""XMP as the makers of drones write it.

Positions of DJI's XMP have more digits than EXIF's; older drones misspell longitude
(`GpsLongtitude`). RTK flags: 50 fixed, 32 to 49 float, 16 single, 0 none.

Source: DJI's and Parrot's developer documents; Pix4D, "Specifications of xmp.camera tags".
"""

import base64
import binascii
from typing import Any
from xml.etree import ElementTree

import numpy as np

# Names of a temperature of the camera, as makers write them, the nearest to the lens first.
_TEMPERATURES = (
    "LensTemperature", "SensorTemperature", "ImagerTemperatureC", "CameraTemperature",
    "DetectorTemperature",
)  # fmt: skip
# What tells one drone from another, the drone before its camera.
_SERIALS = ("DroneSerialNumber", "DroneID", "CameraSerialNumber", "SerialNumber")
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


def facts_of(tags: dict[str, str]) -> dict[str, Any]:
    """Fields of `Metadata`; what the tags do not say is left out."""
    flag, rtk = number(tags, "RtkFlag"), _numbers(tags, "RtkStdLon", "RtkStdLat", "RtkStdHgt")
    facts = {
        "height": number(tags, "AbsoluteAltitude"),
        "flag": None if flag is None else int(flag),
        "line_ns": number(tags, "LineReadoutTime"),
        "flight_yaw": number(tags, "FlightYawDegree"),
        "serial": next((tags[name] for name in _SERIALS if tags.get(name)), None),
        "gyro": _gyroscope(tags),
    }
    lat = number(tags, "GpsLatitude", "Latitude")
    lon = number(tags, "GpsLongitude", "GpsLongtitude", "Longitude", "Longtitude")
    if lat is not None and lon is not None:
        facts |= {"lat_deg": lat, "lon_deg": lon}
    # Standard deviations: east, north, up, m.
    plan, up = _numbers(tags, "GPSXYAccuracy", "GPSZAccuracy")
    for sigma in (rtk, (plan, plan, up)):
        if "sigma" not in facts and None not in sigma and min(sigma) > 0:
            facts["sigma"] = sigma
    yaw, pitch, roll = (
        number(tags, f"Gimbal{name}Degree", name) for name in ("Yaw", "Pitch", "Roll")
    )
    if yaw is not None:
        facts |= {"yaw": yaw, "pitch": pitch, "roll": roll}
    for name in _TEMPERATURES:
        value = number(tags, name)
        if "temperature_c" not in facts and value is not None and -60 < value < 150:
            facts |= {"temperature_c": value, "temperature_of": name}
    return facts | _velocity(tags)


def _numbers(tags, *names):
    return tuple(number(tags, name) for name in names)


def _velocity(tags):
    """East, north, up, m/s, and the tags that say so."""
    words = tags.get("IMULinearVelocity", "").replace(",", " ").split()
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if len(found) == 3 and np.isfinite(found).all():
        return {"velocity": found, "velocity_of": "IMULinearVelocity"}
    # DJI since the Phantom 4: north, east, down, to a tenth.
    north, east, down = _numbers(tags, *(f"Flight{axis}Speed" for axis in "XYZ"))
    if None in (north, east, down):
        return {}
    said = "FlightXSpeed, FlightYSpeed, FlightZSpeed"
    return {"velocity": (east, north, -down), "velocity_of": said}


def _gyroscope(tags):
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
