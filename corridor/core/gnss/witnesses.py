"""What the exposures' own positions say of the track and of the clocks: a witness beside both.

Positions that a camera's receiver wrote lie on the track at their times, less the way from the
antenna to the camera where the file states it.
"""

import math
from dataclasses import replace

import numpy as np

from corridor.core.errors import InputError, some
from corridor.core.geometry import robust_scale
from corridor.core.gnss.coordinates import Local
from corridor.core.gnss.exposures import Exposures
from corridor.core.gnss.interpolation import Interpolated
from corridor.core.gnss.interpolation.polynomials import CURVES
from corridor.core.gnss.time import ahead_of_utc, leap_seconds
from corridor.core.gnss.track import GEOCENTRIC, GEOGRAPHIC, Track

# A shift of the clock is believed where the positions then fit this much better.
_CLEARLY_BETTER = 0.3
_CLEARLY_OFF_M = 5.0
# Positions that lie so far from a track are of another place.
_ELSEWHERE_M = 1000.0
# One or two leap seconds too few or too many, beside all of them or none.
_MISCOUNTS = (-2.0, -1.0, 1.0, 2.0)
# Clocks that are taken for each other: their differences are whole seconds, below a minute.
_CLOCKS = ("UTC", "GPST", "BDT", "TAI")
_LONGEST_S, _SEARCH_S = 60.0, 0.25
# Positions that differ by so many sigmas contradict each other; where nobody states one, the
# antenna of a receiver without corrections is meant. A camera is some decimetres from its antenna.
_MANY_SIGMAS, _UNSTATED_M, _LEAST_SIGMA_M, _APART_M = 5.0, 3.0, 0.02, 0.6
# A delay below this is the interpolation's; one that leaves more than this share explains little.
_LEAST_DELAY_S, _EXPLAINED, _FEWEST = 0.02, 0.5, 5
_ROWS = (1, -1, 2, -2)  # by which the rows of a table may have slipped
_STANDS_M_S, _PASSES = 0.5, 30
_TRIED = 200  # moments at which a clock may have jumped
_FIXED = 50  # DJI's flag of a fix


