"""Which antenna positions are false: a lost fix, a float solution, a block of either.

What the best part of a flight says of all decides which part is best, and the rest is weighted by
what it misses, or taken out.

Source: Rousseeuw and Van Driessen 1999, "A fast algorithm for the minimum covariance determinant
estimator" (concentration).
"""

import numpy as np
from scipy.special import chdtri

from corridor.core.adjustment.cofactors import of_antennas
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.result import Adjustment, Again, from_where_it_ended, where_it_leads
from corridor.core.adjustment.variance_components import (
    CONTRADICTING_FACTOR,
    contradicting,
    flights_of,
    restate,
)
from corridor.core.block import values_of
from corridor.core.errors import some
from corridor.core.geometry import OUTLIER
from corridor.core.output import counted

# The share of positions that a block of false ones leaves; the first half-sample by concentration.
_BEST, _STEPS = 0.6, 6
# Positions that say nothing: their sigmas times this.
_SILENT = 1e3


def false_positions(result: Adjustment, again: Again) -> np.ndarray | None:
    """Which antenna positions (k,) of an adjustment are false, where some flight's contradict what
    is stated and the greater part of them agrees; else None."""
    doubtful = contradicting(result)
    if not doubtful:
        return None
    return _concentrated(result, again, sorted({flight for _, flight in doubtful}))


def without_false_fixes(result: Adjustment, again: Again, stated: np.ndarray) -> Adjustment:
    """Adjusted again without the outliers among the antenna positions, until none is left.

    A block of false ones draws the others after it, and is found by what these say without it.
    stated (k, 3): standard deviations, m, of all positions; those that already have others since
    they are gross errors are outliers too.
    """
    apart = result.start.gnss["image"][(result.start.gnss_sigma() > stated).any(axis=1)]
    rejected: dict[str, float] = {}
    for _ in range(10):
        table = result.residuals["gnss"]
        false = false_positions(result, again)
        wrong = table["outlier"] if false is None else false
        gone = table[wrong | table["image"].isin(apart)]
        if not len(gone) or len(gone) > len(table) / 2:
            break
        lengths = np.linalg.norm(gone[["vx", "vy", "vz"]], axis=1)
        rejected |= dict(zip(gone["image"], lengths.tolist(), strict=True))
        block = result.start.copy()
        block.gnss = block.gnss[~block.gnss["image"].isin(list(rejected))].reset_index(drop=True)
        result = again(block)
    if rejected:
        many = counted(len(rejected), "antenna position")
        result.add_note(
            f"{many} rejected as false fix{'es' * (len(rejected) > 1)}, residual up to "
            f"{max(rejected.values()):.2f} m ({some(rejected, 5)})."
        )
    return result


def false_apart(
    result: Adjustment,
    again: Again,
    flights: list[str],
    notes: list[str],
    model: Model | None = None,
) -> Adjustment:
    """Adjusted with the false positions among those of some flights weighted by what they miss.

    Found by concentration: the best part of each flight decides, and which part is best follows
    from what it says of all. Nothing is taken for false where the rest does not agree with itself.
    model: of what is adjusted then, where the result is of one that holds what may be wrong: the
        rest need agree with itself there only; default: that of the result.
    """
    false = _concentrated(result, again, flights, held=model is not None)
    model = result.problem.model if model is None else model
    if false is None or not false.any():
        return result
    lone = result.residuals["gnss"]["image"].astype(str).to_numpy()
    start = result.start.copy()
    rows = start.gnss["image"].astype(str).isin(set(lone[false])).to_numpy()
    silent = start.copy()
    restate(silent, rows, slice(0, 3), _SILENT)
    apart = where_it_leads(from_where_it_ended, result, silent, model, again)
    if apart is None or len(apart.residuals["gnss"]) != len(lone):
        return result
    table = apart.residuals["gnss"]
    miss = table.loc[false, ["vx", "vy", "vz"]].to_numpy()
    sigma = result.residuals["gnss"].loc[false, ["sx", "sy", "sz"]].to_numpy()
    size = np.sqrt(np.mean((miss / sigma) ** 2))
    restate(start, rows, slice(0, 3), max(size, 1.0))
    found = from_where_it_ended(apart, start, model, again)
    if not found.converged:
        return result
    notes.append(_told_false(lone[false], miss, size))
    return found


