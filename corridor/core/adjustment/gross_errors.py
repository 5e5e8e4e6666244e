"""Gross errors that least squares do not get over: marks of another point, exchanged positions.

Squares share one gross error out among everything, and a focal length of a tenth of its size may be
what fits it best. A few such measurements are found by an adjustment that they cannot rule, named,
and set aside; where that does not make the rest fit, they are not what is wrong.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core.adjustment.blunders import exchanged_points
from corridor.core.adjustment.false_positions import false_apart, lengths
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.result import Adjustment, Again, where_it_leads
from corridor.core.adjustment.variance_components import CONTRADICTING_FACTOR
from corridor.core.adjustment.warnings import implausible
from corridor.core.block import Block
from corridor.core.camera import project
from corridor.core.errors import AdjustmentFailed, InputError, some
from corridor.core.geometry import GROSS, OUTLIER, robust_scale_of_lengths
from corridor.core.output import counted

# A robust loss that gross errors have no say in.
NO_SAY = "cauchy:2"
# More than this share of the marks, or of the positions of a flight, is no handful.
_MOST = 0.4
# A mark belongs to the point that it lies nearest to, by so much of the distance of its own.
_NEARER = 0.1
# Median of the length of three errors of standard deviation 1.
_OF_THREE = 1.538
# A position is off alone from here on, in its sigmas, and among so many times as many others.
_ALONE, _LONE = 2.0 * OUTLIER, 0.05
_ROUNDS = 4
_FEW = 3
_NAMED = 5


def without_gross_errors(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted without gross errors in marks and antenna positions, where that makes all else fit.

    The result itself where it holds none, or they are no handful. Positions keep a row, with a
    standard deviation of their own size.
    """
    found = result
    for _ in range(_ROUNDS):
        notes: list[str] = []
        try:
            better = _without_positions(found, again, notes)
            better = _without_marks(better, again, notes)
        except (InputError, AdjustmentFailed):
            break
        if better is found or not better.converged:
            break
        better.add_note(*notes)
        found = better
    return found


def begun_with_sound_positions(block: Block, model: Model, again: Again) -> Adjustment:
    """Adjusted; where it runs away, or half of the positions miss grossly, without those that are
    false beside the stated camera, if the others are then as good as they are stated.

    A third of a flight that is metres off draws all others after it, the arm and a free focal
    length, which may become a hundred times as long, at once or with a robust loss. They cannot do
    so where both are held. An effect that is missing is in all positions, and leaves none right.
    Raises what the adjustment does, where that does not help.
    """
    first: Adjustment | InputError | AdjustmentFailed
    most = np.inf
    try:
        first = again(block, model)
        if first.converged and not implausible(first):
            if _miss(first) < GROSS:
                return first
            most = _OF_THREE * CONTRADICTING_FACTOR
    except (InputError, AdjustmentFailed) as failure:
        first = failure
    held = where_it_leads(again, block, replace(model, camera="fixed", lever_arm="fixed"))
    # The free camera is that of the block where the positions are off by less.
    for begun in (held,) if isinstance(first, Exception) or most == np.inf else (first, held):
        notes: list[str] = []
        found = begun and where_it_leads(_without_positions, begun, again, notes, model)
        if found and found is not begun and _miss(found) < most and not implausible(found):
            found.add_note(*notes)
            return found
    if isinstance(first, Exception):
        raise first
    return first


def _miss(found: Adjustment) -> float:
    """Median length by which positions miss, in their standard deviations; 0 without any."""
    table = found.residuals["gnss"]
    miss = table[["vx", "vy", "vz"]].to_numpy() / table[["sx", "sy", "sz"]].to_numpy()
    return float(np.median(np.linalg.norm(miss, axis=1))) if len(table) else 0.0


def _square(result: Adjustment) -> float:
    """Sum of squares of what is no tie point, in stated standard deviations, and of usable ties."""
    total = 0.0
    for kind, table in result.residuals.items():
        if len(table) and kind != "tie":
            v = [axis for axis in ("vx", "vy", "vz") if axis in table]
            sigma = ["sigma"] * 2 if "sigma" in table else ["s" + axis[1] for axis in v]
            total += float(((table[v].to_numpy() / table[sigma].to_numpy()) ** 2).sum())
    ties = result.statistics["tie"]
    return total + (2.0 * ties["count"] * ties["sigma0"] ** 2 if ties else 0.0)


