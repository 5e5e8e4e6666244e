"""Two drones in one list of images: positions that jump to and fro between two tracks.

No speed can be had across such a jump. Which image belongs to which track follows from the
positions: two ways that are together much shorter than the one through all images in order of time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.block import Block

# Two ways together are at most this share of the one. A single drone's cannot be: each of two ways
# along one strip is as long as the strip. Where drones fly side by side, nearer to each other than
# they fly from picture to picture, the ways are hardly shorter, but they are straight (the cosine
# of the turn from step to step, median) where the one way reverses.
_SHORTER, _HARDLY, _STRAIGHT = 0.5, 0.9, 0.7
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
    """The tracks of a block whose images of one flight and camera are of several; None if not."""
    time = block.column("images", "time_s")
    place = np.full((len(time), 3), np.nan)
    rows = block.image_rows("gnss") if len(block.gnss) else np.zeros(0, int)
    place[rows[rows >= 0]] = block.numbers("gnss", *"xyz")[rows >= 0]
    lacking = ~np.isfinite(place).all(axis=1)
    # Of two sources only one: positions and start poses may lie in different frames.
    if lacking.any():
        place = block.numbers("images", *"xyz")
    camera = pd.factorize(block.images["camera"])[0]
    group = block.image_flight * (camera.max(initial=0) + 1) + camera
    track, apart = np.zeros(len(time), int), []
    for one in np.unique(group):
        mine = np.flatnonzero((group == one) & np.isfinite(time) & np.isfinite(place).all(axis=1))
        mine = mine[np.argsort(time[mine], kind="stable")]
        parts = _parts(place[mine])
        base = track.max(initial=0) + 1 if track.any() or apart else 0
        for number, part in enumerate(parts):
            track[mine[part]] = base + number
        if len(parts) > 1:
            apart.append(_apart(time[mine], place[mine], parts))
    if not apart:
        return None
    return Interleaved(pd.factorize(track)[0], float(np.median(apart)), _named(block, time, track))


def _parts(place: np.ndarray) -> list[np.ndarray]:
    """Rows of each track, of positions (n, 3) in order of time; one track where it is one."""
    parts, done = [np.arange(len(place))], []
    while parts and len(parts) + len(done) < _MOST_TRACKS:
        rows = parts.pop()
        second = _split(place[rows])
        if second is None:
            done.append(rows)
        else:
            parts += [rows[~second], rows[second]]
    return sorted([*done, *parts], key=lambda rows: rows[0] if len(rows) else -1)


def _split(place: np.ndarray) -> np.ndarray | None:
    """Which rows (n,) are of the second of two tracks; None where one way is not much longer."""
    if len(place) < 2 * _LEAST:
        return None
    second = _shortest_two(place[:_LOOKED_AT])
    for row in range(len(second), len(place)):
        last = [np.flatnonzero(second == which)[-1] for which in (False, True)]
        nearer = np.linalg.norm(place[last] - place[row], axis=1).argmin()
        second = np.append(second, bool(nearer))
    jumps = int(np.sum(second[1:] != second[:-1]))
    fewest = min(second.sum(), (~second).sum())
    if jumps < _LEAST_JUMPS or fewest < _LEAST:
        return None
    share = (_length(place[second]) + _length(place[~second])) / max(_length(place), 1e-9)
    straight = min(_turning(place[second]), _turning(place[~second])) > _STRAIGHT
    if share < _SHORTER or share < _HARDLY and straight and _turning(place) < 0:
        return second
    return None


def _turning(place):
    """Cosine of the turn from step to step, median."""
    step = np.diff(place, axis=0)
    step /= np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    return float(np.median((step[1:] * step[:-1]).sum(axis=1)))


def _length(place):
    return float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())


def _shortest_two(place: np.ndarray) -> np.ndarray:
    """The split (n,) of positions in order of time into two ways that are shortest together.

    Dynamic programming: after image k one way ends there, the other at an earlier j, or nowhere.
    """
    count = len(place)
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
    second = np.zeros(count, bool)
    other, k = int(cost[:count].argmin()), count - 1
    which = True
    while k >= 0:
        second[k] = which
        if other == k and k > 0:  # the other way ended right before: here this one went on
            other, k, which = came[k], k - 1, not which
        else:
            k -= 1
    return second if not second[0] else ~second


def _apart(time, place, parts) -> float:
    """Distance of the first two tracks at the times of the second, median, m."""
    one, other = parts[0], parts[1]
    there = np.column_stack([np.interp(time[other], time[one], axis[one]) for axis in place.T])
    return float(np.median(np.linalg.norm(there - place[other], axis=1)))


def _named(block: Block, time: np.ndarray, track: np.ndarray) -> str:
    """What of the images' names goes with the tracks; empty where nothing does."""
    names = block.images["image"].astype(str)
    for what, key in (
        ("the folders of the images", names.str.extract(r"^(.*)[/\\]", expand=False).fillna("")),
        ("the images' names", names.str.replace(r"\d+\D*$", "", regex=True)),
    ):
        pairs = set(zip(pd.factorize(key)[0].tolist(), track.tolist(), strict=True))
        if len(pairs) == len(set(track)) == key.nunique():
            return what
    numbers = names.str.extract(r"(\d+)\D*$", expand=False)
    if numbers.isna().any():
        return ""
    number = numbers.astype("int64").to_numpy()
    order = np.argsort(time, kind="stable")
    alone = [np.diff(number[order][track[order] == one]) for one in range(track.max() + 1)]
    # Each drone counts its own pictures one by one; both together do not.
    one_by_one = [np.mean(steps == 1) for steps in alone if len(steps)]
    if min(one_by_one) > 0.8 and np.mean(np.diff(number[order]) == 1) < 0.5:
        return "the images' numbers"
    return ""
