"""A diagnosed block beside its simulated counterparts, before and after."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from corridor.core.adjustment import Adjustment
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import Progress, telling
from corridor.diagnosis.bootstrap.comparison import Comparison, compare
from corridor.diagnosis.bootstrap.counterparts import counterparts
from corridor.diagnosis.report.corrected import corrected

COUNT = 20


class Beside(NamedTuple):
    """Comparisons before and, where something was added, after; notes on what did not succeed."""

    before: Comparison | None
    after: Comparison | None
    notes: list[str]


def beside(
    diagnosis,
    count: int = COUNT,
    threads: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> Beside:
    """The block of a diagnosis beside its counterparts before and after; notes.

    count: how many counterparts, 19 or more. threads: 1 or 2. progress: called with a
    `Progress`. None where counterparts could not be adjusted, which a note
    says, and after where nothing was added.
    """
    say = telling(progress)
    cases: list[Comparison | None] = [None, None]
    notes: list[str] = []
    wanted = [lambda: diagnosis.before]
    if diagnosis.after is not diagnosis.before:
        wanted.append(lambda: _without_shapes(diagnosis))
    for k, adjustment in enumerate(wanted):
        word = ("the believed model", "the model with what was found")[k]

        def tell(step: Progress, word=word) -> None:
            say(f"{step.what} of {word}", step.done, step.of)

        try:
            cases[k] = compare(counterparts(adjustment(), count, diagnosis.seed, threads, tell))
        except (InputError, AdjustmentFailed) as failed:
            notes.append(f"Counterparts of {word} could not be adjusted: {failed}")
            break
    return Beside(*cases, notes)


def _without_shapes(diagnosis) -> Adjustment:
    """The adjustment with what was found; its generic shapes taken out beforehand.

    Estimating a hundred columns anew in every counterpart would take minutes.
    """
    after = diagnosis.after
    inside = after.system.effects
    shapes = [one.group for one in diagnosis.findings.unknown if one.group in inside]
    if not shapes:
        return after
    believed = {effect.slug for effect in diagnosis.believed.effects}
    named = [
        effect for slug, effect in inside.items() if slug not in believed and slug not in shapes
    ]
    block = corrected(diagnosis.block, after, shapes)
    return diagnosis.believed.adjust(named, block=block)
