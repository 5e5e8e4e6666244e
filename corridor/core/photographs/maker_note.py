"""DJI's maker note in EXIF: what the small drones (Mavic Mini and its kin) say nowhere else.

Source: P. Harvey, ExifTool, "DJI Tags" (tags 3 to 11 are single floats).
"""

import struct
from typing import Any

import numpy as np

_FLOAT, _MOST_ENTRIES = 11, 200


def facts_of(note: bytes | None) -> dict[str, Any]:
    """Fields of `Metadata`: velocity (written north, east, down), attitude of the camera, yaw of
    the airframe."""
    tags = _floats_of(note)
    facts: dict[str, Any] = {}
    if {3, 4, 5} <= set(tags):
        facts["velocity"] = tags[4], tags[3], -tags[5]
        facts["velocity_of"] = "tags 3, 4, 5 of DJI's maker note"
    attitude = {"yaw": 10, "pitch": 9, "roll": 11, "flight_yaw": 7}
    return facts | {name: tags.get(tag) for name, tag in attitude.items()}


def _floats_of(note: bytes | None) -> dict[int, float]:
    """Single floats of a maker note by tag; empty where it is no list of tags.

    note: a TIFF directory: count, then twelve bytes an entry. Single floats stand in the entry
    itself, so it does not matter from where the note counts its offsets.
    """
    if not isinstance(note, bytes) or len(note) < 14:
        return {}
    for order in "<>":
        (count,) = struct.unpack_from(f"{order}H", note)
        if not 0 < count <= _MOST_ENTRIES or 2 + 12 * count > len(note):
            continue
        entries = struct.iter_unpack(f"{order}HHI4s", note[2 : 2 + 12 * count])
        found = {
            tag: struct.unpack(f"{order}f", value)[0]
            for tag, kind, many, value in entries
            if (kind, many) == (_FLOAT, 1)
        }
        if found:
            return {tag: value for tag, value in found.items() if np.isfinite(value)}
    return {}
