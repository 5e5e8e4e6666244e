"""How well each point is determined: angles between its rays, correlations of its coordinates.

Source: Luhmann et al., "Close-range photogrammetry and 3D imaging", section 4.4.1 (angles of
rays); DBAT prints both (Börlin and Grussenmeyer 2013).
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.adjustment.covariance import Covariance

# Pairs of rays that are looked at together.
_PAIRS = 1 << 20


def largest_angles(covariance: Covariance) -> np.ndarray:
    """Largest angle between two rays of each point (n,), rad, at most a right angle: beyond, rays
    meet the better from the other side."""
    p, state = covariance.system.problem, covariance.state
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
    return pd.DataFrame(
        {
            "point": p.point_index,
            "rays": np.diff(p.ptr),
            "angle": np.degrees(largest_angles(covariance)),
            "correlation": np.abs(pairs).max(axis=0),
        }
    )