class _Beside:
    """Positions of exposures beside a track: local metres, the exposures' clock as aligned so far.

    at, where: of the epochs; time, own: (m,), (m, 3) of the exposures, NaN where unknown.
    """

    def __init__(self, track: Track, exposures: Exposures, offset: float, where, own):
        self.at, self.where = track.table["time_s"].to_numpy(), where
        self.time, self.own = exposures.table["time_s"].to_numpy() + offset, own
        self.known = np.isfinite(own).all(axis=1) & np.isfinite(self.time)
        self.speed = (
            np.gradient(where[:, :2], self.at, axis=0) if len(self.at) > 1 else where[:, :2]
        )

    def off(self, shift: float, rows: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) within the track, and how far (k, 3) the positions lie from it, m.

        rows: by which the positions stand too high in their table.
        """
        own = np.roll(self.own, -rows, axis=0)
        time = self.time + shift
        use = self.known & np.roll(self.known, -rows) & (time >= self.at[0]) & (time <= self.at[-1])
        if rows:
            use[-rows if rows > 0 else 0 : None if rows > 0 else -rows] = False
        there = [np.interp(time[use], self.at, column) for column in self.where.T]
        return time[use], own[use] - np.column_stack(there)

    def distance(self, shift: float, rows: int = 0) -> float:
        """Median horizontal distance from the track, m; inf where too few lie beside it."""
        time, off = self.off(shift, rows)
        if len(time) < max(3, 0.5 * self.known.sum()):
            return math.inf
        return float(np.median(np.linalg.norm(off[:, :2], axis=1)))

    def delay(self, shift: float) -> tuple[float, float, float]:
        """By how much later still the track was where positions are, s; its sigma; what is left, m.

        Infinitely unsure where a delay does not explain how far they lie apart.
        """
        time, off = self.off(shift)
        off = off[:, :2]
        distance = float(np.median(np.linalg.norm(off, axis=1)))
        speed = np.column_stack([np.interp(time, self.at, column) for column in self.speed.T])
        square = float(np.sum(speed**2))
        if len(time) < _FEWEST or not square > 0:
            return 0.0, math.inf, distance
        delay = float(np.sum(speed * off)) / square
        left = off - delay * speed
        # Robust: positions that jump once are no delay.
        sigma = 1.4826 * float(np.median(np.abs(left))) / np.sqrt(square)
        explained = np.linalg.norm(left) < _EXPLAINED * np.linalg.norm(off)
        return (delay, sigma, distance) if explained else (0.0, math.inf, distance)

    def searched(self) -> tuple[float, float]:
        """The shift, s, with which the positions lie nearest to the track, and its sigma."""
        tried = np.arange(-_LONGEST_S, _LONGEST_S + _SEARCH_S, _SEARCH_S)
        shift = float(tried[np.argmin([self.distance(one) for one in tried])])
        sigma = math.inf
        for _ in range(3):
            more, sigma, _ = self.delay(shift)
            shift += more
        return shift, sigma


def miscount(
    track: Track, exposures: Exposures, offset: float, notes: list[str]
) -> tuple[float, float]:
    """Whole seconds by which the exposures' own positions say that leap seconds were miscounted,
    and the delay that they show beside these, s.

    A difference of two time systems is one of stated systems, and refused; a miscount of leap
    seconds is put right; another delay is told, for nobody knows where it comes from.
    """
    pair = _in_one_frame(track, exposures)
    if pair is None:
        return 0.0, 0.0
    if "flight" in track.table and (np.diff(track.table["time_s"]) < 0).any():
        return 0.0, 0.0
    beside = _Beside(track, exposures, offset, *pair)
    away, mine, its = beside.distance(0.0), exposures.source.name, track.source.name
    if not math.isfinite(away):
        return 0.0, 0.0
    sigma = _sigma(track, exposures)
    most = max(_MANY_SIGMAS * sigma, _APART_M)
    best = 0.0
    if away > _MANY_SIGMAS * sigma:
        best = _of_clocks(beside, track, exposures, away, most, notes)
    delay, delay_sigma, left = beside.delay(best)
    if not best and left > most and not math.isfinite(delay_sigma):
        # Farther away than a flight is straight.
        found, found_sigma = beside.searched()
        if beside.distance(found) < min(most, _CLEARLY_BETTER * away):
            delay, delay_sigma = found, found_sigma
    slipped = [rows for rows in _ROWS if beside.distance(best, rows) < min(most, 0.3 * left)]
    if left > most and slipped:
        notes.append(
            f"the positions in {mine} lie {left:.3g} m (median) from {its}, and those of the image "
            f"{abs(slipped[0])} row{'s' * (abs(slipped[0]) > 1)} "
            f"{'below' if slipped[0] > 0 else 'above'} {beside.distance(best, slipped[0]):.2f} m: "
            "did its columns slip, and do the times belong to their images?"
        )
    elif abs(delay) > max(_MANY_SIGMAS * delay_sigma, _LEAST_DELAY_S):
        notes.append(
            f"the positions in {mine} lie where {its} was {abs(delay):.2f} +- {delay_sigma:.2f} s "
            f"{'later' if delay > 0 else 'earlier'} than the images' times: is the clock of the "
            "images right, or are their positions late?"
        )
    elif left > _ELSEWHERE_M:
        raise InputError(
            f"the positions in {mine} lie {left / 1000:,.0f} km from {its}: one of the two is of "
            "another place, or has latitude and longitude exchanged or without sign; name the "
            "track of this flight"
        )
    elif left > most:
        notes.append(
            f"the positions in {mine} lie {left:.3g} m (median) from {its}, {left / sigma:.0f} "
            "times what both state: is it the track of this flight?"
        )
    # Heights without a standard deviation may be those of a barometer.
    up = float(np.median(beside.off(best)[1][:, 2]))
    stated = all("sz" in table for table in (track.table, exposures.table))
    if stated and abs(up) > max(_MANY_SIGMAS * _sigma(track, exposures, ("sz",)), _APART_M):
        notes.append(
            f"the heights in {mine} are {abs(up):.1f} m {'above' if up > 0 else 'below'} those of "
            f"{its} (median): is one of the two above the geoid, the other above the ellipsoid?"
        )
    return best, delay


def _of_clocks(beside: _Beside, track, exposures, away: float, most: float, notes) -> float:
    """Seconds of leap seconds that were miscounted. Raises InputError for another time system."""
    day = track.day or "2017-01-01"
    leap = float(leap_seconds(day))
    ahead = {one: ahead_of_utc(one, day) for one in _CLOCKS}
    named = {ahead[one] - ahead[two]: (one, two) for one in _CLOCKS for two in _CLOCKS}
    counts = [sign * (base + few) for sign in (1, -1) for base in (0.0, leap) for few in _MISCOUNTS]
    counts += [shift for shift in named if shift]
    distance = {shift: beside.distance(shift) for shift in counts}
    best = min(distance, key=lambda shift: distance[shift])
    more, more_sigma, _ = beside.delay(best)
    # What a count of seconds explains is whole seconds, and leaves no more than both state.
    whole = abs(more) < max(_MANY_SIGMAS * more_sigma, _LEAST_DELAY_S) or not more
    if not whole or distance[best] > min(most, _CLEARLY_BETTER * away):
        return 0.0
    mine, its, way = exposures.source.name, track.source.name, "later" if best > 0 else "earlier"
    if best in named and abs(best) != leap + 1 and away - distance[best] > _CLEARLY_OFF_M:
        one, two = (name.replace("GPST", "GPS time") for name in sorted(named[best], reverse=True))
        raise InputError(
            f"{mine}: its positions lie {away:.0f} m from {its}, but {distance[best]:.1f} m if the "
            f"images were taken {abs(best):g} s {way}, so one of the two states {one} and means "
            f"{two}, or the reverse; give the right time system"
        )
    notes.append(
        f"the positions in {mine} lie {away:.1f} m from {its}, and {distance[best]:.2f} m if the "
        f"images were taken {abs(best):g} s {way}, which was done: one of the two was made with "
        "another number of leap seconds"
    )
    return best


def contradicted(
    made: Interpolated, local: Track, exposures: Exposures, names: np.ndarray, delay: float = 0.0
) -> Interpolated:
    """Without the images whose own positions, by what both state, contradict the track.

    delay: by how much the positions are late, s, as all of them say. What all have in common is
    left aside, too: a base, an arm. A time that is wrong, a clock that drifts or jumps, epochs that
    are false: each puts some images elsewhere, and nobody knows which of the two is right.
    Positions without sigmas refuse no image; a clock is told.
    """
    pair, stated = _in_one_frame(local, exposures), {"sx", "sy", "sz"} <= set(exposures.table)
    if pair is None:
        return made
    table, given = made.table, exposures.table
    use = np.array(table["why"] == "")
    if "flag" in given:
        use &= (given["flag"] == _FIXED).to_numpy(dtype=bool, na_value=False)
    off = pair[1] - table[["x", "y", "z"]].to_numpy()
    if delay:
        epochs, at = local.table["time_s"].to_numpy(), table["time_s"].to_numpy()
        off -= np.subtract(*(CURVES["spline"](epochs, pair[0], at + s)[0] for s in (delay, 0.0)))
    way = table[["vx", "vy", "vz"]].to_numpy()
    use &= np.isfinite(off).all(axis=1) & (np.linalg.norm(np.nan_to_num(way), axis=1) > _STANDS_M_S)
    rows = np.flatnonzero(use)
    if len(rows) < _FEWEST:
        return made
    every = [one[["sx", "sy", "sz"]].to_numpy()[rows] for one in (table, given) if stated]
    sigma = np.sqrt(sum((np.nan_to_num(one, nan=_UNSTATED_M) ** 2 for one in every), 0.0))
    sigma = np.maximum(sigma, _LEAST_SIGMA_M)
    design = _common(way[rows])
    left = _without(design, off[rows], np.broadcast_to(sigma, (len(rows), 3)))
    # As neighbours differ, too: what jumps or drifts does not hide itself.
    least = np.array([robust_scale(step) for step in np.diff(left, axis=0).T]) / np.sqrt(2)
    most = np.maximum(_MANY_SIGMAS * np.maximum(sigma, least), made.max_sigma)
    wrong = (np.abs(left) > most).any(axis=1)
    cause = _cause(names[rows], table["time_s"].to_numpy()[rows], off[rows], way[rows], design)
    if not wrong.any() or not (stated or cause):
        return made
    size, source = np.linalg.norm(left, axis=1), exposures.source.name
    note = (
        f"{wrong.sum()} of {len(rows)} images lie up to {size[wrong].max():.2f} m from their "
        f"positions in {source}, more than both state "
        f"({some([str(name) for name in names[rows[wrong]]], 5)}): "
        f"{cause or 'are their times right, and the epochs of the track there?'}"
    )
    if stated:
        table, note = table.copy(), note + " They are refused, for nobody knows which is right"
        table.loc[rows[wrong], "why"] = [
            f"its position in {source} lies {value:.2f} m away" for value in size[wrong]
        ]
    return replace(made, table=table, notes=(*made.notes, note))


def _common(way: np.ndarray) -> np.ndarray:
    """Derivatives (n, 3, 6) of what positions have in common on a way (n, 3), m/s: a shift in the
    world, one along and across the way, and a delay."""
    ahead = way[:, :2] / np.maximum(np.linalg.norm(way[:, :2], axis=1), _STANDS_M_S)[:, None]
    design = np.zeros((len(way), 3, 6))
    design[:, range(3), range(3)] = 1.0
    design[:, :2, 3], design[:, 0, 4], design[:, 1, 4] = ahead, -ahead[:, 1], ahead[:, 0]
    design[:, :, 5] = way
    return design


def _without(design: np.ndarray, off: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Differences (n, 3) of positions without what all have in common, m: the sum of their lengths
    in sigmas is least, which a minority does not draw."""
    weight, left = np.ones(len(off)), off
    for _ in range(_PASSES):
        scaled = weight[:, None] / sigma
        left = off - design @ _solved(design * scaled[:, :, None], off * scaled)
        weight = 1 / np.sqrt(np.maximum(np.linalg.norm(left / sigma, axis=1), 1.0))
    return left


