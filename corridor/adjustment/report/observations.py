"""What was measured and what the adjustment left over of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from corridor.adjustment.report.numbers import fixed, metre_digits
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_KINDS = {"tie": "tie points", "mark": "marks", "gnss": "GNSS", "control": "control"}


def observations(adjustment: Adjustment) -> Table:
    """Number, outliers, RMS and sigma naught of each kind of measurement."""
    rows, gross = [], []
    for kind, found in adjustment.observations.items():
        if not found.get("count"):
            continue
        counts = (f"{found['count']:,}", f"{found['outliers']:,}")
        rows.append((_KINDS[kind], *counts, _size(found["rms"]), fixed(found["sigma0"], 3)))
        if found.get("gross"):
            gross.append(f"{found['gross']:,} of {_KINDS[kind]}")
    notes = [
        f"all together: sigma naught {fixed(adjustment.sigma0, 4)}, "
        f"redundancy {adjustment.redundancy:,}"
    ]
    if gross:
        left_out = "RMS and sigma naught of a line leave out gross errors, beyond 15 robust sigmas"
        notes.insert(0, f"{left_out}: {', '.join(gross)}")
    header = ("residuals", "count", "outliers", "RMS", "sigma naught")
    return Table("Observations", header, tuple(rows), "lrrlr", tuple(notes))


def _size(rms) -> str:
    """One number in px an axis, or three in metres."""
    if np.ndim(rms) == 0:
        return f"{fixed(rms, 3)} px an axis"
    digits = metre_digits(rms)
    return "  ".join(fixed(value, digits) for value in rms) + " m (x, y, z)"
