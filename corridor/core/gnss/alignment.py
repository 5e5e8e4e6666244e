"""How the clock of the exposures gets onto the track's."""

import math
from dataclasses import dataclass

import numpy as np

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.gnss.coordinates import Local
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
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track

# A shift of the clock is believed where the positions then fit this much better.
_CLEARLY_BETTER = 0.3
_CLEARLY_OFF_M = 5.0
# No receiver on a drone logs more slowly: 30 s is the interval of permanent stations.
_SLOWEST_LOG_S = 30.0
# Leap seconds taken for none at all, one too few or too many, or two.
_MISCOUNTS = ((1, 0), (0, 1), (1, -1), (1, 1), (0, 2))
# Positions that differ by so many sigmas contradict each other; where nobody states one, the
# antenna of a receiver without corrections is meant. A camera is some decimetres from its antenna.
_MANY_SIGMAS, _UNSTATED_M, _LEAST_SIGMA_M, _APART_M = 5.0, 3.0, 0.02, 0.6
# A delay below this is the interpolation's; one that leaves more than this share explains little.
_LEAST_DELAY_S, _EXPLAINED, _FEWEST = 0.02, 0.5, 5


@brief
@dataclass(frozen=True)
class Alignment:
    """offset_s: seconds to be added to the exposures' time_s; notes: sentences worth telling."""

    offset_s: float
    notes: tuple[str, ...] = ()


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
    offset += _by_positions(track, exposures, offset, notes)
    return Alignment(offset, tuple(notes))


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
    # Without a date the seconds count from the other's midnight, the start of its week, or 1970.
    dated, bare = (track, exposures) if track.day else (exposures, track)
    sunday = unix = 0.0
    if dated.day:
        sunday = DAY_S * (days_between("1980-01-06", dated.day) % 7)
        unix = DAY_S * days_between("1970-01-01", dated.day)
    origins = ((0.0, f"its day {dated.day}"), (sunday, f"its week {dated.day}"), (unix, "1970"))
    for shift, origin in origins:
        shifted = offset + (-shift if bare is exposures else shift)
        if _inside(track, time + shifted).any():
            if dated.day:
                notes.append(
                    f"{bare.source.name} states no date: its seconds were counted from the start "
                    f"of {origin}"
                )
            return shifted
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