def _solved(design: np.ndarray, off: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(design.reshape(-1, design.shape[-1]), off.ravel(), rcond=1e-9)[0]


def _cause(names, time, off, way, design) -> str:
    """A question on the clock that explains differences (n, 3); empty where none does.

    time: s; way: m/s; design: of what all have in common.
    """
    share = np.linspace(0.0, 1.0, _TRIED + 2)[1:-1]
    steps = np.unique((share * len(time)).astype(int).clip(2, len(time) - 2))
    clocks = [time - time.mean(), *(time >= time[k] for k in steps)]
    alone = float(np.linalg.norm(off - design @ _solved(design, off)))
    best, rest, found = "", _CLEARLY_BETTER * alone, 0.0
    for k, late in enumerate(clocks):
        whole = np.concatenate([design, (late[:, None] * way)[:, :, None]], axis=2)
        solved = _solved(whole, off)
        left = float(np.linalg.norm(off - whole @ solved))
        if left < rest:
            rest, found = left, abs(float(solved[-1]))
            best = f"jump, by {found:.2f} s from {names[steps[k - 1]]} on"
            if not k:
                best = f"drift, by {1000 * found:.2g} ms a second"
    return f"does the clock of the images {best}?" if best else ""


def _sigma(track: Track, exposures: Exposures, axes: tuple[str, ...] = ("sx", "sy")) -> float:
    """Standard deviation of a difference of positions, m, by what both files state."""
    every: list[float] = []
    for table in (track.table, exposures.table):
        stated = table[list(axes)].to_numpy(float) if set(axes) <= set(table) else np.zeros(0)
        stated = stated[np.isfinite(stated)]
        every.append(float(np.median(stated)) if len(stated) else _UNSTATED_M)
    return max(math.hypot(*every), _LEAST_SIGMA_M)


def _in_one_frame(track: Track, exposures: Exposures):
    """Antenna of the track and by the exposures, (n, 3) and (m, 3) local metres, or None.

    A camera's position leads to its antenna where the file states the way between them.
    """
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
    way = ["offset_e", "offset_n", "offset_u"]
    if set(way) <= set(exposures.table):
        positions -= exposures.table[way].to_numpy(float)
    return local.to_local(track).positions(), positions
