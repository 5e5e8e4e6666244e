"""The call: what is missing from the model of this block?"""

from __future__ import annotations

import os
import time
from dataclasses import asdict

import numpy as np

from corridor.core.adjustment import (
    Adjustment,
    Model,
    Run,
    adjustable_part_as_seen,
    different_arms,
    implausible,
    refit,
    with_turns_as_seen,
)
from corridor.core.block import EXACT_M, SIGMA, Block, read, with_equal_axes
from corridor.core.engine.threads import one_thread
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.options import options
from corridor.core.output import plain
from corridor.core.preparation import (
    contradicted,
    derived,
    mirrored,
    plausibility_warnings,
    prepare,
    without_impossible_points,
)
from corridor.diagnosis.anomalies.variance import variance_alarms
from corridor.diagnosis.anomalies.wrong_matches import broken_picture, outlier_clusters, shows_as
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.findings.findings import Findings
from corridor.diagnosis.findings.separation import not_separated
from corridor.diagnosis.findings.verdict import detection_limits, findings
from corridor.diagnosis.forward_selection import Question, course_of
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.report import actions, as_html, as_text, evidence, save, sentence
from corridor.diagnosis.report.beside import beside
from corridor.diagnosis.report.wording import cannot_separate, unseen_statements
from corridor.diagnosis.settings import Settings, using
from corridor.diagnosis.verification.halves import compare_halves
from corridor.diagnosis.verification.held_out import check_sigmas
from corridor.diagnosis.verification.verification import Verification


class Diagnosis(Diagnosed):
    __doc__ = Diagnosed.__doc__

    actions = property(actions, doc="At most three sentences on what to do next, with the command.")
    sentence = property(sentence, doc="What is missing, in a sentence that a surveyor understands.")
    evidence = property(evidence, doc=evidence.__doc__)
    __str__ = as_text
    _repr_html_ = as_html
    beside = beside
    save = save

    def __repr__(self) -> str:
        return f"Diagnosis of {self.block.name}: {self.verdict}. {self.sentence}"

    def to_dict(self) -> dict:
        """diagnosis.json."""
        return plain(
            {
                "verdict": self.verdict,
                "sentence": self.sentence,
                "actions": self.actions,
                "p_nothing": self.p_nothing,
                "halves": self.halves.to_dict(),
                "required": self.required,
                "effects": self.effects,
                "unknown": self.unknown,
                "untestable": self.untestable,
                "derived": [one.to_dict() for one in derived(self.block)],
                "detection_limits": self.detection_limits,
                "not_separated": self.not_separated,
                "gap": self.gap,
                "check_sigmas": self.check_sigmas,
                "lens": self.lens,
                "variance": self.alarms,
                "threshold": self.course.last.threshold,
                "rounds": [one.log for one in self.course.rounds],
                "notes": self.notes,
                "settings": asdict(self.settings),
            }
        )


@options(model=Model, asked=Question, run=Run)
@one_thread()
def diagnose(
    block: Block | str | os.PathLike, model: Model, *, asked: Question, run: Run
) -> Diagnosis:
    """What is missing from the believed model of a measured block.

    block: as read, or its folder.
    camera, effects, control, check, lever_arm: the believed model, as given to `corridor.adjust`;
        default: Fraser's ten parameters free, or fixed where block.toml says `calibrated = true`.
    priors: value and standard deviation of camera and effect parameters by name; also of
        candidates, by `slug` (its first parameter) or `slug.parameter`: laboratory knowledge.
    model: a `Model` in place of these.
    only, without: slugs of the catalogue to test, or to leave out.
    level: probability of a false name in a block that lacks nothing.
    seed: of the simulated threshold and the choice of held-out observations.
    settings: the numbers by which it is decided, in place of the usual ones; `diagnosis.json` has
        those that were used.
    asked: a `Question` in place of these.
    progress: called with a `Progress`.
    threads, max_iterations, strict, run: of an adjustment, as `corridor.adjust` has them.

    Columns that are missing never stop it: see `untestable`.
    Raises InputError where the block cannot be adjusted as asked or a slug is unknown,
    AdjustmentFailed where the believed model does not converge.
    """
    with using(asked.settings) as settings:
        return _diagnose(block, model, asked, run, settings)


