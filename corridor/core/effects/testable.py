"""What could be missing: every effect of the catalogue that a block can say something about."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from corridor.core.block import Block
from corridor.core.effects.contract import Effect
from corridor.core.effects.registry import every_effect
from corridor.core.errors import InputError, did_you_mean

# Tables whose effects are errors of what they hold, and what tells that a block has them.
_OWN = {"attitudes": "attitudes", "rig": "rig.member", "distances": "distances"}


@dataclass
class Candidates:
    """The effects to test, and those that cannot be.

    untestable: slug -> what is missing, `table.column`.
    """

    effects: list[Effect]
    untestable: dict[str, str] = field(default_factory=dict)


def candidates(
    block: Block,
    free: Mapping[str, Iterable[str]],
    believed: Iterable[Effect] = (),
    control: Iterable[str] = (),
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
) -> Candidates:
    """Effects of the catalogue that are not believed in, and what stops some from being tested.

    free: estimated interior parameters of each camera. control: measured control points.
    only, without: slugs that restrict the choice. Raises InputError for a slug that is unknown.
    """
    every = [effect.form(block) for effect in every_effect()]
    names = {effect.slug for effect in every}
    for slug in [*(only or ()), *without]:
        if slug not in names:
            raise InputError(
                f"effect {slug!r} is unknown{did_you_mean(slug, names)}: `corridor effects` lists "
                "them all"
            )
    taken = {effect.slug for effect in believed} | set(without)
    if only is not None:
        taken |= names - set(only)
    found = Candidates([])
    for effect in every:
        if effect.slug in taken or not (effect.searched or only):
            continue
        # Errors of what was not measured, or does not hang together, cannot be missing.
        if not only and any(effect.needs_table(t) and not block.has(of) for t, of in _OWN.items()):
            continue
        missing = _missing(block, effect, free, list(control)) or _same_as(block, effect, every)
        if missing:
            found.untestable[effect.slug] = missing
        else:
            found.effects.append(effect)
    return found


def _missing(block: Block, effect: Effect, free, control) -> str | None:
    """The first thing that keeps an effect from being tested."""
    missing = effect.missing(block)
    if missing:
        return missing[0]
    if effect.place == "antenna" and not len(block.gnss):
        return "gnss.x"
    if effect.place == "ground" and not control:
        return "ground.role"
    # What stands in for parameters shared as it is itself is those parameters and no more.
    held = {name: set(effect.stands_in_for) - set(names) for name, names in free.items()}
    if effect.place == "camera" and effect.group == "camera" and effect.stands_in_for:
        for name, parameters in held.items():
            if not parameters:
                return f"camera.{name}.calibrated"
    return _unknown_cell(block, effect, control)


def _same_as(block: Block, effect: Effect, every: list[Effect]) -> str | None:
    """A second flight, where with one flight an effect is another one of the catalogue."""
    if effect.group != "flight" or len(block.flight_names) > 1:
        return None
    return "images.flight" if effect.refines in {other.slug for other in every} else None


def _unknown_cell(block: Block, effect: Effect, control) -> str | None:
    """The column of which an effect needs a cell that is empty for an image."""
    for column in effect.needs:
        table, _, name = column.partition(".")
        if table == "images" and np.isnan(block.column("images", name)).any():
            return column
    return None
