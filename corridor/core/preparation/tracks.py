"""Two drones in one list of images: positions that jump to and fro between two tracks.

No speed can be had across such a jump. Which image belongs to which track follows from the
positions: two ways that are together much shorter than the one through all images in order of time.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.preparation.plausibility_of_motion import way_length

# Two ways together are at most this share of the one. A single drone's cannot be: each of two ways
# along one strip is as long as the strip. Where drones fly side by side, nearer to each other than
# they fly from picture to picture, the ways are hardly shorter, but they are straight (the cosine
# of the turn from step to step, median) where the one way reverses.
_SHORTER, _HARDLY, _STRAIGHT = 0.5, 1.05, 0.7
# One jump, or two, are no going to and fro; a track has so many images.
_LEAST_JUMPS, _LEAST = 4, 4
# The best split of so many images is looked for; each later one goes to the nearer track.
_LOOKED_AT = 1500
_MOST_TRACKS = 6


class Interleaved(NamedTuple):
    """track: (images,) number of the track of each image. apart_m: distance of the first two
    tracks, median. named: whether names, folders or cameras of the images say the same.
    """

    track: np.ndarray
    apart_m: float
    named: str

    def sentence(self, block: Block) -> str:
        """Who flies where, and what to do."""
        names = block.images["image"].astype(str).to_numpy()
        count = int(self.track.max()) + 1
        firsts = ", ".join(
            f"{names[self.track == k][0]} ... ({int((self.track == k).sum())})"
            for k in range(count)
        )
        told = (
            f"images.csv: positions jump to and fro between {count} tracks, {self.apart_m:.0f} m "
            f"apart: {count} drones, or flights whose times interleave ({firsts})"
        )
        if self.named:
            return f"{told}; {self.named} say the same, so each track is a flight of its own."
        return (
            f"{told}. No velocity is derived across them: write the flight of each image into the "
            "column flight of images.csv."
        )


def interleaved(block: Block) -> Interleaved | None:
    """The tracks of a block whose images of one flight and camera are of several; None if not.

    What images are called is tried first; positions alone otherwise.
    """
    time = block.column("images", "time_s")
    place = np.full((len(time), 3), np.nan)
    rows = block.image_rows("gnss") if len(block.gnss) else np.zeros(0, int)
    place[rows[rows >= 0]] = block.numbers("gnss", *"xyz")[rows >= 0]
    # Of two sources only one: positions and start poses may lie in different frames.
    if not np.isfinite(place).all():
        place = block.numbers("images", *"xyz")
    camera = pd.factorize(block.images["camera"])[0]
    group = block.image_flight * (camera.max(initial=0) + 1) + camera
    known = np.isfinite(time) & np.isfinite(place).all(axis=1)
    order = np.argsort(time, kind="stable")
    track, apart, named = np.zeros(len(time), int), [], []
    for one in np.unique(group):
        mine = order[(group == one)[order] & known[order]]
        said, split = next(_by_names(block, mine, place[mine]), ("", None))
        split = _by_positions(place[mine]) if split is None else split
        track[mine] = split + track.max(initial=-1) + 1
        if split.max(initial=0) > 0:
            apart.append(_apart(time[mine], place[mine], split))
            named.append(said)
    if not apart:
        return None
    by = named[0] if len(set(named)) == 1 else ""
    return Interleaved(pd.factorize(track)[0], float(np.median(apart)), by)


def _by_names(block: Block, mine: np.ndarray, place: np.ndarray):
    """(what says so, track (n,)) of each way that names tell the images apart and positions agree.

    mine: rows of images.csv in order of time. place: (n, 3) their positions.
    """
    names = block.images["image"].astype(str).iloc[mine]
    number = names.str.extract(r"(\d+)\D*$", expand=False)
    told = {
        "the folders of the images": names.str.extract(r"^(.*)[/\\]", expand=False).fillna(""),
        "the images' names": names.str.replace(r"\d+\D*$", "", regex=True),
    }
    if number.notna().all() and len(number):
        # Each drone counts its own pictures one by one.
        number = number.astype(float).to_numpy()
        upwards = np.argsort(number, kind="stable")
        run = np.zeros(len(number), int)
        run[upwards] = np.cumsum(np.diff(number[upwards], prepend=number[upwards][:1]) > 1)
        told["the images' numbers"] = pd.Series(run)
    for what, key in told.items():
        track = pd.factorize(key)[0]
        if _holds(place, track):
            yield what, track


def _by_positions(place: np.ndarray) -> np.ndarray:
    """Track (n,) of each of positions (n, 3) in order of time; all 0 where it is one."""
    track, looked = np.zeros(len(place), int), 0
    while looked <= track.max(initial=0) < _MOST_TRACKS:
        rows = np.flatnonzero(track == looked)
        second = _shortest_two(place[rows]) if len(rows) >= 2 * _LEAST else np.zeros(0, bool)
        if len(second) and _holds(place[rows], second.astype(int)):
            track[rows[second]] = track.max() + 1
        else:
            looked += 1
    return track


def _holds(place: np.ndarray, track: np.ndarray) -> bool:
    """Whether positions (n, 3) in order of time are rather of these tracks (n,) than of one."""
    each = np.bincount(track)
    jumps = int(np.sum(track[1:] != track[:-1]))
    if not 1 < len(each) <= _MOST_TRACKS or jumps < _LEAST_JUMPS or each.min() < _LEAST:
        return False
    ways = [place[track == one] for one in range(len(each))]
    share = sum(map(way_length, ways)) / max(way_length(place), 1e-9)
    reverses = _turning(place) < 0 and min(map(_turning, ways)) > _STRAIGHT
    return share < _SHORTER or share < _HARDLY and reverses


def _turning(place):
    """Cosine of the turn from step to step, median."""
    step = np.diff(place, axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    return float(np.median((step[1:] * step[:-1]).sum(axis=1)))


def _shortest_two(place: np.ndarray) -> np.ndarray:
    """The split (n,) of positions in order of time into two ways that are shortest together.

    Dynamic programming: after image k one way ends there, the other at an earlier j, or nowhere.
    Beyond the first images each goes to the nearer way.
    """
    count = min(len(place), _LOOKED_AT)
    # cost[j + 1]: of the best two ways that end at k and at j; 0: the second is not begun.
    cost, came = np.full(count + 1, np.inf), np.zeros(count, int)
    cost[0] = 0.0
    for k in range(count - 1):
        step = float(np.linalg.norm(place[k + 1] - place[k]))
        leap = cost[: k + 1].copy()
        leap[1:] += np.linalg.norm(place[:k] - place[k + 1], axis=1)
        came[k + 1] = int(leap.argmin())  # where the other way ended, if it goes on at k + 1
        cost[: k + 1] += step
        cost[k + 1] = leap.min()
    second = np.zeros(len(place), bool)
    other, k = int(cost[:count].argmin()), count - 1
    which = True
    while k >= 0:
        second[k] = which
        if other == k and k > 0:  # the other way ended right before: here this one went on
            other, k, which = came[k], k - 1, not which
        else:
            k -= 1
    if second[0]:
        second[:count] = ~second[:count]
    if count == len(place) or not _holds(place[:count], second[:count].astype(int)):
        return second
    last = [np.flatnonzero(second[:count] == which)[-1] for which in (False, True)]
    for row in range(count, len(place)):
        nearer = int(np.linalg.norm(place[last] - place[row], axis=1).argmin())
        second[row], last[nearer] = bool(nearer), row
    return second


def _apart(time, place, track) -> float:
    """Distance of the first two tracks at the times of the second, median, m."""
    one, other = track == 0, track == 1
    there = np.column_stack([np.interp(time[other], time[one], axis[one]) for axis in place.T])
    return float(np.median(np.linalg.norm(there - place[other], axis=1)))
