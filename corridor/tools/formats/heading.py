"""To where photographs point: which of the yaws in their metadata counts from north.

Large drones write the yaw of the gimbal from north, small ones from the airframe's nose, beside the
yaw of the flight from north. One photograph cannot tell which; all photographs of a flight can.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from corridor.core.gnss import Local
from corridor.core.photographs import Metadata
from corridor.core.preparation import AGREES, CONTRADICTS, UNCHECKED, Witness

# This near counts as the same direction; so many must be the same, of so many or more.
NEAR_DEG, AGREEING_SHARE, LEAST_PHOTOS = 30.0, 0.8, 4
# A way between photographs that is shorter than a position's error has no direction.
_LEAST_WAY_M = 5.0


class Headings(NamedTuple):
    """yaw: (n,) degrees from north over east to where the top of each picture points; NaN where
    nothing reliable says so. source: what it was made of; empty where that could not be decided.
    witnesses: what else says where the photographs point.
    """

    yaw: np.ndarray
    source: str
    witnesses: tuple[Witness, ...]


def headings(photos: Sequence[Metadata], seen: np.ndarray | None = None) -> Headings:
    """The yaw of each photograph of a flight, decided from all of them.

    seen: (n,) yaws that the mapped poses have, up to one turn of the whole; asked only where the
    metadata contradict each other.
    """
    gimbal = _degrees(photos, "yaw")
    # Looking straight down, a gimbal may state the half turn as roll.
    roll = _degrees(photos, "roll")
    gimbal = np.where(np.abs(roll) > 90, gimbal + 180, gimbal)
    body, course = _degrees(photos, "flight_yaw"), _courses(photos)
    from_nose = body + gimbal
    if _many(gimbal) and _many(body):
        if _alike(gimbal, body):
            seen_so = Witness(
                "FlightYawDegree", AGREES, f"the same to {_off(gimbal, body)} degrees"
            )
            return Headings(gimbal, "the yaw of the gimbal", (seen_so, _way(gimbal, course)))
        if _alike(gimbal, np.zeros(len(gimbal))):
            told = (
                f"within {_off(gimbal, 0 * gimbal)} degrees of zero while the flight's yaw turns: "
                "it counts from the airframe's nose"
            )
            seen_so = Witness("GimbalYawDegree", AGREES, told)
            source = "the yaw of the flight and the gimbal's against it"
            return Headings(from_nose, source, (seen_so, _way(from_nose, course)))
        told = f"it differs from the gimbal's by {_off(gimbal, body)} degrees"
        against = Witness("FlightYawDegree", CONTRADICTS, told)
        said = {"the yaw of the gimbal": gimbal, "the yaw of the flight": body,
                "the yaw of the flight and the gimbal's against it": from_nose}  # fmt: skip
        for source, yaw in said.items():
            if seen is not None and _turned_as_one(seen, yaw):
                mapped = Witness("the mapped poses", AGREES, "they turn as these do")
                return Headings(yaw, source, (against, mapped))
        return Headings(np.full(len(photos), np.nan), "", (against,))
    source, yaw = ("the yaw of the flight", body) if _many(body) else ("the yaw", gimbal)
    way = _way(yaw, course)
    known = course[np.isfinite(course)]
    one_way = len(known) < LEAST_PHOTOS or _alike(known, np.full(len(known), known[0]))
    other_way = not one_way or seen is not None and not _turned_as_one(seen, yaw)
    if way.says != AGREES and _many(gimbal) and _alike(gimbal, 0 * gimbal) and other_way:
        # All near zero on strips to and fro: from the nose, with nothing that says where that is.
        return Headings(np.full(len(photos), np.nan), "", (way,))
    return Headings(yaw, source if _many(yaw) else "", (way,) if _many(yaw) else ())


def wrapped(angle):
    """Into -180 to 180 degrees."""
    return (angle + 180) % 360 - 180


def turn_of(off: np.ndarray) -> float:
    """The median on the circle, of differences (n,) of two yaws in degrees, modulo 180."""
    tried = off[:: max(len(off) // 300, 1)]
    away = np.abs(wrapped(2 * (off[:, None] - tried)))
    return float(tried[np.argmin(away.sum(axis=0))])


def _degrees(photos, fact):
    return np.array([np.nan if (v := getattr(p, fact)) is None else v for p in photos], dtype=float)


def _many(yaw):
    return bool(np.isfinite(yaw).sum() >= LEAST_PHOTOS)


def _off(one, other):
    """The difference that four in five photographs stay below, in whole degrees."""
    return f"{np.nanpercentile(np.abs(wrapped(one - other)), 100 * AGREEING_SHARE):.0f}"


def _alike(one, other):
    off = np.abs(wrapped(one - other))
    known = np.isfinite(off)
    return bool(known.sum() >= LEAST_PHOTOS and (off[known] < NEAR_DEG).mean() >= AGREEING_SHARE)


def _turned_as_one(seen, yaw):
    """Whether two yaws differ by one turn of the whole, with no photograph the other way round."""
    off = (seen - yaw)[np.isfinite(seen - yaw)]
    if len(off) < LEAST_PHOTOS:
        return False
    turn = turn_of(off)
    return any(_alike(off, np.full(len(off), turn + half)) for half in (0, 180))


def east_north(photos: Sequence[Metadata]) -> np.ndarray:
    """Where photographs were taken (n, 2), m east and north of their middle."""
    spots = np.array([[photo.lon_deg, photo.lat_deg, 0.0] for photo in photos])
    lon, lat, _ = np.median(spots, axis=0)
    return Local(float(lat), float(lon), 0.0).from_geographic(spots)[:, :2]


def _courses(photos):
    """Degrees from north over east of the way from each photograph's neighbours, NaN where short.

    Photographs in the order of their times; without times, of their names.
    """
    course = np.full(len(photos), np.nan)
    placed = [k for k, photo in enumerate(photos) if photo.lat_deg is not None]
    if len(placed) < 3:
        return course
    moment = {
        k: (p.taken.day or "", p.taken.seconds) if p.taken else ("", 0.0)
        for k, p in enumerate(photos)
    }
    placed.sort(key=lambda k: (moment[k], photos[k].name))
    step = np.diff(east_north([photos[k] for k in placed]), axis=0)
    long = np.linalg.norm(step, axis=1) > _LEAST_WAY_M
    way = np.degrees(np.arctan2(step[:, 0], step[:, 1]))
    # Where a strip ends, the ways before and after differ: neither is the drone's.
    for k in range(1, len(placed) - 1):
        before, after = k - 1, k
        if long[before] and long[after] and abs(wrapped(way[after] - way[before])) < NEAR_DEG:
            course[placed[k]] = way[after]
    return course


def _way(yaw, course):
    """What the course over ground says of yaws: a drone may fly sideways, but rarely all along."""
    known = np.isfinite(yaw) & np.isfinite(course)
    source = "the course over ground"
    if known.sum() < LEAST_PHOTOS:
        return Witness(source, UNCHECKED, "too few photographs lie on straight strips")
    if _alike(yaw, course):
        return Witness(source, AGREES, f"the same to {_off(yaw, course)} degrees")
    return Witness(
        source, UNCHECKED, f"it differs by {_off(yaw, course)} degrees: flown sideways or backwards"
    )
