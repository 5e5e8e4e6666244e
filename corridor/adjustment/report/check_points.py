"""What the check points say, which the adjustment has not seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from corridor.adjustment.report.numbers import counted, fixed, metre_digits, short
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_DIFFERENCES, _SIGMAS = ["dx", "dy", "dz"], ["sx", "sy", "sz"]
_MOST = 20


def check_points(adjustment: Adjustment) -> Table | None:
    """The check points one by one, of many the largest."""
    frame = adjustment.check_points
    if not len(frame):
        return None
    differences = frame[_DIFFERENCES].to_numpy(dtype=float)
    digits = metre_digits(differences)
    notes = ["metres, adjusted minus given; sigma of the adjusted point"]
    if len(frame) > _MOST:
        size = np.linalg.norm(differences, axis=1)
        left_out = counted(len(frame) - _MOST, "smaller one")
        notes.append(f"the {_MOST} largest; {left_out} left out")
        frame = frame.iloc[np.sort(np.argsort(-size, kind="stable")[:_MOST])]
    numbers = frame[_DIFFERENCES + _SIGMAS].to_numpy(dtype=float)
    rows = [
        (short(name), *(fixed(value, digits) for value in values), f"{rays:,}")
        for name, values, rays in zip(frame["point"], numbers, frame["rays"], strict=True)
    ]
    header = ("check point", "dx", "dy", "dz", "sigma x", "sigma y", "sigma z", "images")
    return Table("Check points", header, tuple(rows), "lrrrrrrr", tuple(notes))


def check_statistics(adjustment: Adjustment) -> Table | None:
    """RMS, mean and STD of all check points, in plan, height and space."""
    count = len(adjustment.check_points)
    if not count:
        return None
    digits = metre_digits(adjustment.check_points[_DIFFERENCES])
    statistics = {
        "RMS": adjustment.check_rms,
        "mean": adjustment.check_mean,
        "STD": adjustment.check_std,
    }
    rows = tuple(
        (name, *(fixed(value, digits) for value in (found.xy, found.z, found.d3)))
        for name, found in statistics.items()
    )
    title = f"{counted(count, 'check point')} together" if count > 1 else "The check point"
    note = "metres; RMS about zero, STD about the mean"
    return Table(title, ("", "xy", "z", "3D"), rows, "lrrr", (note,))
