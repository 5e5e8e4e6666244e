"""Pictures of blocks and adjustments, one style; each function returns a matplotlib Figure."""

from corridor.figures.check_points import check_points, compare_check_points
from corridor.figures.correlation import correlation_matrix
from corridor.figures.first_look import first_look
from corridor.figures.report import save_adjustment
from corridor.figures.residual_vectors import residual_vectors
from corridor.figures.residuals_along import residuals_along

__all__ = [
    "check_points",
    "compare_check_points",
    "correlation_matrix",
    "first_look",
    "residual_vectors",
    "residuals_along",
    "save_adjustment",
]
