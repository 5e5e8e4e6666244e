"""What is compared: both epochs adjusted, checked to be of one place, and their clouds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import date

import numpy as np
from scipy.spatial import cKDTree

from corridor.adjustment import Adjustment, gnss_of_metres
from corridor.block import Block
from corridor.change.clouds import Cloud
from corridor.change.cores import Cores
from corridor.change.epoch import Epoch
from corridor.errors import InputError
from corridor.geometry import robust_scale

# Tie points further than so many usual distances from the ground around them are wrong matches.
WILD = 8.0
_AROUND = 9


def check_blocks(before: Block, after: Block) -> None:
    """Raises InputError where two blocks cannot be compared: coordinates, dates."""
    if before.crs and after.crs and before.crs != after.crs:
        raise InputError(
            f"block.toml: crs of BEFORE is {before.crs}, of AFTER {after.crs}: bring both blocks "
            "into one system"
        )
    if np.abs(before.offset - after.offset).max() > 1e-6:
        told = ["[" + ", ".join(f"{v:.12g}" for v in b.offset) + "]" for b in (before, after)]
        raise InputError(
            f"block.toml: offset of BEFORE is {told[0]}, of AFTER {told[1]}: coordinates differ by "
            "metres that are no motion; write both blocks with one offset"
        )
    dates = [_date(block, name) for block, name in ((before, "BEFORE"), (after, "AFTER"))]
    if all(dates) and dates[0] > dates[1]:
        raise InputError(
            f"block.toml: BEFORE is of {dates[0]}, AFTER of {dates[1]}: exchange the two blocks"
        )


def _date(block: Block, name: str) -> date | None:
    given = block.extra.get("date")
    if given is None or isinstance(given, date):
        return given.date() if hasattr(given, "date") else given
    try:
        return date.fromisoformat(str(given)[:10])
    except ValueError:
        raise InputError(
            f"block.toml of {name}: date = {given!r} is no date; write it as 2024-05-31"
        ) from None


def check_datum(before: Adjustment, after: Adjustment, datum: str) -> None:
    """Raises InputError where an epoch is a free network and the datum is to be the stated one."""
    free = [
        name for name, one in (("BEFORE", before), ("AFTER", after)) if one.system.held is not None
    ]
    if free and datum != "stable":
        both = len(free) == 2
        raise InputError(
            f"{' and '.join(free)} {'have' if both else 'has'} neither control nor GNSS and so no "
            "datum: give control points or GNSS, or lay both together on what stands still "
            "(--datum stable --motion similarity)"
        )


def usual_datum(adjusted: Iterable[Adjustment]) -> str:
    """`stable` where an epoch hangs on GNSS of metres alone, and floats by as much; else
    `stated`."""
    for one in adjusted:
        alone = not len(one.system.control.names) and one.system.held is None
        if alone and gnss_of_metres(one.start):
            return "stable"
    return "stated"


def check_meeting(before: np.ndarray, after: np.ndarray, cores: Cores) -> None:
    """Raises InputError where the surfaces of both epochs (n, 3) lie beyond each other's reach."""
    heights = [xyz[cKDTree(xyz[:, :2]).query(cores.xyz[:, :2])[1], 2] for xyz in (before, after)]
    apart = float(np.median(np.abs(heights[1] - heights[0])))
    if apart > cores.reach:
        raise InputError(
            f"the surfaces of both epochs lie {apart:.1f} m apart in height (median) where both "
            f"show the ground, and are looked for within {cores.reach:.1f} m: look at what "
            "`corridor adjust` says of both, at their focal lengths and their datum above all"
        )


def check_names(names: np.ndarray, shift: np.ndarray, sigma: np.ndarray, largest: float) -> None:
    """Raises InputError where a name means different points: it lies further off than ground moves.

    shift, sigma (k, 3), m.
    """
    away = np.linalg.norm(shift, axis=1)
    wrong = away > np.maximum(largest, 6.0 * np.linalg.norm(sigma, axis=1))
    if wrong.any():
        k = int(np.argmax(np.where(wrong, away, 0.0)))
        more = f" ({wrong.sum() - 1} more so)" if wrong.sum() > 1 else ""
        raise InputError(
            f"point {names[k]} lies {away[k]:.1f} m apart in the two epochs{more}: the name means "
            f"different points; rename one (marks.csv, ground.csv), or allow motions beyond "
            f"{largest:g} m (--largest-motion)"
        )


def check_overlap(before: np.ndarray, after: np.ndarray) -> None:
    """Raises InputError where points (n, 3) of both epochs lie in places apart."""
    if not (len(before) and len(after)):
        return
    boxes = [np.percentile(xyz[:, :2], [1, 99], axis=0) for xyz in (before, after)]
    low, high = np.maximum(boxes[0][0], boxes[1][0]), np.minimum(boxes[0][1], boxes[1][1])
    if (low > high).any():
        apart = float(np.linalg.norm(np.maximum(low - high, 0.0)))
        raise InputError(
            f"the epochs do not overlap: their ground lies {apart:.0f} m apart; check that both "
            "blocks are of the same place and in the same coordinates"
        )


def clouds(
    before: Adjustment, after: Adjustment, same_ties: bool = False, rays: int = 3
) -> tuple[Cloud, Cloud]:
    """The clouds of two adjustments.

    same_ties: tie points of the same name are the same points of the ground; the others go.
    rays: how many images at least show a point that stands for the ground.
    """
    sides = tuple(cloud(Epoch(adjustment), rays) for adjustment in (before, after))
    return paired(*sides) if same_ties else sides


def cloud(epoch: Epoch, rays: int, date: str = "") -> Cloud:
    """The points of an epoch whose names begin with `date`, which is no part of them."""
    mine = np.array([str(name).startswith(date) for name in epoch.names], dtype=bool)
    marks = epoch.system.points.mark
    surface = np.flatnonzero(mine & ~marks & (epoch.rays >= rays))
    named = {str(epoch.names[k])[len(date) :]: int(k) for k in np.flatnonzero(mine & marks)}
    return Cloud(epoch, surface[sound(epoch.xyz[surface])], named, date)


def paired(before: Cloud, after: Cloud) -> tuple[Cloud, Cloud]:
    """The clouds with those surface points only that both name, one for one."""
    places = [dict(zip(one.surface_names, one.surface, strict=True)) for one in (before, after)]
    both = [name for name in places[0] if name in places[1]]
    first, second = (np.array([place[n] for n in both], dtype=np.int64) for place in places)
    return replace(before, surface=first), replace(after, surface=second)


def sound(xyz: np.ndarray) -> np.ndarray:
    """Which points (n,) lie on the ground around them, as far as can be seen.

    The usual distance is that of all points, or that of the neighbours among themselves where it
    is larger: the crest of a dike is no wrong match.
    """
    if len(xyz) <= _AROUND:
        return np.ones(len(xyz), dtype=bool)
    near = cKDTree(xyz[:, :2]).query(xyz[:, :2], _AROUND)[1][:, 1:]
    around = xyz[near, 2]
    away = xyz[:, 2] - np.median(around, axis=1)
    usual = np.maximum(robust_scale(around, centred=True, axis=1), robust_scale(away, least=1e-6))
    return np.abs(away) <= WILD * usual
