"""The report of an adjustment: headline, warnings, tables, what to do next; its folder."""

from corridor.interface.report.adjustment import (
    CAPTIONS,
    adjustment_dict,
    doubted,
    of_adjustment,
    save_adjustment,
    steps,
)
from corridor.interface.report.gis import write_gis

__all__ = [
    "CAPTIONS", "adjustment_dict", "doubted", "of_adjustment", "save_adjustment", "steps",
    "write_gis",
]  # fmt: skip
