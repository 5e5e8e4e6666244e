"""How the clock of the exposures gets onto the track's."""

from dataclasses import dataclass

import numpy as np

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.time import (
    DAY_S,
    WEEK_S,
    ahead_of_utc,
    clock,
    days_between,
    in_words,
    leap_seconds,
    time_system,
)
from corridor.core.gnss.track import Track
from corridor.core.gnss.witnesses import miscount

# No receiver on a drone logs more slowly: 30 s is the interval of permanent stations.
_SLOWEST_LOG_S = 30.0


@brief
@dataclass(frozen=True)
class Alignment:
    """offset_s: seconds to be added to the exposures' time_s; notes: sentences worth telling;
    delay_s: by how much later still the track was where the exposures' own positions are."""

    offset_s: float
    notes: tuple[str, ...] = ()
    delay_s: float = 0.0


def align(
    track: Track,
    exposures: Exposures,
    track_system: str | None = None,
    exposures_system: str | None = None,
) -> Alignment:
    """How the exposures' clock becomes the track's, from days and time systems alone.

    No clock is stretched. track_system, exposures_system: the system that a file does not state, or
    states wrongly. Tables of a block state none: they share one clock. Where exposures have
    positions, a clock that is wrong by leap seconds shows in them.
    Raises InputError where the systems are not known, where track and exposures do not overlap,
    or where positions say that one clock is wrong by the leap seconds.
    """
    time = exposures.table["time_s"].to_numpy()
    if not np.isfinite(time).any():
        raise InputError(
            f"{exposures.source.name} states no times; name a file of the images' times"
        )
    time = time[np.isfinite(time)]
    systems = [
        time_system(told) if told else stated
        for told, stated in (
            (track_system, track.time_system),
            (exposures_system, exposures.time_system),
        )
    ]
    bare = systems == [None, None] and track.day is None and exposures.day is None
    notes: list[str] = []
    offset = 0.0 if bare else _offset(track, exposures, systems, time, notes)
    _check_overlap(track, exposures, systems, time + offset, bare, notes)
    seconds, delay = miscount(track, exposures, offset, notes)
    return Alignment(offset + seconds, tuple(notes), delay)


def _offset(track, exposures, systems, time, notes) -> float:
    for of, other, system, opposite, option in (
        (track, exposures, systems[0], systems[1], "--track-system"),
        (exposures, track, systems[1], systems[0], "--images-system"),
    ):
        if system is None:
            than = f"{other.source.name} is in {opposite}" if opposite else "nor does the other"
            raise InputError(
                f"{of.source.name} does not say in which time system its times are ({than}); give "
                f"{option} with GPST, UTC, or UTC+hh:mm for a clock that shows a zone's time"
            )
    day = track.day or exposures.day or "2017-01-01"
    offset = ahead_of_utc(systems[0], day) - ahead_of_utc(systems[1], day)
    if systems[0] != systems[1]:
        verb = "added to" if offset >= 0 else "taken off"
        notes.append(
            f"{track.source.name} is in {systems[0]} and {exposures.source.name} in {systems[1]}: "
            f"{in_words(offset)} {verb} the images' times"
        )
    if track.day and exposures.day:
        return offset + DAY_S * days_between(track.day, exposures.day)
    # Without a date the seconds count from the other's midnight, its week's start, 1970 or 1980.
    dated, bare = (track, exposures) if track.day else (exposures, track)
    sunday = unix = gps = 0.0
    if dated.day:
        gps = DAY_S * days_between("1980-01-06", dated.day)
        sunday = DAY_S * (days_between("1980-01-06", dated.day) % 7)
        unix = DAY_S * days_between("1970-01-01", dated.day)
    origins = (
        (0.0, f"its day {dated.day}"), (sunday, f"its week {dated.day}"), (unix, "1970"),
        (gps, "6 January 1980"),
    )  # fmt: skip
    for shift, origin in origins:
        shifted = offset + (-shift if bare is exposures else shift)
        if _inside(track, time + shifted).any():
            if dated.day:
                notes.append(
                    f"{bare.source.name} states no date: its seconds were counted from the start "
                    f"of {origin}"
                )
            return shifted
        if bare is exposures and _inside(track, time / 1000 + shifted).any():
            raise InputError(f"{bare.source.name} has its times in milliseconds; write seconds")
    return offset


