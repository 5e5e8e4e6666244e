"""The first sentences of a report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from corridor.adjustment.report.numbers import counted, fixed, metre_digits, short

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment


def headline(adjustment: Adjustment) -> str:
    """The first sentences of a report, for a surveyor who reads nothing else."""
    block = adjustment.block
    name = short(block.name, 50)
    steps = counted(adjustment.iterations, "iteration")
    images = counted(len(block.images), "image")
    if not adjustment.converged:
        return (
            f"The adjustment of {name} ({images}) did not converge in {steps}: "
            "its numbers are not a result."
        )
    parts = [f"The adjustment of {name} ({images}) converged in {steps}."]
    sigma0 = float(adjustment.sigma0)
    if math.isfinite(sigma0):
        parts.append(f"Sigma naught is {sigma0:.3f}: the residuals are {_compared(sigma0)}.")
    number = len(adjustment.check_points)
    if number:
        rms = adjustment.check_rms
        digits = metre_digits([rms.xy, rms.z])
        parts.append(
            f"At {counted(number, 'check point')} it is off by {fixed(rms.xy, digits)} m in plan "
            f"and {fixed(rms.z, digits)} m in height (RMS)."
        )
    else:
        parts.append("There are no check points, so nothing independent tests it.")
    return " ".join(parts)


def _compared(sigma0: float) -> str:
    percent = round(100 * (sigma0 - 1))
    if abs(percent) <= 5:
        return "as large as the stated standard deviations say"
    if percent > 100:
        return f"{sigma0:.1f} times as large as the stated standard deviations say"
    word = "larger" if percent > 0 else "smaller"
    return f"{abs(percent)} % {word} than the stated standard deviations say"
