"""What was estimated: cameras, effects and lever arms, each with its standard deviation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from corridor.adjustment.report.numbers import DASH, rounded, short, times
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_UNITS = {"f": "px", "cx": "px", "cy": "px"}
_MOST_GROUPS = 8  # groups of one effect parameter that are listed


def camera(adjustment: Adjustment) -> Table:
    """Interior parameters, and which of them may be zero."""
    frame = adjustment.camera
    several = frame["camera"].nunique() > 1
    rows, doubtful = [], []
    for row in frame.itertuples(index=False):
        if row.sigma <= 0 and row.value == 0:
            continue  # a coefficient this camera does not have
        name = (short(row.camera),) if several else ()
        unit = _UNITS.get(row.parameter, "")
        rows.append((*name, row.parameter, *rounded(row.value, row.sigma), unit))
        if not unit and row.sigma > 0 and abs(row.value) < 2 * row.sigma:
            doubtful.append(" ".join((*name, row.parameter)))
    notes = ()
    if doubtful:
        verb = "differs" if len(doubtful) == 1 else "differ"
        notes = (f"{', '.join(doubtful)} {verb} from zero by less than two standard deviations",)
    if several:
        header = ("camera", "parameter", "value", "sigma", "unit")
        return Table("Cameras", header, tuple(rows), "llrrl", notes)
    title = f"Camera {short(frame['camera'].iloc[0])}"
    return Table(title, ("parameter", "value", "sigma", "unit"), tuple(rows), "lrrl", notes)


def effects(adjustment: Adjustment) -> Table | None:
    """Parameters of the effects that were estimated; many groups of one are summed up."""
    frame = adjustment.effects
    if not len(frame):
        return None
    rows, notes = [], []
    for (slug, parameter), part in frame.groupby(["slug", "parameter"], sort=False):
        slug, unit = short(slug), str(part["unit"].iloc[0])
        if len(part) > _MOST_GROUPS:
            values, typical = part["value"], float(np.nanmedian(part["sigma"]))
            mean = rounded(values.mean(), typical)
            low, high = (rounded(value, typical)[0] for value in (values.min(), values.max()))
            rows.append((slug, parameter, f"{len(part):,} groups", *mean, unit, DASH))
            notes.append(
                f"{slug} {parameter}: mean of the groups and median of their sigmas; "
                f"values from {low} to {high} {unit}".rstrip()
            )
            continue
        for row in part.itertuples(index=False):
            found = rounded(row.value, row.sigma)
            ratio = abs(row.value) / row.sigma if row.sigma > 0 else math.nan
            rows.append((slug, parameter, short(row.group, 16), *found, unit, times(ratio)))
    header = ("effect", "parameter", "of", "value", "sigma", "unit", "value/sigma")
    return Table("Effects", header, tuple(rows), "lllrrlr", tuple(notes))


def lever_arms(adjustment: Adjustment) -> Table | None:
    """From the camera to the GNSS antenna, flight by flight."""
    frame = adjustment.lever_arm
    if not len(frame):
        return None
    rows = []
    for row in frame.itertuples(index=False):
        found = [
            rounded(value, 0.0 if row.fixed else sigma)
            for value, sigma in ((row.x, row.sx), (row.y, row.sy), (row.z, row.sz))
        ]
        rows.append((short(row.flight), *found[0], *found[1], *found[2]))
    header = ("flight", "x", "sigma", "y", "sigma", "z", "sigma")
    note = "metres, camera frame (x right, y down, z forward), camera to antenna"
    return Table("Lever arm of the GNSS antenna", header, tuple(rows), "lrrrrrr", (note,))
