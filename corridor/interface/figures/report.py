"""Every picture of an adjustment."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from matplotlib.figure import Figure

from corridor.core import output as report
from corridor.interface.figures._check_points import check_points
from corridor.interface.figures._first_look import first_look
from corridor.interface.figures._residual_vectors import residual_vectors
from corridor.interface.figures._residuals_along import residuals_along
from corridor.interface.figures.correlation import correlation_matrix


def of_adjustment(adjustment: report.Adjusted) -> dict[str, Figure]:
    """Every picture of an adjustment by the name of its file, in the order of the report."""
    return {
        "check_points": check_points(adjustment),
        "residual_vectors": residual_vectors(adjustment),
        "residuals_along": residuals_along(adjustment),
        "correlation_matrix": correlation_matrix(adjustment),
        "first_look": first_look(adjustment.block),
    }


def save_adjustment(adjustment: report.Adjusted, folder: str | os.PathLike) -> list[Path]:
    """Writes the result with its pictures into `folder`; goes with the next release."""
    warnings.warn(
        "save_adjustment is adjustment.save(folder, corridor.figures.of_adjustment(adjustment)) "
        "now; the old name goes with the next release",
        DeprecationWarning,
        stacklevel=2,
    )
    return report.save_adjustment(adjustment, folder, of_adjustment(adjustment))
