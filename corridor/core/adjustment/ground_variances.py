"""Marks and ground control that are not as good as stated, as their residuals have it.

The rays of a mark's point test each other, whatever is given of that point. Of control a few wrong
points are blunders, and named; where a search for them ends in more than a third of all that are
tested, nobody is right, and it is the standard deviation that is wrong, or the model.

Source: Förstner 1979 (v'Pv / r, each group with its own redundancy), by the median of the squares
in the place of their mean (Rousseeuw and Leroy 1987), which a blunder does not move.
"""

import numpy as np
import pandas as pd
from scipy.special import bdtrc, chdtrc, chdtri

from corridor.core.adjustment.blunders import where_seen
from corridor.core.adjustment.result import Adjustment, Again, from_where_it_ended, where_it_leads
from corridor.core.adjustment.variance_components import CONTRADICTING_FACTOR, RARE_CHANCE, general
from corridor.core.block import EXACT_M, Block, places, values_of
from corridor.core.camera import projection_derivatives

_FEWEST = 6
# So many points of one height, to the digit, are no survey's.
_FEWEST_ALIKE = 2
# Residuals of control, in sigmas, from which on covariances are worth their time.
_LOOK = 2.5
# What all others show to less than this share of its size says nothing, nor does one of so little
# redundancy.
_SEEN, _TOLD = 0.05, 0.5