def _diagnose(
    block: Block | str | os.PathLike, model: Model, asked: Question, run: Run, settings: Settings
) -> Diagnosis:
    """With the settings in use."""
    began = time.perf_counter()
    block, exact = _without_exact_control(read(block))
    block, equal = with_equal_axes(block)
    block, found, notes = prepare(block)
    notes = [
        *exact,
        *equal,
        *(one.sentence for one in found if one.column == "gnss"),
        *notes,
    ]
    for told in mirrored(block):
        raise InputError(f"{told} Correct tie_points.csv and marks.csv.")

    def again(part: Block) -> Adjustment:
        return refit(part, model, run)

    block, turned = with_turns_as_seen(block, again)
    block, other = without_impossible_points(block, run.strict)
    block, left_out = adjustable_part_as_seen(block, model, again, run.strict)
    doubtful = [*turned, *other, *plausibility_warnings(block, without=True)]
    notes = [*left_out, *notes]
    believed = ReferenceModel.of(block, model, run)
    try:
        course = course_of(believed, asked, run.say)
    except AdjustmentFailed as error:
        if not doubtful or str(error).startswith(doubtful[0]):
            raise
        # What looks wrong at first sight is the likelier cause.
        raise AdjustmentFailed(f"{doubtful[0]} So: {error}") from None
    block, notes = believed.block, [*believed.left_out, *notes]
    run.say("measuring the gap")
    held = Verification(believed, course, findings(course), asked.seed)
    before, last = course.first, course.last
    after, used = held.after()
    found = held.findings
    _add_discontinuity(found, before, last.adjustment)
    untestable = sorted(course.candidates.untestable.items())
    limits = detection_limits(last)
    inseparable = not_separated(last, found)
    run.say("comparing two halves of the images")
    halves = compare_halves(believed, course.members(last.keys), last.noise, last.lens)
    last.let_go()
    return Diagnosis(
        block=block,
        believed=believed,
        before=before,
        after=after,
        course=course,
        findings=found,
        gap=held.gap(after),
        check_sigmas=check_sigmas(after),
        halves=halves,
        detection_limits=limits,
        not_separated=inseparable,
        untestable=[{"slug": slug, "missing": missing} for slug, missing in untestable],
        lens=held.lens,
        alarms=[*variance_alarms(last.equations), *outlier_clusters(last.adjustment)],
        notes=[
            *doubtful,
            *implausible(before),
            *different_arms(after),
            *unseen_statements(block, found, limits),
            *cannot_separate(block, inseparable[:2]),
            *contradicted(block),
            *course.notes,
            *course.impossible.values(),
            *course.idle,
            *notes,
            *held.notes,
        ],
        doubts=doubtful,
        seconds=time.perf_counter() - began,
        used=used,
        rivals=held.rivals,
        level=asked.level,
        seed=asked.seed,
        settings=settings,
    )


def _without_exact_control(block: Block) -> tuple[Block, list[str]]:
    """Control that is held exactly as if nothing were stated of it, and a sentence that says so:
    what is held exactly cannot be asked whether it is right."""
    sigma = block.ground_sigma()
    exact = sigma <= EXACT_M
    if not exact.any():
        return block, []
    block = block.copy()
    block.put("ground", ("sx", "sy", "sz"), np.where(exact, SIGMA["control_m"], sigma))
    return block, [
        f"Ground points with a standard deviation of 0 count with {SIGMA['control_m'][0]:g} m, as "
        "those without one: state how accurate the survey is."
    ]


def _add_discontinuity(found: Findings, before: Adjustment, last: Adjustment) -> None:
    """The rim of a pane among what was found: where a shape shows it, or the fit has set it aside.

    before, last: adjustments of the believed model, and of the last round.
    """
    shown = next((one for one in found.unknown if one.group in shows_as()), None)
    if shown is not None:
        # The lines of that group are far apart; before they bent to it, points told the rim.
        rim = broken_picture(before)
        if rim is not None:
            shown.where, shown.location = rim.where, rim.location
    elif all(one.kind != "unknown" for one in found.unknown):
        rim = broken_picture(last)
        found.unknown += [] if rim is None else [rim]