def _concentrated(
    result: Adjustment, again: Again, flights: list[str], held: bool = False
) -> np.ndarray | None:
    """Which antenna positions (k,) are false; None where their rest does not agree with itself.

    Begun with the part that fits best; where that ends nowhere, without each part of the flights
    in turn: false positions follow each other, and may have drawn all others after them.
    """
    mine = np.isin(flights_of(result), flights)
    sigma = values_of(result.residuals["gnss"], "sx", "sy", "sz")
    images = result.system.images
    taken = images.time[result.system.gnss.image] if np.isfinite(images.time).all() else None
    rows = np.flatnonzero(mine)
    if taken is not None:
        rows = rows[np.argsort(taken[rows], kind="stable")]
    count = len(rows) - int(np.ceil(_BEST * len(rows)))
    by_fit = np.flatnonzero(mine)[np.argsort(-lengths(result, sigma)[mine], kind="stable")]
    # Parts that overlap by half.
    begun = range(0, len(rows) - count + 1, max(count // 2, 1))
    parts = [by_fit[:count], *(rows[k : k + count] for k in begun)]
    # With all of them; the rest agrees with itself, or at least far better than all do.
    limit = max(CONTRADICTING_FACTOR, _scale(lengths(result, sigma)[mine]) / CONTRADICTING_FACTOR)
    least, found = np.inf if held else limit, None
    for part in parts:
        best = np.ones(len(mine), bool)
        best[part] = False
        false, scale = _concentrated_from(best, mine, sigma, result, again)
        if scale < least:
            least, found = scale, false
        if scale < CONTRADICTING_FACTOR:
            break
    return found


def _scale(length: np.ndarray) -> float:
    """Size of positions in their sigmas by the best six tenths of their lengths, chi of three."""
    return float(np.sqrt(np.quantile(length**2, _BEST) / chdtri(3, 1.0 - _BEST)))


def _concentrated_from(
    best: np.ndarray, mine: np.ndarray, sigma: np.ndarray, result: Adjustment, again: Again
) -> tuple[np.ndarray, float]:
    """The same, begun with some (k,) of the positions that are looked at, and all others; and the
    size of the rest, infinite where it is not the greater part."""
    names = result.residuals["gnss"]["image"].astype(str).to_numpy()
    found = result
    for _ in range(_STEPS):
        start = result.start.copy()
        out = start.gnss["image"].astype(str).isin(set(names[~best])).to_numpy()
        restate(start, out, slice(0, 3), _SILENT)
        later = where_it_leads(from_where_it_ended, found, start, result.problem.model, again)
        # Images that were left out on the way took their positions with them.
        if later is None or len(later.residuals["gnss"]) != len(names):
            return ~best, np.inf
        found = later
        length = lengths(found, sigma)
        scale = _scale(length[mine])
        before, best = best, ~mine | (length < OUTLIER * max(scale, 1.0))
        if (best == before).all():
            break
    return ~best, scale if (~best).sum() <= (1.0 - _BEST) * mine.sum() else np.inf


def lengths(found: Adjustment, sigma: np.ndarray) -> np.ndarray:
    """Residuals (k,) of the antenna positions in their own sigmas, all axes together, where the
    positions are good to sigma (k, 3), m; some may count for nothing in what is found."""
    table = found.residuals["gnss"]
    v, used = values_of(table, "vx", "vy", "vz"), values_of(table, "sx", "sy", "sz")
    share, p = of_antennas(found.covariance), found.problem
    back = np.linalg.inv(np.sqrt(p.gnss_weight)[:, :, None] * p.gnss_turn)
    silent = np.any(used > 2.0 * sigma, axis=1)
    own = (sigma / used)[:, :, None] * back
    # What counts has part in its own prediction; what does not is predicted by all others.
    across = back.transpose(0, 2, 1)
    left_out = back @ (np.eye(3) - share) @ across + own @ own.transpose(0, 2, 1)
    variance = np.where(silent[:, None, None], left_out, back @ share @ across)
    variance += 1e-6 * np.eye(3) * (sigma**2)[:, :, None]
    return np.sqrt(np.einsum("ni,ni->n", v, np.linalg.solve(variance, v[:, :, None])[:, :, 0]))


def _told_false(names: np.ndarray, miss: np.ndarray, size: float) -> str:
    middle = np.median(miss, axis=0)
    together = np.linalg.norm(miss - middle, axis=1).mean() < 0.5 * np.linalg.norm(middle)
    vector = ", ".join(f"{value:+.2f}" for value in middle)
    by = (
        f"by one vector ({vector} m)"
        if together and len(names) > 2
        else f"by {'up to ' * (len(names) > 1)}{np.linalg.norm(miss, axis=1).max():.2f} m"
    )
    cause = (
        ": a float solution, or a lost fix?"
        if len(names) > 2
        else ": a false fix, or another crop of the picture?"
    )
    one = len(names) == 1
    aside = (
        f"It is set aside, with a standard deviation {size:.0f} times as large; --reject-gnss "
        "takes it out."
        if one
        else f"They are set aside, with standard deviations {size:.0f} times as large; "
        "--reject-gnss takes them out."
    )
    return (
        f"{counted(len(names), 'GNSS position')} disagree{'s' * one} with all others {by}, "
        f"{size:.0f} times the stated standard deviations ({some(list(names), 5)}){cause} {aside}"
    )