def with_marks_as_they_are(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with the standard deviation that marks have, and a note on it; the result itself
    where what is stated holds."""
    factor = _of_marks(result)
    if factor == 1.0:
        return result
    start = with_mark_sigma(result.start, factor)
    found = where_it_leads(from_where_it_ended, result, start, result.problem.model, again)
    if found is None:
        return result
    found.add_note(_told_marks(result.start, factor))
    return found


def with_ground_doubts(result: Adjustment) -> Adjustment:
    """The result with a note on marks, or else on ground control, whose residuals contradict what
    is stated, and with `control_factor`."""
    # Marks first: what strains them shows in the residuals of control.
    factor = _of_marks(result)
    if factor > 1.0:
        result.add_note(_told_marks(result.start, factor))
        return result
    result.control_factor = _of_control(result)
    if result.control_factor > 1.0:
        result.add_note(_told_control(result))
    elif exact := _strained_by_exact(result):
        result.add_note(exact)
    return result


def _strained_by_exact(result: Adjustment) -> str:
    """A sentence on exact control that the marks contradict, which meet each other; or nothing."""
    given = result.residuals["control"]["sx"].to_numpy()
    marks = result.statistics["mark"]
    ratio = marks["sigma0"] / general(result) if marks else 0.0
    if not result.converged or not (given <= EXACT_M).any() or ratio < CONTRADICTING_FACTOR:
        return ""
    return (
        f"Ground control is held exactly (standard deviation 0), and its marks miss it by "
        f"{ratio:.1f} times their standard deviation, though the rays to each point meet: state "
        "how accurate the survey is (sx, sy, sz of ground.csv, or control_m in block.toml). "
        "`corridor diagnose` finds out whether a point is wrong."
    )


def _of_marks(result: Adjustment) -> float:
    """By what the standard deviations of marks are too small, where their rays meet.

    The coordinates that are given of their points have no part in it, nor what strains them: of
    the residuals is left what no other place of the point takes up.
    """
    table, p = result.residuals["mark"], result.problem
    if not result.converged or not len(table) or not len(result.start.ground):
        return 1.0
    number = places(table["point"].astype(str), result.start.ground["point"].astype(str))
    scaled = values_of(table, "vx", "vy") / values_of(table, "sigma") / general(result)
    rays, square = (np.bincount(number + 1, of)[1:] for of in (None, (scaled**2).sum(axis=1)))
    # Even with what another place of a point would take up.
    most = CONTRADICTING_FACTOR**2 * chdtri(np.maximum(2.0 * rays - 3.0, _TOLD), 0.5)
    if not (square > most).any():
        return 1.0
    at = where_seen(result.start, result.pose)
    known = (number >= 0) & np.isfinite(at).all(axis=1)[number]
    number, sigma = number[known], values_of(table, "sigma")[known]
    image = places(table["image"].astype(str)[known], pd.Series(p.images.names).astype(str))
    slope = projection_derivatives(
        at[number], result.state.centre[image], result.state.rotation[image],
        result.state.interior, p.images.camera[image],
    ).by_point  # fmt: skip
    left = scaled[known]
    _, point = np.unique(number, return_inverse=True)
    design = slope / sigma[:, :, None]

    def summed(rows: np.ndarray) -> np.ndarray:
        out = np.zeros((point.max(initial=-1) + 1, *rows.shape[1:]))
        np.add.at(out, point, rows)
        return out

    normal, right = (summed(design.transpose(0, 2, 1) @ v) for v in (design, left[..., None]))
    taken = (right.transpose(0, 2, 1) @ np.linalg.pinv(normal, hermitian=True) @ right)[:, 0, 0]
    return _factor(summed((left**2).sum(axis=1)) - taken, 2.0 * np.bincount(point) - 3.0)


def _of_control(result: Adjustment) -> float:
    """By what the standard deviations of control are too small."""
    table = result.residuals["control"]
    v = values_of(table, "vx", "vy", "vz") / values_of(table, "sx", "sy", "sz")
    if not result.converged or len(table) < 2 or not (np.abs(v) > _LOOK).sum() > len(table):
        return 1.0
    square, share = result.reliability.independent("control")
    shown = share > _SEEN
    if len(result.reliability.wrong_control) < shown.sum() // 3:
        return 1.0
    # What all observations are too large by is sigma naught's matter.
    w = (square / np.maximum(share, _SEEN))[shown] / general(result) ** 2
    return _factor(w, np.ones(len(w)))


def _factor(square: np.ndarray, redundancy: np.ndarray) -> float:
    """By what standard deviations are too small (1: as stated) by squares (n,) with a redundancy
    each, of which the greater half is right."""
    told = redundancy > _TOLD
    if told.sum() < _FEWEST:
        return 1.0
    usual = chdtri(redundancy[told], 0.5)
    ratio = square[told] / usual
    # So many beyond the limit by chance, were what is stated right.
    beyond = int((ratio > CONTRADICTING_FACTOR**2).sum())
    one = chdtrc(redundancy[told], CONTRADICTING_FACTOR**2 * usual).max()
    factor = float(np.sqrt(np.median(ratio)))
    rare = bdtrc(beyond - 1, len(ratio), one) < RARE_CHANCE
    return factor if rare and factor > CONTRADICTING_FACTOR else 1.0


def with_mark_sigma(block: Block, factor: float) -> Block:
    """The block with standard deviations of its marks times a factor."""
    block = block.copy()
    both = block.in_pictures("marks")
    if both is not None:
        block.put("marks", ("sx", "sy"), both[0] * factor)
    else:
        block.put("marks", ("sigma",), block.mark_sigma()[:, None] * factor)
    return block


def _told_marks(block: Block, factor: float) -> str:
    stated = float(np.median(block.mark_sigma()))
    return (
        "Marks: the rays to the same points miss each other by more than the stated standard "
        f"deviation: the marks are accurate to {factor * stated:.2g} px, where {stated:.2g} px is "
        "stated. Were they measured in other pictures, or not at the same spot in all of them? "
        f"Otherwise state mark_px = {factor * stated:.2g} in block.toml."
    )


def _told_control(result: Adjustment) -> str:
    plan, _, height = np.median(result.start.ground_sigma(), axis=0)
    factor, given = result.control_factor, result.problem.control_given
    given = given[: len(result.problem.control_rows)]
    same = [axis for axis, span in zip("xyz", np.ptp(given, axis=0), strict=True) if span == 0.0]
    return (
        "Ground control: the residuals of too many points contradict the stated standard "
        f"deviations to call single points wrong. The control is accurate to {factor * plan:.2g} m "
        f"horizontally and {factor * height:.2g} m in height, where {plan:.2g} and {height:.2g} m "
        "are stated. "
        + (
            f"All its points have the same {' and '.join(same)}: was one cell of ground.csv copied "
            "into the rows below it?"
            if same and len(given) > _FEWEST_ALIKE
            else "Either state that (control_m in block.toml, or sx, sy, sz of ground.csv), or the "
            "model lacks something: `corridor diagnose` finds out what."
        )
    )
