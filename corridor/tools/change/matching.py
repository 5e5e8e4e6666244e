"""Tie points that are worse than free errors, which a sum of squares takes all of them for.

Gross ones decide how large all residuals are, and draw the camera after them where a pattern
repeats and many are wrong in one direction.

A point that is matched from one strip to the next is off by the same in all pictures of a strip: it
looks another way from there, or lies at their rims. What holds the strips together is then known
worse than so many free errors would say, and with it all that hangs on the shape of the block. With
v the residuals of a point, e their errors, H what its place takes up (poses held),

    v = (I - H) e,   sum over strips of n |mean v|^2 = sum of (2 - tr(B N^-1 B') / n)

is expected of errors of unit variance; B: the sum over a strip of A, the picture of a point by its
place; N: the sum of A'A. More than that over the same of what is left within the strips is the
overdispersion of the means of strips.

Source: Förstner 1979 (variance components). Wedderburn 1974 (overdispersion).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import f

from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.core.output import counted
from corridor.core.preparation import strips_of

# Level of the test that matches between strips are the worse ones.
FALSE_ALARM = 1e-3
# Sigma naught of all over that without gross errors, from which on these decide it.
RULED = 1.5


def without_gross_ties(found: Adjustment, again: Callable[[Block], Adjustment]) -> Adjustment:
    """Adjusted again without tie points of gross errors, where these decide how large all residuals
    are; else the same.

    Which ray of a point is the wrong one is not told: all of them go. Under a robust loss gross
    errors decide nothing.
    """
    gone = 0
    while found.converged and found.system.loss.kind == 0 and found.statistics["tie"]:
        ties, table = found.statistics["tie"], found.residuals["tie"]
        if not ties["gross"] or found.sigma0 < RULED * max(ties["sigma0"], 1.0):
            break
        wrong = set(table.loc[table["gross"], "point"])
        part, gone = found.start.copy(), gone + len(wrong)
        sound = ~part.tie_points["point"].isin(wrong)
        part.tie_points = part.tie_points[sound].reset_index(drop=True)
        found = again(part)
    if gone:
        found.add_note(
            f"{counted(gone, 'tie point')} with gross errors, which made all residuals larger, do "
            "not count: look for repeated patterns and moving things in the photographs."
        )
    return found


def between_strips(adjustment: Adjustment) -> float:
    """By what sigma naught grows for what holds strips together; 1 where that is chance."""
    table = adjustment.residuals["tie"]
    table = table[~table["outlier"]]
    block, system = adjustment.block, adjustment.system
    every = block.images["image"].astype(str).to_numpy()
    strip_of = {name: n for n, (_, mine) in enumerate(strips_of(block)) for name in every[mine]}
    points = system.points
    every_name, ties = points.names, np.flatnonzero(~points.mark)
    place_of = dict(zip(every_name[ties].astype(str), ties.tolist(), strict=True))
    centre_of = dict(zip(every, block.poses[:, :3], strict=True))
    names, image = table["point"].astype(str), table["image"].astype(str)
    if not len(table) or len(set(strip_of.values())) < 2:
        return 1.0
    point = names.map(place_of).to_numpy()
    strip = image.map(strip_of).fillna(-1).to_numpy(int)
    _, group, count = np.unique(
        np.column_stack([point, strip]), axis=0, return_inverse=True, return_counts=True
    )
    group = group.ravel()
    of = np.zeros(len(count), int)
    of[group] = point
    shared = np.bincount(of, minlength=len(every_name)) > 1
    rows, groups = shared[point], shared[of]
    away = system.state.points[point] - np.array([centre_of[name] for name in image])
    far = np.linalg.norm(away, axis=1)[:, None, None]
    along = away[:, :, None] / far
    picture = (np.eye(3) - along * along.transpose(0, 2, 1)) / far
    # Of unit variance: each row by its own standard deviation.
    sigma = table["sigma"].to_numpy()
    normal = _sums(picture @ picture, point, len(shared))[of[groups]]
    inside = _sums(picture, group, len(count))[groups]
    taken = np.einsum("gij,gjk,gik->g", inside, np.linalg.pinv(normal, hermitian=True), inside)
    free = float(np.sum(2.0 - taken / count[groups]))
    left = table[["vx", "vy"]].to_numpy() / sigma[:, None]
    mean = np.column_stack([np.bincount(group, left[:, k]) for k in (0, 1)]) / count[:, None]
    square = float(np.sum(count[groups, None] * mean[groups] ** 2))
    within = float(np.sum(left[rows] ** 2)) - square
    others = 2.0 * rows.sum() - 3.0 * shared.sum() - free
    if free < 1.0 or others < 1.0:
        return 1.0
    ratio = (square / free) / (within / others)
    if f.sf(ratio, free, others) > FALSE_ALARM:
        return 1.0
    return float(np.sqrt(ratio))


def _sums(parts: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, 3, 3) of matrices (n, 3, 3) by group."""
    out = np.zeros((count, 3, 3))
    np.add.at(out, group, parts)
    return out
