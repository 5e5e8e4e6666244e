"""Does the added effect help where the fit has not looked?

Some tie observations are given no weight, one of a point of four rays or more, in both fits; the
check points never have any. GNSS residuals are those of the fits.
"""

from __future__ import annotations

import numpy as np

from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.diagnosis.settings import SETTINGS
from corridor.geometry import UNUSABLE, is_outlier, robust_scale_of_lengths


def hold_out(block: Block, rng: np.random.Generator) -> tuple[Block, np.ndarray]:
    """The block with some tie observations robbed of their weight, and their rows (k,).

    Points that control the marks are not touched, and every image keeps most of its points.
    """
    ties = block.tie_points
    codes = ties["point"].cat.codes.to_numpy()
    rays = np.bincount(codes, minlength=len(ties["point"].cat.categories))
    order = rng.permutation(np.flatnonzero(rays[codes] >= SETTINGS.held_out_rays))
    _, first = np.unique(codes[order], return_index=True)
    chosen = rng.permutation(order[first])[: max(int(SETTINGS.held_out_share * len(ties)), 1)]
    chosen = np.sort(chosen)
    out = block.copy()
    sigma = block.tie_sigma().copy()
    sigma[chosen] *= SETTINGS.held_out_sigma
    out.tie_points = ties.assign(sigma=sigma)
    return out, chosen


def preferred(
    second: Adjustment, rivals: dict[str, Adjustment], rows: np.ndarray
) -> tuple[str | None, dict[str, dict[str, float]]]:
    """The rival that does clearly better than `second` where no fit has looked, None without one.

    Check points decide where there are enough of them, tie observations held out where not. Also
    the error of each rival over that of `second`: `tie`, `check`.
    """
    share: dict[str, dict[str, float]] = {}
    many = len(second.check_points) >= SETTINGS.enough_checks
    for key, fit in rivals.items():
        share[key] = {}
        if many:
            share[key]["check"] = float(fit.check_rms.d3 / second.check_rms.d3)
        found = tie_gap(second, fit, rows)
        if found["before"]:
            share[key]["tie"] = found["after"] / found["before"]
    kind, limit = (
        ("check", SETTINGS.clear_ratio_checks) if many else ("tie", SETTINGS.clear_ratio_ties)
    )
    known = {key: one[kind] for key, one in share.items() if kind in one}
    best = min(known, key=known.get, default=None)
    return (best if best is not None and known[best] < limit else None), share


def best_by_far(second: Adjustment, fits: dict[int, Adjustment]) -> int | None:
    """The fit with less than half the check-point error of `second`, None without one."""
    limit = SETTINGS.clear_ratio_shape * second.check_rms.d3
    best = min(fits, key=lambda n: fits[n].check_rms.d3, default=None)
    return best if best is not None and fits[best].check_rms.d3 < limit else None


def improves(without: Adjustment, with_it: Adjustment, rows: np.ndarray) -> bool:
    """Whether held-out ties are predicted better, and check points, where many, no worse."""
    if len(with_it.check_points) >= SETTINGS.enough_checks:
        if SETTINGS.clear_ratio_checks * with_it.check_rms.d3 > without.check_rms.d3:
            return False
    found = tie_gap(without, with_it, rows)
    return bool(found["after"] < found["before"])


def tie_gap(before: Adjustment, after: Adjustment, rows: np.ndarray) -> dict[str, float | None]:
    """RMS (px, an axis) of observations that both fits did not use, wrong matches left out."""
    found = [_residuals(one)[rows] for one in (before, after)]
    if not len(rows):
        return {"before": None, "after": None}
    length = np.hypot(*found[1].T)
    good = np.isfinite(length) & ~is_outlier(length, robust_scale_of_lengths(length), UNUSABLE)
    values = [float(np.sqrt(np.mean(one[good] ** 2))) for one in found]
    return {"before": values[0], "after": values[1]}


def _residuals(adjustment: Adjustment) -> np.ndarray:
    p = adjustment.problem
    found, _ = adjustment.normal.look(adjustment.state, passes=5)
    out = np.full((len(p.block.tie_points) + len(p.block.marks), 2), np.nan)
    out[p.row] = found
    return out


def check_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of check points, m; None without any."""
    if not len(before.check_points):
        return None
    return {"before": float(before.check_rms.d3), "after": float(after.check_rms.d3)}


def gnss_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of the antenna residuals, m; None without GNSS."""
    if not len(before.problem.gnss_image):
        return None

    def rms(one):
        table = one.residuals["gnss"]
        return float(np.sqrt(np.mean((table[["vx", "vy", "vz"]].to_numpy() ** 2).sum(axis=1))))

    return {"before": rms(before), "after": rms(after)}


def closure(before: float, after: float, floor: float) -> float | None:
    """Share of the excess variance that is gone: (before^2 - after^2) / (before^2 - floor^2)."""
    excess = before**2 - floor**2
    return float((before**2 - after**2) / excess) if excess > 0 else None
