"""The result of an adjustment with all its pictures, as a folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from corridor.figures.check_points import check_points
from corridor.figures.correlation import correlation_matrix
from corridor.figures.first_look import first_look
from corridor.figures.residual_vectors import residual_vectors
from corridor.figures.residuals_along import residuals_along

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

CAPTIONS = {
    "check_points": (
        "Where the adjusted check points lie, seen from where they were surveyed. A pattern that "
        "turns, bends or grows along the corridor is not chance."
    ),
    "residual_vectors": (
        "What the camera model leaves over. Arrows in all directions are noise; arrows that "
        "follow their neighbours are something the camera did that the model does not know."
    ),
    "residuals_along": (
        "Image and GNSS residuals along the block. Steps between strips or flights, and slopes "
        "along one, point at time, at the antenna or at the camera."
    ),
    "correlation_matrix": (
        "Parameters that this block cannot tell apart: a full cell means that one can stand in "
        "for the other."
    ),
    "first_look": "Images, points and coverage of the block after the adjustment.",
}


def pictures(adjustment: Adjustment) -> dict[str, Figure]:
    """Every picture of an adjustment by the name of its file, in the order of the report."""
    return {
        "check_points": check_points(adjustment),
        "residual_vectors": residual_vectors(adjustment),
        "residuals_along": residuals_along(adjustment),
        "correlation_matrix": correlation_matrix(adjustment),
        "first_look": first_look(adjustment.block),
    }


def save_adjustment(adjustment: Adjustment, folder: str | os.PathLike) -> list[Path]:
    """Writes the result with its pictures into `folder`; see `corridor.adjustment.save`."""
    # Only here, so that a picture of a block does not wait for the numerical libraries.
    from corridor.adjustment import save

    return save(adjustment, folder, pictures(adjustment), CAPTIONS)