def _by_positions(track: Track, exposures: Exposures, offset: float, notes: list) -> float:
    """Whole seconds by which the exposures' own positions say that leap seconds were miscounted.

    A witness beside the time systems: positions of the exposures lie on the track at their times.
    A difference of all leap seconds is one of stated systems, and refused; a miscount of some is
    put right; another delay is told, for nobody knows where it comes from.
    """
    pair = _in_one_frame(track, exposures)
    if pair is None:
        return 0.0
    where, positions = pair
    leap = float(leap_seconds(track.day or "2017-01-01"))
    at, time = track.table["time_s"].to_numpy(), exposures.table["time_s"].to_numpy() + offset
    if "flight" in track.table and (np.diff(at) < 0).any():
        return 0.0
    known = np.isfinite(positions).all(axis=1) & np.isfinite(time)

    def beside(shift: float) -> tuple[np.ndarray, np.ndarray]:
        """Exposures within the track, and how far (k, 3) their positions lie from it, m."""
        use = known & (time + shift >= at[0]) & (time + shift <= at[-1])
        there = np.column_stack([np.interp(time[use] + shift, at, column) for column in where.T])
        return use, positions[use] - there

    distance = {}
    miscounts = [sign * (leap * all_of + few) for sign in (1, -1) for all_of, few in _MISCOUNTS]
    for shift in (0.0, *miscounts):
        use, off = beside(shift)
        if use.sum() >= max(3, 0.5 * known.sum()):
            distance[shift] = float(np.median(np.linalg.norm(off[:, :2], axis=1)))
    if 0.0 not in distance:
        return 0.0
    sigma = _sigma(track, exposures)
    best = min(distance, key=lambda shift: distance[shift])
    clearly = distance[best] < _CLEARLY_BETTER * distance[0.0]
    if clearly and abs(best) == leap and distance[0.0] - distance[best] > _CLEARLY_OFF_M:
        raise InputError(
            f"{exposures.source.name}: its positions lie {distance[0.0]:.0f} m from "
            f"{track.source.name}, but {distance[best]:.1f} m if the images were taken {leap:g} s "
            f"{'later' if best > 0 else 'earlier'}, so one of the two states UTC and means GPS "
            "time, or the reverse; give the right time system"
        )
    if best and clearly and distance[0.0] > _MANY_SIGMAS * sigma:
        notes.append(
            f"the positions in {exposures.source.name} lie {distance[0.0]:.1f} m from "
            f"{track.source.name}, and {distance[best]:.2f} m if the images were taken "
            f"{abs(best):g} s {'later' if best > 0 else 'earlier'}, which was done: one of the two "
            "was made with another number of leap seconds"
        )
    else:
        best = 0.0
    use, off = beside(best)
    delay, delay_sigma, left = _delay(at, where, time[use] + best, off[:, :2])
    if abs(delay) > max(_MANY_SIGMAS * delay_sigma, _LEAST_DELAY_S):
        notes.append(
            f"the positions in {exposures.source.name} lie where {track.source.name} was "
            f"{abs(delay):.2f} +- {delay_sigma:.2f} s {'later' if delay > 0 else 'earlier'} than "
            "the images' times: is the clock of the images right, or are their positions late?"
        )
    elif left > max(_MANY_SIGMAS * sigma, _APART_M):
        notes.append(
            f"the positions in {exposures.source.name} lie {left:.3g} m (median) from "
            f"{track.source.name}, {left / sigma:.0f} times what both state: is it the track of "
            "this flight?"
        )
    up = float(np.median(off[:, 2]))
    # Heights without a standard deviation may be those of a barometer.
    stated = all("sz" in table for table in (track.table, exposures.table))
    if stated and abs(up) > max(_MANY_SIGMAS * _sigma(track, exposures, ("sz",)), _APART_M):
        notes.append(
            f"the heights in {exposures.source.name} are {abs(up):.1f} m "
            f"{'above' if up > 0 else 'below'} those of {track.source.name} (median): is one of "
            "the two above the geoid, the other above the ellipsoid?"
        )
    return best


def _sigma(track: Track, exposures: Exposures, axes: tuple[str, ...] = ("sx", "sy")) -> float:
    """Standard deviation of a difference of positions, m, by what both files state."""
    every: list[float] = []
    for table in (track.table, exposures.table):
        stated = table[list(axes)].to_numpy(float) if set(axes) <= set(table) else np.zeros(0)
        stated = stated[np.isfinite(stated)]
        every.append(float(np.median(stated)) if len(stated) else _UNSTATED_M)
    return max(math.hypot(*every), _LEAST_SIGMA_M)


def _delay(at, where, time, off) -> tuple[float, float, float]:
    """By how much later the track was where positions are, s; its sigma; what it leaves, m."""
    speed = np.column_stack(
        [np.interp(time, at, np.gradient(column, at)) for column in where.T[:2]]
    )
    square = float(np.sum(speed**2))
    if len(time) < _FEWEST or not square > 0:
        return 0.0, np.inf, float(np.median(np.linalg.norm(off, axis=1)))
    delay = float(np.sum(speed * off)) / square
    left = off - delay * speed
    # Robust: positions that jump once are no delay.
    sigma = 1.4826 * float(np.median(np.abs(left))) / np.sqrt(square)
    distance = float(np.median(np.linalg.norm(off, axis=1)))
    explained = np.linalg.norm(left) < _EXPLAINED * np.linalg.norm(off)
    return (delay, sigma, distance) if explained else (0.0, np.inf, distance)


def _in_one_frame(track: Track, exposures: Exposures):
    """Track and exposure positions, (n, 3) and (m, 3) local metres; None: not comparable."""
    if not {"x", "y", "z"} <= set(exposures.table):
        return None
    positions = exposures.table[["x", "y", "z"]].to_numpy(dtype=float, copy=True)
    placed = track.crs is not None or track.origin is not None
    if exposures.crs is None:
        return None if placed else (track.positions(), positions)
    known = np.isfinite(positions).all(axis=1)
    if not placed or not known.any() or exposures.crs not in (GEOGRAPHIC, GEOCENTRIC):
        return None
    local = Local.about(track)
    positions[known] = local.from_crs(positions[known], exposures.crs)
    return local.to_local(track).positions(), positions
