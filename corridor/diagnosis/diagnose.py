"""The call: what is missing from the model of this block?"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.diagnosis import gap
from corridor.diagnosis.believed import Believed
from corridor.diagnosis.location import locate
from corridor.diagnosis.report import as_html, as_text, evidence, save
from corridor.diagnosis.rounds import Course, members, run
from corridor.diagnosis.sentence import sentence
from corridor.diagnosis.variance import variance_alarms
from corridor.diagnosis.verdict import Findings, detection_limits, findings
from corridor.effects import Effect
from corridor.errors import AdjustmentFailed, InputError


@dataclass(repr=False)
class Diagnosis:
    """What is missing, how sure that is, and what it does.

    before, after: adjustments of the believed model and of the model with what was found (the
    same where nothing was). course: all rounds of the search, with the reduced systems.
    gap, detection_limits, untestable: as in diagnosis.json. alarms: variance tests. level, seed:
    as asked for.
    """

    block: Block
    believed: Believed
    before: Adjustment
    after: Adjustment
    course: Course
    findings: Findings
    unknown: list[dict]
    gap: dict
    detection_limits: dict
    untestable: list[dict]
    alarms: list[dict]
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
    level: float = 0.01
    seed: int = 0

    sentence = property(sentence, doc="What is missing, in a sentence that a surveyor understands.")
    evidence = property(evidence, doc=evidence.__doc__)
    __str__ = __repr__ = as_text
    _repr_html_ = as_html
    save = save

    @property
    def verdict(self) -> str:
        """named, ambiguous, unknown, suspected or nothing."""
        return self.findings.verdict

    @property
    def effects(self) -> list[dict]:
        """Effects that were found, as in diagnosis.json."""
        return [_effect(one) for one in self.findings.effects]

    def to_dict(self) -> dict:
        """diagnosis.json (design, section 7)."""
        return _plain(
            {
                "verdict": self.verdict,
                "sentence": self.sentence,
                "effects": self.effects,
                "unknown": self.unknown,
                "untestable": self.untestable,
                "detection_limits": self.detection_limits,
                "gap": self.gap,
                "variance": self.alarms,
                "threshold": self.course.last.threshold,
                "rounds": [one.log for one in self.course.rounds],
                "notes": self.notes,
            }
        )


def diagnose(
    block: Block,
    camera: str | Mapping[str, str] | None = None,
    effects: Iterable[str | Effect] = (),
    control: Iterable[str] | None = None,
    check: Iterable[str] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    level: float = 0.01,
    seed: int = 0,
    progress: Callable[[dict], None] | None = None,
    threads: int = 1,
) -> Diagnosis:
    """What is missing from the believed model of a measured block.

    camera, effects, control, check: the believed model, as given to `corridor.adjust`; default:
        Fraser's ten parameters free, or fixed where block.toml says `calibrated = true`.
    priors: value and standard deviation of camera and effect parameters by name; also of
        candidates, by `slug` (its first parameter) or `slug.parameter`: laboratory knowledge.
    only, without: slugs of the catalogue to test, or to leave out.
    level: probability of a false name in a block that lacks nothing.
    seed: of the simulated threshold and the choice of held-out observations.
    progress: called with a dictionary that holds a message.

    Columns that are missing never stop it: see `untestable`.
    Raises InputError where the block cannot be adjusted as asked or a slug is unknown.
    """
    began = time.perf_counter()
    if not 0.0 < level < 1.0:
        raise InputError(f"level {level} is no probability: use a number between 0 and 1")
    only = None if only is None else list(only)
    block, notes = _with_antenna(block)
    believed = Believed.of(block, camera, effects, control, check, priors, threads)
    # Matrices are many and small: threads would wait for each other.
    with threadpool_limits(1):
        course = run(believed, only, list(without), level, seed, progress)
    found = findings(course)
    names = {effect.slug: effect for effect in course.candidates.effects}
    chosen = members(names, course.last.keys)
    before, after = course.first, course.last.adjustment
    if set(course.last.keys) != set(course.last.log["model"]):
        try:
            after = believed.adjust(chosen) if chosen else before
        except (InputError, AdjustmentFailed) as failed:
            notes.append(f"The adjustment with what was found failed: {failed}")
    if progress:
        progress({"message": "measuring the gap"})
    gaps, kept = _gap(believed, before, after, chosen, found, names, seed, notes)
    unknown = []
    for one in found.unknown:
        text, where = locate(course.last, one.number, one.theta)
        unknown.append(
            {
                "group": one.group, "log_evidence": one.log_evidence, "where": text,
                "location": where, "class": "unknown" if one.kind == "named" else one.kind,
                "parts": one.parts, "kept": kept.get(one.group, True),
            }
        )  # fmt: skip
    return Diagnosis(
        block, believed, before, after, course, found, unknown, gaps,
        detection_limits(course.last.evidence, course.last.found.chosen),
        [{"slug": s, "missing": m} for s, m in sorted(course.candidates.untestable.items())],
        variance_alarms(course.last.equations), [*course.notes, *notes],
        time.perf_counter() - began, level, seed,
    )  # fmt: skip


def _gap(believed, before, after, chosen, found, names, seed, notes) -> tuple[dict, dict]:
    """Gap before and after, and which generic groups held-out data do not support."""
    kept: dict[str, bool] = {}
    tie = {"before": None, "after": None}
    if len(believed.block.tie_points) > 200:
        block, rows = gap.hold_out(believed.block, np.random.default_rng(seed))
        try:
            first = believed.adjust(block=block)
            second = believed.adjust(chosen, block=block) if chosen else first
            tie = gap.tie_gap(first, second, rows)
            generic = [one.group for one in found.unknown]
            if generic and tie["after"] is not None:
                others = [effect for effect in chosen if effect.slug not in generic]
                bare = believed.adjust(others, block=block) if others else first
                without = gap.tie_gap(bare, second, rows)
                kept = dict.fromkeys(generic, bool(without["after"] < without["before"]))
        except (InputError, AdjustmentFailed) as failed:
            notes.append(f"Held-out observations could not be compared: {failed}")
    return {
        "tie_px": tie,
        "check_m": gap.check_gap(before, after),
        "gnss_m": gap.gnss_gap(before, after),
    }, kept


def _with_antenna(block: Block) -> tuple[Block, list[str]]:
    """The block with antenna positions interpolated from its track, where it has only that."""
    if len(block.gnss) or not len(block.track):
        return block, []
    from corridor.diagnosis.track import antenna_of_track

    try:
        table, notes = antenna_of_track(block)
    except InputError as failed:
        return block, [f"The track could not be interpolated: {failed}"]
    return replace(block, gnss=table), notes


def _effect(one) -> dict:
    out = {
        "slug": one.slug,
        "class": one.kind,
        "log_evidence": one.log_evidence,
        "parameters": one.parameters,
        "cannot_be_told_apart_from": one.alternatives,
        **one.where,
    }
    return out | ({"separated_by": one.separate} if one.separate else {})


def _plain(value):
    """Numbers finite or None, arrays as lists."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
