"""Every picture of an adjustment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from corridor.interface.figures._check_points import check_points
from corridor.interface.figures._first_look import first_look
from corridor.interface.figures._residual_vectors import residual_vectors
from corridor.interface.figures._residuals_along import residuals_along
from corridor.interface.figures.correlation import correlation_matrix

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment


def of_adjustment(adjustment: Adjustment) -> dict[str, Figure]:
    """Every picture of an adjustment by the name of its file, in the order of the report."""
    return {
        "check_points": check_points(adjustment),
        "residual_vectors": residual_vectors(adjustment),
        "residuals_along": residuals_along(adjustment),
        "correlation_matrix": correlation_matrix(adjustment),
        "first_look": first_look(adjustment.block),
    }
