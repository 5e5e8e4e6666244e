"""Times and velocities of a block that contradict the way that was flown."""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import bdtrc

from corridor.core.block import VELOCITY, Block
from corridor.core.geometry import OUTLIER

# Units of speed that are none of metres a second, by how much larger their numbers are.
_SPEEDS = {3.6: "km/h", 1.9438: "knots", 2.2369: "miles an hour", 3.2808: "feet a second"}
# What chance does less often than this is told (sign test; n names in the opposite order: 1 / n!).
_CHANCE = 1e-3


class _Pairs(NamedTuple):
    """Images after each other in a strip: how fast the drone flew and what is stated, m/s.

    along (n,): the stated velocity along the way that was flown, over the speed flown.
    way, stated (n, 3): the velocity flown and stated. sigma (n,): of that stated, 0 if unknown.
    """

    flown: np.ndarray
    told: np.ndarray
    along: np.ndarray
    way: np.ndarray
    stated: np.ndarray
    sigma: np.ndarray


# A way so many times as long as another, of so many images, is none that was flown.
_TO_AND_FRO, _FEWEST = 2.0, 8
# No flight, and no walk from tripod to tripod, goes so far only in so long.
_ONE_PLACE_M, _BETWEEN_S = 1.0, 600.0


def motion_warnings(block: Block) -> list[str]:
    """Sentences on times and velocities that are probably a mistake."""
    slow = [*_milliseconds(block)]
    backwards = [*_backwards(block), *_track_backwards(block), *_disordered(block)]
    # Times that run backwards turn every velocity round.
    return slow or backwards or velocity_warnings(block)


def _milliseconds(block: Block) -> Iterator[str]:
    """Flights that would need ten minutes and more from one photograph to the next place."""
    time, centre = block.column("images", "time_s"), block.numbers("images", *"xyz")
    known = np.isfinite(time) & np.isfinite(centre).all(axis=1)
    for flight, called in enumerate(block.flight_names):
        mine = np.flatnonzero((block.image_flight == flight) & known)
        mine = mine[np.argsort(time[mine], kind="stable")]
        step = np.linalg.norm(np.diff(centre[mine], axis=0), axis=1)
        if len(mine) < _FEWEST or np.median(step) < _ONE_PLACE_M:
            continue
        if (between := float(np.median(np.diff(time[mine])))) > _BETWEEN_S:
            yield (
                f"images.csv: the images of flight {called} are {between:,.0f} s (median) apart: "
                "is time_s in milliseconds? Write seconds."
            )


def _backwards(block: Block) -> Iterator[str]:
    """Flights whose images, as they are numbered, run against their times."""
    time, names = block.column("images", "time_s"), block.images["image"].astype(str).to_numpy()
    cameras = block.images["camera"].astype(str).to_numpy()
    found, flights, flight_of = [], block.flight_names, block.image_flight
    for flight, called in enumerate(flights):
        mine = np.flatnonzero((flight_of == flight) & np.isfinite(time))
        if len(set(cameras[mine])) != 1:
            continue
        last, first = (names[mine[at(time[mine])]] for at in (np.argmax, np.argmin))
        # Of a river the names take long to sort, and one look at two of them nearly always tells.
        if _key(last) <= _key(first) and _falls(time[sorted(mine, key=lambda n: _key(names[n]))]):
            found.append(str(called))
    if found:
        which = f" of flight {', '.join(found[:5])}" if len(flights) > 1 else ""
        yield (
            f"images.csv: time_s falls{which} from image to image in the order of their names: are "
            "the times in the opposite order? Cameras number pictures as they take them."
        )


def _disordered(block: Block) -> Iterator[str]:
    """Flights whose images lie far nearer to each other by their names than by their times."""
    time, names = block.column("images", "time_s"), block.images["image"].astype(str).to_numpy()
    centre = block.numbers("images", *"xyz")
    known = np.isfinite(time) & np.isfinite(centre).all(axis=1)
    for flight, called in enumerate(block.flight_names):
        mine = np.flatnonzero((block.image_flight == flight) & known)
        if len(mine) < _FEWEST:
            continue
        by_time = mine[np.argsort(time[mine], kind="stable")]
        way = way_length(centre[by_time])
        # Of a river the names take long to sort: drones fly straight on from most images.
        if not way > _TO_AND_FRO * float(np.linalg.norm(np.ptp(centre[mine], axis=0))):
            continue
        by_name = way_length(centre[sorted(mine, key=lambda n: _key(names[n]))])
        if way > _TO_AND_FRO * by_name:
            yield (
                f"images.csv: in the order of time_s, flight {called} jumps to and fro over "
                f"{way / 1000:.2g} km; in the order of the image names it is "
                f"{by_name / 1000:.2g} km long. Do images have each other's times?"
            )


def way_length(centre: np.ndarray) -> float:
    """Length of the way along places (n, 3)."""
    return float(np.linalg.norm(np.diff(centre, axis=0), axis=1).sum())


