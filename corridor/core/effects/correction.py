"""A block without an effect: the effect taken out, and what was done recorded."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from corridor.core.block import Block, read, record_correction
from corridor.core.effects.forward import predict, take_out
from corridor.core.effects.values import EffectValues, Values, effect_of
from corridor.core.errors import InputError
from corridor.core.preparation import rates_from_neighbours, velocities

# A time so many times as long as one would expect was typed in milliseconds.
_MILLISECONDS = 100.0
# The equator's radius: WGS 84.
_EARTH_M = 6_378_137.0


def correct(
    block: Block | str | os.PathLike,
    effects: str | Iterable[str] | Mapping[str, Mapping | None],
    notes: Sequence[str] = (),
    *,
    source: str | os.PathLike | None = None,
    velocity: str | None = "auto",
    turning: str = "metadata",
) -> Block:
    """The block with effects taken out of its measurements; any program can go on with it.

    block: as read, or its folder.
    effects: slugs, or `{slug: {parameter: number or {group: number}}}`; without values (None)
        those of `source`, an adjustment.json or diagnosis.json, or else what the block states.
    notes: sentences for the record, the table `corrected` of block.toml, which holds the values
        and, for effects that need them, where velocities and angular rates came from.
    velocity: `metadata`, `gnss`, `strip`, `neighbours`; `auto`: the first of these that the block
        has; None: vx, vy, vz as they stand. turning: angular rates by `metadata` or `neighbours`.

    The shifts are those at the poses, points and cameras of the block. `add(corrected, values)`
    gives the measurements back.
    Raises InputError where a value, a start value or a needed column is missing, an image point
    cannot be modelled, or an effect has been taken out before.
    """
    block, given = read(block), _given(effects)
    if source is not None:
        for slug in [slug for slug, values in given.items() if values is None]:
            (given[slug],) = Values.read(source, block, [slug]).values()
    block, found = _with_motion(block, given, velocity, turning)
    stated = Values.of(block, {name: mine or None for name, mine in given.items()})
    refuse_impossible(block, given, stated)
    out = block.copy()
    record_correction(out, stated.plain(), [*found, *notes])
    remedy = "run `corridor adjust` first and correct OUT/block"
    block.demand("images", np.isfinite(block.poses), "has no pose", remedy)
    for table in ("tie_points", "marks"):
        place = block.positions(table)[getattr(block, table)["point"].array.codes]
        block.demand(table, np.isfinite(place), "has no coordinates", remedy)
    seen = predict(block, given)
    for table, modelled in (("tie_points", seen.tie), ("marks", seen.mark)):
        fault = "does not lie in front of it"
        block.demand(table, np.isfinite(modelled), fault, f"{remedy}, or remove the rows")
    return take_out(out, given)


def refuse_impossible(block: Block, given: Mapping, stated: Values) -> None:
    """Refuse times that are plainly milliseconds, a hundred times what an effect may be, and what
    moves a camera's interior by its whole focal length."""
    shortest = min(camera["f"] for camera in block.cameras.values())
    for slug, one in stated.items():
        plain = given[slug] if isinstance(given.get(slug), Mapping) else {}
        for parameter in one.effect.parameters(block):
            value = plain.get(parameter.name)
            if not isinstance(value, int | float):
                continue
            if one.effect.place == "camera" and parameter.unit == "px" and abs(value) >= shortest:
                raise InputError(
                    f"{slug}: {parameter.name} = {value:g} px is added to what the camera states, "
                    f"whose focal length is {shortest:g} px: give the difference"
                )
            if parameter.unit == "m" and abs(value) > _EARTH_M:
                raise InputError(
                    f"{slug}: {parameter.name} = {value:g} is in metres, and farther than the "
                    "middle of the Earth: correct it"
                )
            if parameter.unit == "s" and abs(value) > _MILLISECONDS * parameter.scale:
                raise InputError(
                    f"{slug}: {parameter.name} = {value:g} is in seconds, and far longer than it "
                    f"can be: {value:g} ms are {value / 1000:g}"
                )


def _given(effects: str | Iterable[str] | Mapping[str, Mapping | None]) -> dict:
    if isinstance(effects, Mapping):
        return dict(effects)
    words = effects.split(",") if isinstance(effects, str) else effects
    return {word.strip(): None for word in words}


def _with_motion(
    block: Block, given: Mapping, velocity: str | None, turning: str
) -> tuple[Block, list[str]]:
    """The block with the velocities and angular rates that effects look at, and their origin."""
    forms = [
        (mine.effect if isinstance(mine, EffectValues) else effect_of(name)).form(block)
        for name, mine in given.items()
    ]
    looked_at = {column for effect in forms for column in (*effect.needs, *effect.takes)}
    notes = []
    if "images.wx" in looked_at and turning == "neighbours":
        block = rates_from_neighbours(block)
        notes.append("angular rates: from the attitudes of the images before and after")
    if "images.vx" in looked_at and velocity is not None:
        found = velocities(block, velocity)
        block = found.on(block)
        notes += str(found).splitlines()
        if "images.wx" in looked_at and not block.has("images.wx"):
            notes.append("No angular rates are known: the camera is taken not to have turned.")
    return block, notes
