"""A block without an effect: the effect taken out, and what was done recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from corridor.block import Block, record_correction
from corridor.effects.forward import predict, take_out
from corridor.effects.values import Values
from corridor.errors import InputError

_POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


def correct(block: Block, values: Mapping[str, Mapping | None], notes: Sequence[str] = ()) -> Block:
    """The block with effects taken out of its measurements; any program can go on with it.

    values: `{slug: {parameter: number or {group: number}}}`; None takes what the block states.
    notes: sentences for the record, the table `corrected` of block.toml, which holds the values.
    The shifts are those at the poses, points and cameras of the block. `add(corrected, values)`
    gives the measurements back.
    Raises InputError where a value, a start value or a needed column is missing, an image point
    cannot be modelled, or an effect has been taken out before.
    """
    given = Values.of(block, {name: mine or None for name, mine in values.items()})
    out = block.copy()
    record_correction(out, given.plain(), notes)
    _refuse_incomplete(block)
    seen = predict(block, given)
    for table, modelled in (("tie_points", seen.tie), ("marks", seen.mark)):
        lost = np.flatnonzero(~np.isfinite(modelled).all(axis=1))
        if len(lost):
            row, rows = int(lost[0]), getattr(block, table)
            raise InputError(
                f"{block.where(table, row)}: point {rows['point'].iloc[row]} does not lie in front "
                f"of image {rows['image'].iloc[row]} ({len(lost)} rows are so): run `corridor "
                "adjust` first and correct OUT/block, or remove the rows"
            )
    return take_out(out, given)


def _refuse_incomplete(block: Block) -> None:
    """Refuse a block without the poses and points at which an effect is worked out."""
    pose = np.stack([block.column("images", name) for name in _POSE], axis=1)
    lost = np.flatnonzero(~np.isfinite(pose).all(axis=1))
    if len(lost):
        raise InputError(
            f"{block.where('images', lost[0])}: image {block.images['image'].iloc[lost[0]]} has no "
            f"pose ({len(lost)} of {len(pose)} images have none): run `corridor adjust` first and "
            "correct OUT/block"
        )
    for table in ("tie_points", "marks"):
        rows = getattr(block, table)
        known = np.isfinite(block.positions(table)).all(axis=1)
        lost = np.flatnonzero(~known[rows["point"].cat.codes.to_numpy()])
        if len(lost):
            raise InputError(
                f"{block.where(table, lost[0])}: point {rows['point'].iloc[lost[0]]} has no "
                f"coordinates ({len(lost)} of {len(rows)} rows have none): run `corridor adjust` "
                "first and correct OUT/block"
            )
