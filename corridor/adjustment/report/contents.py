"""Every table of a report, in order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from corridor.adjustment.report.check_points import check_points, check_statistics
from corridor.adjustment.report.correlations import correlations, strong_correlations
from corridor.adjustment.report.observations import observations
from corridor.adjustment.report.parameters import camera, effects, lever_arms
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment


def tables(adjustment: Adjustment) -> list[Table]:
    """Every table of the report, in order; those with nothing to say are left out."""
    made = [
        observations(adjustment),
        camera(adjustment),
        effects(adjustment),
        lever_arms(adjustment),
        check_points(adjustment),
        check_statistics(adjustment),
        correlations(adjustment),
        strong_correlations(adjustment),
    ]
    return [table for table in made if table is not None]
