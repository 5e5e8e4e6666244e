"""The report of an adjustment: headline, warnings, tables, what to do next; its folder."""

from corridor.interface.report.adjustment import (
    CAPTIONS,
    adjustment_dict,
    doubted,
    of_adjustment,
    save_adjustment,
    steps,
)

__all__ = ["CAPTIONS", "adjustment_dict", "doubted", "of_adjustment", "save_adjustment", "steps"]
