"""How precise the ground is along a line: may one centimetre be believed here?

Between its points the ground is that of triangles over them. With weights w, of which none is
negative and the sum is one, w' C w <= sum of w s^2, however the points are correlated: the
standard deviation that is told is never smaller than that of the place on its triangle.
Source: James, Robson and Smith 2017 (precision of the points); Jensen's inequality.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.block import Layout, read_columns, values_of
from corridor.core.errors import InputError
from corridor.core.output import millimetres

if TYPE_CHECKING:
    from corridor.core.adjustment.result import Adjustment

_MOST_STATIONS = 2000
_SHOWN = 3


@dataclass(frozen=True)
class PrecisionAlong:
    """Standard deviations along a line; `print` tells them.

    table: a row a station: station (m from the first corner), x, y (m, as in the block), sh, sz (m,
    one sigma, horizontally and in height; NaN outside the points), distance (m, to the nearest
    point). required: standard deviation that is good enough, m; None: not asked. shifted: whether
    the block's offset was taken off the corners.
    """

    table: pd.DataFrame
    required: float | None = None
    shifted: bool = False

    def __str__(self) -> str:
        table, told = self.table, []
        length = table["station"].iloc[-1]
        known = table["sh"].notna().to_numpy()
        if self.shifted:
            told.append("The offset of the block was taken off the line.")
        what = f"Along the line of {length:.0f} m" if length else "At the place"
        for word, name in (("horizontally", "sh"), ("in height", "sz")):
            sigma = table[name].to_numpy()
            worst = int(np.nanargmax(sigma))
            least = f"{millimetres(np.nanmedian(sigma))}"
            if len(table) > 1:
                least += (
                    f" in the median, {millimetres(sigma[worst])} at worst, at "
                    f"{table['station'].iloc[worst]:.0f} m"
                )
            told.append(f"{what} the ground is known {word} to {least}.")
            if self.required is not None:
                told.append(self._against(word, sigma, known))
        if not known.all():
            told.append(
                f"Not known at {_ranges(table['station'].to_numpy(), ~known)}: outside the points."
            )
        return " ".join([*told, "All are standard deviations (one sigma) of the adjustment."])

    def _against(self, word: str, sigma: np.ndarray, known: np.ndarray) -> str:
        wanted = millimetres(self.required or 0.0)
        bad = known & ~(sigma <= (self.required or 0.0))
        if not bad.any():
            return f"{wanted} may be believed {word}" + (
                " everywhere." if known.all() else " where it is known."
            )
        if len(sigma) == 1 or bad[known].all():
            return f"{wanted} may not be believed {word}."
        where = _ranges(self.table["station"].to_numpy(), bad)
        return f"{wanted} may be believed {word} on {np.mean(~bad[known]):.0%}, not at {where}."


def precision_along(
    adjustment: Adjustment, corners: np.ndarray, required: float | None = None
) -> PrecisionAlong:
    """Standard deviations of the ground along a line of an adjusted block, or at one place.

    corners (n, 2): x, y, m, as in the block's files or with its offset. required: m. Stations stand
    as far apart as the points do.
    Raises InputError where the corners are no numbers, or lie beside the points.
    """
    # At first use: an adjustment does not wait for them.
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError, cKDTree

    corners = np.asarray(corners, dtype=float).reshape(len(corners), -1)[:, :2]
    if not len(corners) or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise InputError("a line is one place or more, x and y in metres; write numbers")
    places = values_of(adjustment.points, "x", "y")
    sigma = adjustment.point_sigma
    sound = np.isfinite(sigma).all(axis=1) & np.isfinite(places).all(axis=1)
    places, variance = places[sound], sigma[sound] ** 2
    variance = np.column_stack([variance[:, :2].sum(axis=1), variance[:, 2]])
    try:
        between = LinearNDInterpolator(places, variance)
    except (QhullError, ValueError):
        raise InputError(
            "fewer than three points are determined, or all lie on one line: nothing is known "
            "beside them; adjust a block with more points"
        ) from None
    nearest = cKDTree(places)
    apart = float(np.median(nearest.query(places, 2)[0][:, 1])) if len(places) > 1 else 1.0
    offset = adjustment.block.offset[:2]
    for shift in (np.zeros(2), offset):
        station, at = _stations(corners - shift, apart)
        found = between(at)
        if np.isfinite(found).any():
            break
    else:
        low, high = places.min(axis=0), places.max(axis=0)
        x, y = corners.mean(axis=0)
        raise InputError(
            f"the line lies outside the points (about x = {x:.10g}, y = {y:.10g}; theirs are x "
            f"{low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}): give it in the "
            "coordinates of the block"
        )
    table = pd.DataFrame({"station": station, "x": at[:, 0], "y": at[:, 1]})
    table[["sh", "sz"]] = np.sqrt(found)
    table["distance"] = nearest.query(at)[0]
    return PrecisionAlong(table, required, bool(shift.any()))


def read_corners(path: str | os.PathLike, least: int = 1) -> np.ndarray:
    """Corners (n, 2), m, of a CSV file with the columns x and y, in its order.

    Raises InputError where the file is missing, is no such table or has fewer rows than `least`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give a CSV table with x and y")
    corners = read_columns(path, Layout(("x", "y")))[["x", "y"]].to_numpy(float)
    wrong = np.flatnonzero(~np.isfinite(corners).all(axis=1))
    if len(wrong):
        raise InputError(f"{path}, row {wrong[0] + 2}: x and y have to be numbers")
    if len(corners) < least:
        raise InputError(f"{path}: {len(corners)} corners do not make a line; give {least} or more")
    return corners


def _stations(corners: np.ndarray, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Stations (n,) and places (n, 2): the corners, and between them as far apart as points are."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    step = max(apart, length[-1] / _MOST_STATIONS, 1e-6)
    station = np.union1d(length, np.arange(0.0, length[-1], step))
    return station, np.column_stack([np.interp(station, length, axis) for axis in corners.T])


def _ranges(station: np.ndarray, where: np.ndarray) -> str:
    """`120 to 164 m, 300 m` of the stations that are so; the first few."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    parts = [
        f"{station[a]:.0f}" + (f" to {station[b - 1]:.0f}" if b - a > 1 else "") + " m"
        for a, b in edges.reshape(-1, 2)
    ]
    more = f" and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return ", ".join(parts[:_SHOWN]) + more