def _inside(track: Track, time: np.ndarray) -> np.ndarray:
    return (time >= track.start) & (time <= track.end)


def _check_overlap(track, exposures, systems, time, bare, notes) -> None:
    inside = _inside(track, time)
    apart = float(np.median(np.diff(track.table["time_s"]))) if len(track.table) > 1 else 0.0
    if bare and apart > _SLOWEST_LOG_S:
        raise InputError(
            f"{track.source.name}: its epochs are {apart:g} s (median) apart, between which no "
            "flight can be interpolated: is time_s in milliseconds? Write seconds"
        )
    if inside.all():
        return
    leap = float(leap_seconds(track.day or "2017-01-01"))
    images, name = exposures.source.name, track.source.name
    # Whole flights may be missing from a track; half a flight is not missing by chance.
    if inside.any() and not (bare and _met(exposures, inside) < 0.5):
        outside = np.maximum(track.start - time, time - track.end).max()
        note = (
            f"{int((~inside).sum())} of {len(time)} images lie outside {name}, by up to "
            f"{max(outside, 0.001):.6g} s"
        )
        fits = [shift for shift in (leap, -leap) if _inside(track, time + shift).all()]
        if fits:
            note += (
                f"; {leap:g} s {'later' if fits[0] > 0 else 'earlier'} all would lie inside: one "
                "of the two may be in UTC, the other in GPS time"
            )
        notes.append(note)
        return
    spans = [
        f"{clock(low)} to {clock(high)}{f' {system}' if system else ''}"
        for low, high, system in (
            (time.min(), time.max(), systems[0]),
            (track.start, track.end, systems[0]),
        )
    ]
    if bare:
        raise InputError(
            f"{images} ({time.min():.3f} to {time.max():.3f} s) and {name} ({track.start:.3f} to "
            f"{track.end:.3f} s) have no common clock: {int(inside.sum())} of {len(time)} images "
            "lie within the track; write time_s of both on the same clock"
        )
    cause = _cause(track, time, leap)
    raise InputError(
        f"{images} ({spans[0]}) and {name} ({spans[1]}) do not overlap in time{cause}; name the "
        "track of this flight, or give the right time systems"
    )


def _met(exposures: Exposures, inside: np.ndarray) -> float:
    """Share of the images inside, among those of flights that have any inside."""
    if "flight" not in exposures.table:
        return float(inside.mean())
    timed = np.isfinite(exposures.table["time_s"].to_numpy())
    flight = exposures.table["flight"].to_numpy()[timed]
    return float(inside[np.isin(flight, np.unique(flight[inside].astype(str)))].mean())


def _cause(track: Track, time: np.ndarray, leap: float) -> str:
    """Which usual mistake would explain that nothing overlaps."""
    hours = [sign * half * 1800.0 for half in range(1, 29) for sign in (1, -1)]
    days = [sign * n * DAY_S for n in range(1, 8) for sign in (1, -1)]
    named = [
        *[(shift, "UTC is taken for GPS time, or the reverse") for shift in (leap, -leap)],
        *[(shift, "one of the clocks shows a zone's time") for shift in hours],
        *[(shift + s * leap, "one of the clocks shows a zone's time, and UTC is taken for GPS time")
          for shift in hours for s in (1, -1)],
        *[(shift, "it is another day") for shift in days],
        *[(s * 1024 * WEEK_S, "GPS weeks are counted modulo 1024") for s in (1, -1, 2, -2)],
    ]  # fmt: skip
    share = [_inside(track, time + shift).mean() for shift, _ in named]
    best = int(np.argmax(share))
    if share[best] < 0.5:
        return ""
    shift, why = named[best]
    return f"; {in_words(shift)} {'later' if shift > 0 else 'earlier'} they would: {why}"
