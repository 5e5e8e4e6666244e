"""The measured block from which the effects that were found have been taken out."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from corridor.core.adjustment import Adjustment
from corridor.core.block import Block, record_correction, taken_out
from corridor.core.effects import Values, take_out

_MEASURED = {
    "tie_points": ["x", "y"],
    "marks": ["x", "y"],
    "gnss": ["x", "y", "z"],
    "ground": ["x", "y", "z"],
}


def corrected(block: Block, adjustment: Adjustment, slugs: Iterable[str]) -> Block:
    """The block as it would have been measured without some effects.

    block: as measured. adjustment: of the same block with the effects, whose estimates are taken
    out at its poses, points and cameras. Measurements change; start values, roles and all other
    columns stay. A track is left out where the antenna positions that came with it have changed.
    The table `corrected` of its block.toml holds what was taken out.
    """
    values = Values(adjustment.values[slug] for slug in slugs)
    out = block.copy()
    out.ground = out.ground.assign(role=adjustment.system.roles) if len(out.ground) else out.ground
    if not values:
        return out
    there = adjustment.block.copy()
    for table in (*_MEASURED, "attitudes"):
        setattr(there, table, getattr(out, table).copy())
    moved = take_out(there, values)
    out.attitudes = moved.attitudes
    for table, columns in _MEASURED.items():
        setattr(out, table, getattr(out, table).assign(**getattr(moved, table)[columns]))
    if len(out.track) and not np.array_equal(
        out.gnss[["x", "y", "z"]], block.gnss[["x", "y", "z"]]
    ):
        out.track = out.track.iloc[:0]
    before = taken_out(out)
    record_correction(
        out,
        {slug: mine for slug, mine in values.plain().items() if slug not in before},
        [f"{slug} was taken out once more" for slug in values if slug in before],
    )
    return out