def _without_positions(
    result: Adjustment, again: Again, notes: list[str], free: Model | None = None
) -> Adjustment:
    """free: the model to go on with, where the result is of one whose camera and arm are held."""
    table = result.residuals["gnss"]
    sigma = table[["sx", "sy", "sz"]].to_numpy()
    size = np.linalg.norm(table[["vx", "vy", "vz"]].to_numpy() / sigma, axis=1)
    if not len(size):
        return result
    # At a glance; their own standard deviations need covariances.
    if free is None and not (size > OUTLIER * max(np.median(size), 1.0)).any():
        return result
    p, length = result.problem, lengths(result, sigma)
    flight = p.images.flight[p.gnss_image]
    flights = []
    for number in np.unique(flight):
        mine = length[flight == number]
        scaled = mine / max(np.median(mine) / _OF_THREE, 1.0)
        far, alone = (np.count_nonzero(scaled > limit) for limit in (GROSS, _ALONE))
        # One of many that is off is a false fix, long before a block of them would be.
        few = 0 < far < _MOST * len(mine) or 0 < alone <= _LONE * len(mine)
        if few or (free is not None and np.median(mine) > GROSS):
            flights.append(str(p.images.flight_names[number]))
    if not flights:
        return result
    found = false_apart(result, again, sorted(flights), notes, free)
    if found is not result:
        notes += _exchanged(found)
    return found


def _exchanged(found: Adjustment) -> list[str]:
    """A sentence on positions each of which is that of the other image."""
    table = found.residuals["gnss"]
    given = found.problem.gnss_given
    seen = given - table[["vx", "vy", "vz"]].to_numpy()
    names = table["image"].astype(str).tolist()
    pairs = [f"{names[i]} and {names[j]}" for i, j in exchanged_points(given, seen)]
    if not pairs:
        return []
    return [
        f"Of the GNSS positions set aside some are exchanged: {'; '.join(pairs)}. Are the images "
        "in order?"
    ]


def _without_marks(result: Adjustment, again: Again, notes: list[str]) -> Adjustment:
    if not len(result.residuals["mark"]) or not result.residuals["mark"]["gross"].any():
        return result
    block, model = result.start, result.problem.model
    robust = again(block, replace(model, loss=NO_SAY))
    table = robust.residuals["mark"]
    length = np.hypot(table["vx"], table["vy"]).to_numpy() / table["sigma"].to_numpy()
    wrong = length > GROSS * robust_scale_of_lengths(length, least=1.0)
    # Where most marks of a point are off, it is the point that lies elsewhere.
    wrong &= pd.Series(wrong).groupby(table["point"].astype(str)).transform("mean").to_numpy() < 0.5
    if not wrong.any() or wrong.sum() > _MOST * len(wrong):
        return result
    gone = table[wrong]
    keys = set(zip(gone["image"].astype(str), gone["point"].astype(str), strict=True))
    marks = block.marks
    rows = zip(marks["image"].astype(str), marks["point"].astype(str), strict=True)
    kept = np.array([row not in keys for row in rows])
    start = block.with_(marks=marks[kept].reset_index(drop=True))
    found = again(start, model)
    # Squares that fit with them bear them: the marks are told among the outliers. A few that are
    # gross, beside others of the same points that are not, are what is wrong where nearly all of
    # what they miss goes with them.
    before, after = _square(result), _square(found)
    few = wrong.sum() <= _FEW and before - after > 0.5 * float((length[wrong] ** 2).sum())
    if not (few or after < before / CONTRADICTING_FACTOR**2):
        return result
    notes.append(_told(robust, gone))
    return found


def _told(robust: Adjustment, gone) -> str:
    """A sentence on marks that are set aside, with the point to which each belongs by its place."""
    block = robust.block
    ground = block.ground
    place = ground[["x", "y", "z"]].to_numpy(float)
    rotation = robust.state.rotation
    row = {name: k for k, name in enumerate(robust.problem.images.names.tolist())}
    shown, others = [], []
    for mark in gone.itertuples():
        k = row[str(mark.image)]
        camera = list(block.cameras.values())[robust.problem.images.camera[k]]
        seen = project(place, robust.state.centre[k], rotation[k], camera.interior)
        away = np.hypot(*(seen - [mark.x, mark.y]).T)
        off = float(np.hypot(mark.vx, mark.vy))
        shown.append(f"{mark.point} in {mark.image}, {off:.0f} px")
        if np.isfinite(away).any() and np.nanmin(away) < _NEARER * off:
            others.append(str(ground["point"].iloc[int(np.nanargmin(away))]))
    many = counted(len(gone), "mark")
    told = f"{many} set aside, far from where all else puts the point: {some(shown, _NAMED)}."
    if not others:
        return told
    names = some(list(dict.fromkeys(others)), _NAMED)
    belong = f"{len(others)} of them lie" if len(others) < len(gone) else "They lie"
    if len(gone) == 1:
        belong = "It lies"
    return f"{told} {belong} where {names} is: marked under another name?"
