"""Gross errors that least squares do not get over: marks of another point, exchanged positions.

Squares share one gross error out among everything, and a focal length of a tenth of its size may be
what fits it best. A few such measurements are found by an adjustment that they cannot rule, named,
and set aside; where that does not make the rest fit, they are not what is wrong.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from corridor.core.adjustment.blunders import exchanged_points
from corridor.core.adjustment.false_positions import false_apart, lengths
from corridor.core.adjustment.gross_ground import (
    OF_THREE,
    looked_at,
    suspicious,
    told_marks,
    with_ground_apart,
    with_named_control_apart,
    without_marks,
    wrong_marks,
)
from corridor.core.adjustment.left_out import adjustable_part
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.result import Adjustment, Again, where_it_leads
from corridor.core.adjustment.variance_components import CONTRADICTING_FACTOR
from corridor.core.adjustment.warnings import implausible
from corridor.core.block import Block, values_of
from corridor.core.errors import AdjustmentFailed, InputError, some
from corridor.core.geometry import GROSS, OUTLIER, robust_scale
from corridor.core.output import counted

# More than this share of the marks, or of the positions of a flight, is no handful.
_MOST = 0.4
# A position is off alone from here on, in its sigmas, and among so many times as many others.
_ALONE, _LONE = 2.0 * OUTLIER, 0.05
# Images are odd among so many that have so many tie points each.
_IMAGES, _ENOUGH = 8, 20
_ROUNDS = 4
_FEW = 3


def without_gross_errors(result: Adjustment, again: Again, strict: bool = False) -> Adjustment:
    """Adjusted without gross errors in marks and antenna positions, where that makes all else fit.

    The result itself where it holds none, or they are no handful. Positions keep a row, with a
    standard deviation of their own size. strict: no mark and no image goes.
    """
    found = result
    for _ in range(_ROUNDS):
        notes: list[str] = []
        try:
            better = _without_positions(found, again, notes)
            if not strict:
                whole = _without_images(found, better, again, notes)
                better = better if whole is None else _without_positions(whole, again, notes)
                better = _without_marks(better, again, notes)
        except (InputError, AdjustmentFailed):
            break
        if better is found or not better.converged:
            break
        better.add_note(*notes)
        found = better
    return found


def begun_with_sound_positions(
    block: Block, model: Model, again: Again, strict: bool = False, snooped: bool = False
) -> Adjustment:
    """Adjusted; where it runs away, or half of the positions miss grossly, without those that are
    false beside the stated camera, if the others are then as good as they are stated.

    A third of a flight that is metres off draws all others after it, the arm and a free focal
    length, which may become a hundred times as long, at once or with a robust loss. They cannot do
    so where both are held. An effect that is missing is in all positions, and leaves none right.
    snooped: a control point that a test of all coordinates names is set aside too.
    Raises what the adjustment does, where that does not help.
    """
    first: Adjustment | InputError | AdjustmentFailed
    try:
        first = again(block, model)
    except (InputError, AdjustmentFailed) as failure:
        first = failure
    if not strict and (isinstance(first, Exception) or suspicious(first)):
        first = _with_ground_apart(first, block, model, again, snooped)
    most = np.inf
    if not isinstance(first, Exception):
        block = first.start
        if first.converged and not implausible(first):
            if _miss(first) < GROSS:
                return first
            most = OF_THREE * CONTRADICTING_FACTOR
    fixed, held = replace(model, camera="fixed", lever_arm="fixed"), None
    if fixed != model:
        held = where_it_leads(again, block, fixed)
    elif not isinstance(first, Exception) and first.converged:
        held = first
    if held and most == np.inf and not strict:
        # An image that misses may make what it likes of a focal length that nothing else shows.
        told: list[str] = []
        whole = _without_images(held, held, again, told, model)
        if whole is not None:
            whole.add_note(*told)
            return whole
    # The free camera is that of the block where the positions are off by less.
    alone = isinstance(first, Exception) or most == np.inf or held is first
    for begun in (held,) if alone else (first, held):
        notes: list[str] = []
        found = begun and where_it_leads(_without_positions, begun, again, notes, model)
        if found and found is not begun and _miss(found) < most and not implausible(found):
            found.add_note(*notes)
            return found
    if isinstance(first, Exception):
        raise first
    return first


def _with_ground_apart(
    first: Adjustment | InputError | AdjustmentFailed,
    block: Block,
    model: Model,
    again: Again,
    snooped: bool,
) -> Adjustment | InputError | AdjustmentFailed:
    """The first, or adjusted with wrong ground points and marks set aside where that fits."""
    begun = None if isinstance(first, Exception) else first
    sound = begun if begun and begun.converged and not implausible(begun) else None
    found: Adjustment | None = None
    notes: list[str] = []
    with suppress(InputError, AdjustmentFailed):
        found, notes = with_ground_apart(block, model, again)
    if found is not None:
        gone = len(block.marks) - len(found.start.marks)
        gone += int((found.start.ground_sigma() > block.ground_sigma()).any(axis=1).sum())
        fits = sound is None or _square(sound) - _square(found) > GROSS**2 * gone
        # Exchanged points that are set aside are exchanged still.
        if not fits or len(implausible(found)) > len(found.exchanged):
            found, notes = None, []
    if found is None and sound and snooped:
        # Of two parties that contradict each other at a rough look one point may be told to be it.
        most = 1 if notes else max(len(sound.problem.control_rows) // 3, 1)
        found, told = with_named_control_apart(sound, again, most)
        notes = told or notes
    found = found or begun
    if found is None:
        return first
    found.add_note(*notes)
    return found


def _miss(found: Adjustment) -> float:
    """Median length by which positions miss, in their standard deviations; 0 without any."""
    table = found.residuals["gnss"]
    miss = values_of(table, "vx", "vy", "vz") / values_of(table, "sx", "sy", "sz")
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
    sigma = values_of(table, "sx", "sy", "sz")
    size = np.linalg.norm(values_of(table, "vx", "vy", "vz") / sigma, axis=1)
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
        scaled = mine / max(np.median(mine) / OF_THREE, 1.0)
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


def _without_images(
    before: Adjustment,
    found: Adjustment,
    again: Again,
    notes: list[str],
    free: Model | None = None,
) -> Adjustment | None:
    """Adjusted from where all began without the few images whose own tie points fit far worse than
    those of others, in place of what is found; None where there are none.

    found: with their positions set aside, which such an image draws with it. free: the model to go
    on with, where both are of one whose camera and arm are held.
    """
    lone = (found.start.gnss_sigma() > before.start.gnss_sigma()).any(axis=1)
    doubted = set(found.start.gnss["image"][lone].astype(str))
    model = free or before.problem.model
    block, worse = before.start, 1.0
    gone: list[str] = []
    told: list[str] = []
    while (odd := _odd_image(found, doubted, again)) is not None:
        if len(gone) >= max(_LONE * len(before.start.images), 1.0):
            return None
        gone.append(odd[0])
        worse = max(worse, odd[1])
        others = before.start.images["image"]
        block = before.start.select(images=others[~others.astype(str).isin(gone)])
        block, told = adjustable_part(block, model)
        whole = where_it_leads(again, block, model)
        if whole is None or implausible(whole):
            return None
        found, doubted = whole, set()
    # What the model lacks bends some images more than others.
    if not gone or found.sigma0 > CONTRADICTING_FACTOR:
        return None
    notes[:] = [
        f"{counted(len(gone), 'image')} left out ({some(gone, 5)}): "
        f"{'its' if len(gone) == 1 else 'their'} tie points fit {worse:.1f} times worse than those "
        "of other images. Another crop or size of the picture, or another picture?",
        *told,
    ]
    return found


def _odd_image(
    found: Adjustment, doubted: set[str], again: Again | None = None
) -> tuple[str, float] | None:
    """The image whose tie points fit far worse than those of others, and by what; None: none does.

    doubted: images whose positions contradict all others too, which makes less enough. again: asked
    for a robust fit where squares have shared out what one image may miss by.
    """
    ties = found.residuals["tie"]
    length = np.hypot(ties["vx"], ties["vy"]) / ties["sigma"]
    # The median of each: single wrong matches make no image odd. Nor is one that is as stated.
    by_image = length.groupby(ties["image"].astype(str))
    size = np.log(by_image.median()[by_image.size() >= _ENOUGH].clip(lower=1e-9))
    if len(size) < _IMAGES:
        return None
    # How far images differ is seen below what is stated too: what a model lacks is in some more.
    scale = robust_scale((size - size.median()).to_numpy())
    size = size.clip(lower=0.0)
    above = size - size.median()
    name = str(above.idxmax())
    sigmas, least = (_FEW, 1.0) if name in doubted else (OUTLIER, CONTRADICTING_FACTOR)
    if above[name] < np.log(least):
        return None
    if above[name] < sigmas * scale:
        robust = None
        if again and name not in doubted:
            robust = looked_at(again, found.start, found.problem.model)
        return _odd_image(robust, doubted) if robust else None
    return name, float(np.exp(above[name]))


def _exchanged(found: Adjustment) -> list[str]:
    """A sentence on positions each of which is that of the other image."""
    table = found.residuals["gnss"]
    given = found.problem.gnss_given
    seen = given - values_of(table, "vx", "vy", "vz")
    names = table["image"].astype(str).tolist()
    pairs = [f"{names[i]} and {names[j]}" for i, j in exchanged_points(given, seen)]
    if not pairs:
        return []
    return [
        f"Of the GNSS positions set aside some are exchanged: {'; '.join(pairs)}. Are the images "
        "in order?"
    ]


def _without_marks(result: Adjustment, again: Again, notes: list[str]) -> Adjustment:
    marks = result.residuals["mark"]
    if not len(marks) or not marks["outlier"].any():
        return result
    block, model = result.start, result.problem.model
    robust = looked_at(again, block, model)
    if robust is None:
        return result
    table = robust.residuals["mark"]
    wrong = wrong_marks(table)
    if not wrong.any() or wrong.sum() > _MOST * len(wrong):
        return result
    gone = table[wrong]
    length = np.hypot(gone["vx"], gone["vy"]).to_numpy() / gone["sigma"].to_numpy()
    found = again(without_marks(block, gone), model)
    # Squares that fit with them bear them: the marks are told among the outliers. A few that are
    # gross, or those of a few images, are what is wrong where nearly all of what they miss goes
    # with them.
    before, after = _square(result), _square(found)
    few = min(wrong.sum(), gone["image"].nunique()) <= _FEW
    if not (few and before - after > 0.5 * float((length**2).sum())):
        if not after < before / CONTRADICTING_FACTOR**2:
            return result
    notes.append(told_marks(robust, gone))
    return found
