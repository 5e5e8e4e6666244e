"""How well each point is determined: angles between its rays, correlations of its coordinates.

Source: Luhmann et al., "Close-range photogrammetry and 3D imaging", section 4.4.1 (angles of
rays); DBAT prints both (Börlin and Grussenmeyer 2013).
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.problem import Problem, State

# Pairs of rays that are looked at together.
_PAIRS = 1 << 20
# Standard deviations of an angle within which it is none.
_NO_ANGLE = 3.0
# Share of the points that are left out.
_FEW = 0.1


def without_depth(system: LinearSystem, scale: float) -> set[str]:
    """Names of tie points whose rays are parallel within what they are measured to.

    scale: standard deviation of an image point in the stated one. How far such a point is nothing
    tells, and wherever it wanders a loss that limits large residuals has another valley.
    """
    p, rows = system.problem, system.image_rows
    sound = np.isfinite(rows.sigma)
    ray = np.full(len(p.point_index), np.inf)
    f = p.images.interior[rows.image[sound], 0]
    np.minimum.at(ray, rows.point[sound], rows.sigma[sound] / f)
    parallel = largest_angles(p, system.state) < _NO_ANGLE * np.sqrt(2.0) * scale * ray
    flat = parallel & ~p.point_kinds & np.isfinite(ray)
    # Where many are so the block is of another kind, and needs them.
    return set(p.point_names[flat]) if flat.sum() <= _FEW * len(flat) else set()


def largest_angles(p: Problem, state: State) -> np.ndarray:
    """Largest angle between two rays of each point (n,), rad, at most a right angle: beyond, rays
    meet the better from the other side."""
    count = np.diff(p.ptr)
    out = np.zeros(len(count))
    for rays in np.unique(count[count > 1]).tolist():
        mine = np.flatnonzero(count == rays)
        step = max(_PAIRS // rays**2, 1)
        for first in range(0, len(mine), step):
            some = mine[first : first + step]
            at = p.ptr[some][:, None] + np.arange(rays)
            away = state.points[some][:, None] - state.centre[p.img[at]]
            away /= np.linalg.norm(away, axis=2, keepdims=True)
            cosine = np.abs(away @ away.transpose(0, 2, 1)).min(axis=(1, 2))
            out[some] = np.arccos(np.clip(cosine, 0.0, 1.0))
    return out


def quality(covariance: Covariance) -> pd.DataFrame:
    """A row a point: rays, angle (the largest between two rays, degrees), correlation (the largest
    in size between two of its coordinates, NaN where nothing determines them)."""
    p = covariance.system.problem
    each = covariance.each_point
    xx, yx, yy, zx, zy, zz = each.T
    with np.errstate(invalid="ignore", divide="ignore"):
        pairs = np.stack([yx / np.sqrt(xx * yy), zx / np.sqrt(xx * zz), zy / np.sqrt(yy * zz)])
    table = pd.DataFrame({"point": p.point_index, "rays": np.diff(p.ptr)})
    table["angle"] = np.degrees(largest_angles(p, covariance.state))
    return table.assign(correlation=np.abs(pairs).max(axis=0))
