"""Standard deviations of marks and of ground control as their residuals have them, where these
contradict what is stated.

The rays of a mark's point test each other, whatever is given of that point. Of control a few wrong
points are blunders, and named; where a search for them ends in more than a third of all that are
tested, nobody is right, and it is the standard deviation that is wrong.

Source: Förstner 1979 (v'Pv / r, each group with its own redundancy), of control by the median of
the squares in the place of their mean (Rousseeuw and Leroy 1987), which a blunder does not move.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import bdtrc, chdtrc, chdtri

from corridor.core.adjustment.group_variances import (
    FACTOR,
    RARE,
    from_where_it_ended,
)
from corridor.core.adjustment.result import Adjustment
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError

Again = Callable[..., Adjustment]
_ROUNDS, _SETTLED = 4, 0.1
_LEAST = 6
# Residuals of control, in sigmas, from which on covariances are worth their time.
_LOOK = 2.5
# What all others show to less than this share of its size says nothing, nor does one of so little
# redundancy.
_SEEN, _TOLD = 0.05, 0.5


def with_ground_as_it_is(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with the standard deviations that marks, and then ground control, have, with a note
    on each; the result itself where what is stated holds."""
    for factors, told in _KINDS:
        found = result
        for _ in range(_ROUNDS):
            factor = factors(found)
            if factor == 1.0:
                break
            try:
                later = _scaled(found, factors, factor, again)
            except (InputError, AdjustmentFailed):
                break
            if not later.converged:
                break
            found = later
            if abs(np.log(factor)) < _SETTLED:
                break
        if found is not result:
            found.add_note(told(result.start, found.start))
            result = found
    return result


def ground_doubts(result: Adjustment) -> list[str]:
    """Sentences on marks, or else on ground control, whose residuals contradict what is stated."""
    for factors, told in _KINDS:
        factor = factors(result)
        if factor > 1.0:
            return [told(result.start, _restated(result.start, factors, factor))]
    return []


def _general(result: Adjustment) -> float:
    """Sigma naught of the tie points without gross errors, 1 where it is less."""
    ties = result.statistics["tie"]
    return max(ties["sigma0"], 1.0) if ties else 1.0


def _of_marks(result: Adjustment) -> float:
    """By what the standard deviations of marks are too small.

    Each point is one witness: where it is given elsewhere than it lies, all its rays are strained.
    """
    marks, general = result.statistics["mark"], _general(result)
    # A redundancy of a half or more, at a glance.
    if not result.converged or not marks or marks["sigma0"] < general:
        return 1.0
    table, scale = result.reliability.marks, result.reliability.image_scale
    square = table["w"] ** 2 * table["redundancy"] * (scale / general) ** 2
    point = table["point"].astype(str)
    return _factor(*(of.groupby(point).sum().to_numpy() for of in (square, table["redundancy"])))


def _of_control(result: Adjustment) -> float:
    """By what the standard deviations of control are too small."""
    table = result.residuals["control"]
    v = table[["vx", "vy", "vz"]].to_numpy() / table[["sx", "sy", "sz"]].to_numpy()
    if not result.converged or len(table) < 2 or not (np.abs(v) > _LOOK).sum() > len(table):
        return 1.0
    square, share = result.reliability.independent("control")
    shown = share > _SEEN
    if len(result.reliability.wrong_control) < shown.sum() // 3:
        return 1.0
    # What all observations are too large by is sigma naught's matter.
    w = (square / np.maximum(share, _SEEN))[shown] / _general(result) ** 2
    return _factor(w, np.ones(len(w)))


def _factor(square: np.ndarray, redundancy: np.ndarray) -> float:
    """By what standard deviations are too small (1: as stated) by squares (n,) with a redundancy
    each, of which the greater half is right."""
    told = redundancy > _TOLD
    if told.sum() < _LEAST:
        return 1.0
    usual = chdtri(redundancy[told], 0.5)
    ratio = square[told] / usual
    # So many beyond the limit by chance, were what is stated right.
    beyond = int((ratio > FACTOR**2).sum())
    one = chdtrc(redundancy[told], FACTOR**2 * usual).max()
    factor = float(np.sqrt(np.median(ratio)))
    return factor if factor > FACTOR and bdtrc(beyond - 1, len(ratio), one) < RARE else 1.0


def _scaled(found: Adjustment, kind: Callable, factor: float, again: Again) -> Adjustment:
    """Adjusted with standard deviations of a kind times a factor."""
    start = _restated(found.start, kind, factor)
    return from_where_it_ended(found, start, found.problem.model, again)


def _restated(block: Block, kind: Callable, factor: float) -> Block:
    block = block.copy()
    both = block.in_pictures("marks")
    if kind is _of_control:
        block.put("ground", ("sx", "sy", "sz"), block.ground_sigma() * factor)
    elif both is not None:
        block.put("marks", ("sx", "sy"), both[0] * factor)
    else:
        block.put("marks", ("sigma",), block.mark_sigma()[:, None] * factor)
    return block


def _told_marks(before: Block, after: Block) -> str:
    stated, seen = (float(np.median(one.mark_sigma())) for one in (before, after))
    return (
        "Marks: the rays of the same points contradict each other by more than the stated standard "
        f"deviation; they are good to {seen:.2g} px where {stated:.2g} px is stated. Were they "
        "measured in the pictures themselves, and in all of them the same thing? mark_px in "
        "block.toml states it."
    )


def _told_control(before: Block, after: Block) -> str:
    stated, seen = (np.median(one.ground_sigma(), axis=0) for one in (before, after))
    return (
        "Ground control: residuals contradict the stated standard deviations, and of too many "
        f"points to call single ones wrong; it is good to {seen[0]:.2g} m in plan and "
        f"{seen[2]:.2g} m in height where {stated[0]:.2g} and {stated[2]:.2g} m are stated. Either "
        "these are too small (control_m in block.toml, or sx, sy, sz of ground.csv), or the model "
        "lacks something: `corridor diagnose` finds out what."
    )


# Marks first: what strains them shows in the residuals of control.
_KINDS = ((_of_marks, _told_marks), (_of_control, _told_control))
