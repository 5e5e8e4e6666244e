"""The picture is shifted on one side of a line, by more than a fit believes a match to be off.

Two observations of one point that lie close together in the picture, one on either side of a line,
differ by noise; by the shift where the line is the rim of a pane. For upright and level lines all
over the picture the pairs that jump by more than `outlier_scales` in one direction are counted. By
chance as many would as at all other lines, and as many as in the other direction. Two images are
matched in one go, and where they go wrong many of their points do so alike: in the end it is pairs
of images that count, each by the median of its points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binom

from corridor.adjustment import Adjustment
from corridor.diagnosis.findings import Unknown
from corridor.diagnosis.outliers import Ties, ties_by_camera
from corridor.diagnosis.settings import SETTINGS
from corridor.effects import every_effect


@dataclass(frozen=True)
class Line:
    """What jumps at a line: pairs of `of` that cross it. log_p: of chance, over all lines."""

    axis: int
    at: float
    jumped: int
    of: int
    shift: np.ndarray
    log_p: float


def shows_as() -> list[str]:
    """Slugs of the effects of the catalogue that a broken picture may be told as."""
    return [effect.slug for effect in every_effect() if effect.sudden]


def broken_picture(adjustment: Adjustment) -> Unknown | None:
    """The line at which the picture is broken, or none.

    It is told as the first sudden effect of the catalogue; without one nothing is.
    """
    if not shows_as():
        return None
    found = [(line, ties) for ties in ties_by_camera(adjustment) if (line := _worst(ties))]
    if not found:
        return None
    line, ties = min(found, key=lambda one: one[0].log_p)
    first = ties.place[:, line.axis] < line.at
    # A pane covers the side on which less is seen.
    low, high = np.zeros(2), ties.size - 1
    (high if first.mean() < 0.5 else low)[line.axis] = line.at
    # No minus before a zero.
    dx, dy = np.round(line.shift, 1) + 0.0
    name, way = ("x", "upright") if line.axis == 0 else ("y", "level")
    where = (
        f"across the {way} line {name} = {line.at:.0f} px, where {line.jumped} of {line.of} points "
        f"that are seen on both sides of it jump by x = {dx:.1f}, y = {dy:.1f} px"
    )
    location = {"image": [*low.tolist(), *high.tolist()]}
    return Unknown(shows_as()[0], "unknown", -line.log_p, where, location, "none")


def _worst(ties: Ties) -> Line | None:
    """The line that is the least likely by chance, where that is beyond the level."""
    longer = float(ties.size.max())
    tested, best = 0, None
    for axis in (0, 1):
        order = np.lexsort((ties.place[:, axis], ties.point))
        place, point = ties.place[order, axis], ties.point[order]
        near = np.flatnonzero(
            (point[1:] == point[:-1]) & (place[1:] - place[:-1] < SETTINGS.line_reach * longer)
        )
        count = int(round(SETTINGS.lines * ties.size[axis] / longer))
        lines = np.arange(1, count) / count * (ties.size[axis] - 1)
        below = np.searchsorted(lines, place[near])
        above = np.searchsorted(lines, place[near + 1])
        one, other = order[near], order[near + 1]
        jump = ties.residual[other] - ties.residual[one]

        def crossing(which, below=below, above=above, count=count):
            begun = np.bincount(below[which], minlength=count)
            return np.cumsum(begun - np.bincount(above[which], minlength=count))[: count - 1]

        every = crossing(np.ones(len(near), dtype=bool))
        for along in (0, 1):
            ways = [sign * jump[:, along] > SETTINGS.outlier_scales for sign in (1, -1)]
            counts = [crossing(way) for way in ways]
            usual = 0.5 * sum(k.sum() for k in counts) / max(every.sum(), 1)
            for sign, (way, mine, against) in enumerate(
                zip(ways, counts, counts[::-1], strict=True)
            ):
                # Noise that is larger at this place jumps the other way as often.
                chance = (against + SETTINGS.line_prior_pairs * usual) / (
                    every + SETTINGS.line_prior_pairs
                )
                chance = np.maximum(usual, chance)
                log_p = binom.logsf(mine - 1, every, np.minimum(chance, 1.0))
                tested += len(lines)
                log_p[mine < SETTINGS.line_share * every] = 0.0
                k = int(np.argmin(log_p))
                over = (below <= k) & (k < above)
                if len(np.unique(ties.image[other[over & way]])) < SETTINGS.line_images:
                    continue
                pairs = np.column_stack([ties.image[one[over]], ties.image[other[over]]])
                jumped, of = _of_images(pairs, jump[over, along], (1, -1)[sign])
                chance_of_all = float(binom.logsf(jumped - 1, of, min(chance[k], 1.0)))
                if jumped < SETTINGS.line_share * of:
                    continue
                if best is not None and chance_of_all >= best.log_p:
                    continue
                px = (jump * ties.scale_px[other][:, None])[over]
                best = Line(
                    axis,
                    float(lines[k]),
                    int(mine[k]),
                    int(every[k]),
                    np.median(px, axis=0),
                    chance_of_all,
                )
    if best is None:
        return None
    best = replace(best, log_p=best.log_p + float(np.log(tested)))
    return best if best.log_p < np.log(SETTINGS.outlier_level) else None


def _of_images(pairs: np.ndarray, jump: np.ndarray, sign: int) -> tuple[int, int]:
    """Pairs of images whose points jump one way, and all: pairs (n, 2), jump (n,) in scales."""
    _, number = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    count = int(number.max(initial=-1)) + 1
    middle = np.array([np.median(jump[number == k]) for k in range(count)])
    return int((sign * middle > SETTINGS.outlier_scales).sum()), count