def _track_backwards(block: Block) -> Iterator[str]:
    if len(block.track) and _falls(block.column("track", "time_s")):
        yield (
            f"track.csv: time_s falls from row to row in all {len(block.track)}: are the times in "
            "the opposite order? A receiver writes epochs as they come."
        )


def _falls(time: np.ndarray) -> bool:
    """Whether times fall from each to the next, of more than chance would put in that order."""
    return bool(math.lgamma(len(time) + 1) > -math.log(_CHANCE) and (np.diff(time) < 0).all())


def _key(name: str) -> list:
    """By which names with numbers are sorted as a person does."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


# Ways to write a velocity wrongly, and what they make of east, north, up.
_MISTAKEN = {
    "against the way from image to image: have they the opposite sign": lambda v: -v,
    "across the way from image to image: are vx and vy exchanged": lambda v: v[:, [1, 0, 2]],
    "across the way from image to image: are vx and vy exchanged, with the opposite sign": (
        lambda v: -v[:, [1, 0, 2]]
    ),
}
# What a mistake explains: stated and flown then differ by less than half of the speed, and by less
# than a third of what they differ as they are.
_EXPLAINS, _BETTER = 0.5, 1.0 / 3.0
# Directions that differ by more than 60 degrees, and the share of pairs that wind does not reach.
_ELSEWHERE, _MANY = 1.0, 0.1


def velocity_warnings(block: Block) -> list[str]:
    """Velocities beside the way and the time from image to image of one strip, as sentences."""
    pairs = paired_speeds(block)
    count = len(pairs.told)
    as_they_are = _differ(pairs.way, pairs.stated)
    # Velocities that are known badly, as derived ones may be, contradict nothing.
    sure = np.linalg.norm(pairs.way - pairs.stated, axis=1) > OUTLIER * pairs.sigma
    for cause, mistaken in _MISTAKEN.items() if count else ():
        off = _differ(pairs.way, mistaken(pairs.stated))
        explained = (off < _EXPLAINS) & (off < _BETTER * as_they_are) & sure
        # Of a fair coin, as many heads or more.
        if bdtrc(int(explained.sum()) - 1, count, 0.5) < _CHANCE:
            where, question = cause.split(":")
            return [
                f"images.csv: vx, vy, vz point {where} in {int(explained.sum())} of {count} pairs:"
                f"{question}? They are the camera's velocity in the world, m/s."
            ]
    if count < 5:
        return []
    elsewhere = int(((as_they_are > _ELSEWHERE) & sure).sum())
    if elsewhere > _MANY * count:
        return [
            f"images.csv: vx, vy, vz point elsewhere than the way from image to image in "
            f"{elsewhere} of {count} pairs: has each image its own velocity?"
        ]
    middle = float(np.median(pairs.told / pairs.flown))
    if abs(np.log(middle)) < np.log(1.4) or sure.mean() < 0.5:
        return []
    unit = min(_SPEEDS, key=lambda factor: abs(np.log(middle / factor)))
    cause = f"{_SPEEDS[unit]}?" if abs(middle / unit - 1.0) < 0.1 else "is time_s in seconds?"
    return [
        f"images.csv: vx, vy, vz are {middle:.3g} times what x, y, z and time_s of the same table "
        f"say (median of {count} pairs): {cause} Velocities are in m/s."
    ]


def _differ(way: np.ndarray, stated: np.ndarray) -> np.ndarray:
    """(n,) by which directions (n, 3) differ: length of the difference of unit vectors."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (way, stated))
    return np.linalg.norm(one - other, axis=1)


def paired_speeds(block: Block) -> _Pairs:
    """How fast each pair of neighbours flew, and what is stated."""
    velocity = block.numbers("images", *VELOCITY)
    centre = block.numbers("images", *"xyz")
    time, camera = block.column("images", "time_s"), block.images["camera"].to_numpy()
    strip = block.images.get("strip")
    strip = np.zeros(len(time)) if strip is None else strip.astype(str).to_numpy()
    flight = block.image_flight
    order = np.lexsort((time, strip, flight))
    one, next_one = order[:-1], order[1:]
    same = (flight[one] == flight[next_one]) & (strip[one] == strip[next_one])
    same &= camera[one] == camera[next_one]
    one, next_one = one[same], next_one[same]
    seconds = time[next_one] - time[one]
    way, stated = centre[next_one] - centre[one], (velocity[one] + velocity[next_one]) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        way = way / seconds[:, None]
        flown, told = (np.linalg.norm(each, axis=1) for each in (way, stated))
        along = (way * stated).sum(axis=1) / flown**2
        # A drone that turns or stops between two images says nothing.
        good = np.isfinite(along) & (seconds > 0) & (told > 1.0)
    if good.any():
        good &= flown > 0.3 * np.median(flown[good])
    sigma = np.linalg.norm(np.nan_to_num(block.numbers("images", "svx", "svy", "svz")), axis=1)
    sigma = np.maximum(sigma[one], sigma[next_one])
    return _Pairs(*(each[good] for each in (flown, told, along, way, stated, sigma)))
