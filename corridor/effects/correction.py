"""A block without an effect: its values found, the effect taken out, what was done recorded."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from corridor.block import Block, record_correction
from corridor.effects.contract import Images, find, group_names
from corridor.effects.forward import point_positions, predict, take_out
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
    given = {name: _given(block, name, mine) for name, mine in values.items()}
    out = block.copy()
    record_correction(
        out,
        {
            name.partition("@")[0]: {
                parameter: dict(value) if isinstance(value, Mapping) else float(value)
                for parameter, value in mine.items()
            }
            for name, mine in given.items()
        },
        notes,
    )
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


def values_of(name: str, path: str | os.PathLike, block: Block) -> dict:
    """Values of an effect from adjustment.json or diagnosis.json, for a block with its groups.

    name: slug, `slug@flight`. Returns `{parameter: number}` or `{parameter: {group: number}}`.
    Raises InputError where the file does not hold them.
    """
    path = Path(path)
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a JSON file") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON ({error}): give adjustment.json") from error
    effects = told.get("effects") if isinstance(told, dict) else None
    slug = name.partition("@")[0]
    if isinstance(effects, list):
        found = _of_diagnosis(effects, slug)
    else:
        found = _of_adjustment(effects, slug, path, block, find(name))
    if not found:
        raise InputError(
            f"{path} holds no values of effect {slug}: adjust with --effect {slug}, or give the "
            f"values as {slug}:parameter=value"
        )
    return found


def _of_diagnosis(effects: list, slug: str) -> dict:
    found: dict = {}
    for entry in effects:
        if entry.get("slug") != slug:
            continue
        group = entry.get("flight") or entry.get("point")
        for parameter in entry["parameters"]:
            if group is None:
                found[parameter["name"]] = parameter["value"]
            else:
                found.setdefault(parameter["name"], {})[group] = parameter["value"]
    return found


def _of_adjustment(effects, slug, path, block, effect) -> dict:
    mine = (effects or {}).get(slug)
    if not mine:
        return {}
    if any("table" in value for value in mine.values()):
        return _of_table(path.parent / next(iter(mine.values()))["table"])
    if all("value" in value for value in mine.values()):
        return {parameter: value["value"] for parameter, value in mine.items()}
    effect = effect.form(block)
    known = group_names(Images.of(block), effect.group, block.ground["point"].tolist())
    found: dict = {}
    for group, parameters in mine.items():
        if group in known:
            for parameter, value in parameters.items():
                found.setdefault(parameter, {})[group] = value["value"]
    return found


def _of_table(path: Path) -> dict:
    """A table `effect_SLUG.csv` of many groups, as adjustments write it."""
    import pandas as pd

    try:
        table = pd.read_csv(path, dtype={"group": str, "parameter": str})
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}): it belongs beside adjustment.json"
        ) from error
    return {
        parameter: dict(zip(part["group"], part["value"].tolist(), strict=True))
        for parameter, part in table.groupby("parameter", sort=False)
    }


def _given(block: Block, name: str, values: Mapping | None) -> dict:
    effect = find(name).form(block)
    if values:
        return dict(values)
    stated = effect.stated(block)
    if stated is None:
        names = ", ".join(f"{p.name}=..." for p in effect.parameters(block)[:3])
        raise InputError(
            f"effect {effect.slug} needs values, the block states none: write "
            f"{effect.slug}:{names}, or take them from an adjustment"
        )
    return stated


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
        lost = np.flatnonzero(~np.isfinite(point_positions(block, table)).all(axis=1))
        if len(lost):
            raise InputError(
                f"{block.where(table, lost[0])}: point {rows['point'].iloc[lost[0]]} has no "
                f"coordinates ({len(lost)} of {len(rows)} rows have none): run `corridor adjust` "
                "first and correct OUT/block"
            )
