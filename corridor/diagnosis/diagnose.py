"""The call: what is missing from the model of this block?"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from threadpoolctl import threadpool_limits

from corridor.adjustment import Adjustment, Model
from corridor.block import Block
from corridor.diagnosis import held_out
from corridor.diagnosis.beside import beside
from corridor.diagnosis.discontinuity import broken_picture, shows_as
from corridor.diagnosis.location import locate
from corridor.diagnosis.outlier_clusters import outlier_clusters
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.report import as_html, as_text, evidence, save, sentence
from corridor.diagnosis.rounds import Course, Round, members, run
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.variance import variance_alarms
from corridor.diagnosis.verdict import (
    Findings,
    detection_limits,
    findings,
    in_place_of,
    shapes,
)
from corridor.effects import Effect
from corridor.errors import AdjustmentFailed, InputError
from corridor.preparation import derived, prepare
from corridor.report import plain


@dataclass(repr=False)
class Diagnosis:
    """What is missing, how sure that is, and what it does.

    before, after: adjustments of the believed model and of the model with what was found (the
    same where nothing was). course: all rounds of the search, with the reduced systems.
    gap, detection_limits, untestable: as in diagnosis.json. alarms: variance tests. level, seed:
    as asked for.
    used: what `after` has more than `before`, by slug (`slug.point` for a control point): of
    effects that cannot be told apart, one. rivals: error with each of the others, over that with
    the one that was found, of `check` points and of held-out `tie` points.
    """

    block: Block
    believed: ReferenceModel
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
    used: list[str] = field(default_factory=list)
    rivals: dict[str, dict[str, float]] = field(default_factory=dict)
    level: float = 0.01
    seed: int = 0

    sentence = property(sentence, doc="What is missing, in a sentence that a surveyor understands.")
    evidence = property(evidence, doc=evidence.__doc__)
    __str__ = __repr__ = as_text
    _repr_html_ = as_html
    beside = beside
    save = save

    @property
    def verdict(self) -> str:
        """named, ambiguous, unknown, suspected or nothing."""
        firm = any(one["class"] == "unknown" for one in self.unknown)
        # A broken picture is found behind the search, which is why the findings do not have it.
        if firm and self.findings.verdict in ("suspected", "nothing"):
            return "unknown"
        return self.findings.verdict

    @property
    def effects(self) -> list[dict]:
        """Effects that were found, as in diagnosis.json."""
        return [_effect(one, self.used, self.rivals) for one in self.findings.effects]

    def to_dict(self) -> dict:
        """diagnosis.json."""
        return plain(
            {
                "verdict": self.verdict,
                "sentence": self.sentence,
                "effects": self.effects,
                "unknown": self.unknown,
                "untestable": self.untestable,
                "derived": [one.to_dict() for one in derived(self.block)],
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
    model: Model | None = None,
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
    model: a `Model` in place of camera, effects, control, check and priors.

    Columns that are missing never stop it: see `untestable`.
    Raises InputError where the block cannot be adjusted as asked or a slug is unknown.
    """
    began = time.perf_counter()
    if not 0.0 < level < 1.0:
        raise InputError(f"level {level} is no probability: use a number between 0 and 1")
    only = None if only is None else list(only)
    block, found, notes = prepare(block)
    notes = [*(one.sentence for one in found if one.column == "gnss"), *notes]
    model = Model.of(
        model, camera=camera, effects=effects, control=control, check=check, priors=priors
    )
    believed = ReferenceModel.of(block, model, threads)
    # Matrices are many and small: threads would wait for each other.
    with threadpool_limits(1):
        course = run(believed, only, list(without), level, seed, progress)
    found = findings(course)
    names = {effect.slug: effect for effect in course.candidates.effects}
    before = course.first
    if progress:
        progress({"message": "measuring the gap"})
    held = _HeldOut(believed, names, course.last.keys, seed, notes)
    kept = held.supported([one.group for one in found.unknown])
    used = held.preferred(found.effects)
    found, used = held.shaped(found, course.last, used)
    after = course.last.adjustment
    if set(used) != set(course.last.log["model"]):
        try:
            after = believed.adjust(members(names, used)) if used else before
        except (InputError, AdjustmentFailed) as failed:
            notes.append(f"The adjustment with what was found failed: {failed}")
            used = list(course.last.log["model"])
    gaps = {
        "tie_px": held.gap,
        "check_m": held_out.check_gap(before, after),
        "gnss_m": held_out.gnss_gap(before, after),
    }
    unknown = []
    for one in found.unknown:
        text, where = locate(course.last, one.number, one.theta)
        unknown.append(
            {
                "group": one.group, "log_evidence": one.log_evidence, "where": text,
                "location": where, "class": "unknown" if one.kind == "named" else one.kind,
                "parts": one.parts, "kept": kept.get(one.group, True),
                "cannot_be_told_apart_from": one.alike,
            }
        )  # fmt: skip
    last = course.last.adjustment
    sudden = [one for one in unknown if one["group"] in shows_as()]
    if sudden:
        # The lines of that group are far apart; before they bent to it, points told the rim.
        for line in broken_picture(before):
            sudden[0] |= {"where": line["where"], "location": line["location"]}
    elif not any(one["class"] == "unknown" for one in unknown):
        unknown += broken_picture(last)
    return Diagnosis(
        block, believed, before, after, course, found, unknown, gaps,
        detection_limits(course.last),
        [{"slug": s, "missing": m} for s, m in sorted(course.candidates.untestable.items())],
        [*variance_alarms(course.last.equations), *outlier_clusters(last)], [*course.notes, *notes],
        time.perf_counter() - began, used, held.rivals, level, seed,
    )  # fmt: skip


class _HeldOut:
    """Fits with and without what was found, of which tie observations were held out.

    gap: before and after, px; None where nothing could be held out. rivals: error with effects that
    cannot be told apart from those found, over the error with those found (`check`, `tie`).
    """

    def __init__(
        self, believed: ReferenceModel, names: dict, keys: list[str], seed: int, notes: list
    ):
        self.believed, self.names, self.keys, self.notes = believed, names, keys, notes
        self.gap: dict = {"before": None, "after": None}
        self.rivals: dict[str, dict[str, float]] = {}
        self.second = None
        if len(believed.block.tie_points) <= SETTINGS.fewest_ties:
            return
        self.block, self.rows = held_out.hold_out(believed.block, np.random.default_rng(seed))
        try:
            self.first = self._fit([])
            self.second = self._fit(keys) if keys else self.first
            self.gap = held_out.tie_gap(self.first, self.second, self.rows)
        except (InputError, AdjustmentFailed) as failed:
            notes.append(f"Held-out observations could not be compared: {failed}")

    def _fit(self, keys: list[str]) -> Adjustment:
        return self.believed.adjust(members(self.names, keys), block=self.block)

    def supported(self, generic: list[str]) -> dict[str, bool]:
        """Whether held-out data are predicted better with the generic groups than without them.

        Tie observations that were held out, and check points where there are enough of them.
        """
        if not generic or self.second is None:
            return {}
        others = [key for key in self.keys if key not in generic]
        try:
            bare = self._fit(others) if others else self.first
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"The fit without the unknown failed: {failed}")
            return {}
        better = held_out.improves(bare, self.second, self.rows)
        if not better:
            # A correction stays only if data that no fit has seen improve.
            self.notes.append(
                f"The correction by {', '.join(generic)} is not kept: data that no fit has used "
                "are predicted no better with it."
            )
            self.keys, self.second = others, bare
            self.gap = held_out.tie_gap(self.first, bare, self.rows)
        return dict.fromkeys(generic, better)

    def preferred(self, effects: list) -> list[str]:
        """Keys of the model to go on with.

        Of effects that cannot be told apart, the one with the least error of check points or of
        held-out tie points; the one that was found where none is clearly better.
        """
        keys = list(self.keys)
        for one in effects:
            if one.kind != "ambiguous" or one.key not in keys or self.second is None:
                continue
            rivals = {}
            for rival in [key for key in one.rivals if key not in keys][: SETTINGS.most_rivals]:
                try:
                    rivals[rival] = self._fit([rival if k == one.key else k for k in keys])
                except (InputError, AdjustmentFailed) as failed:
                    self.notes.append(f"The fit with {rival} failed: {failed}")
            best, share = held_out.preferred(self.second, rivals, self.rows)
            self.rivals |= share
            if best is not None:
                kind = "check points" if "check" in share[best] else "held-out image points"
                self.notes.append(
                    f"The fit cannot tell {one.key} and {best} apart; {kind} are predicted better "
                    f"with {best}, so their error afterwards is no longer independent."
                )
                keys = [best if k == one.key else k for k in keys]
                self.second = rivals[best]
                self.gap = held_out.tie_gap(self.first, self.second, self.rows)
        return keys

    def shaped(self, found: Findings, one: Round, keys: list[str]) -> tuple[Findings, list[str]]:
        """A shape of no catalogue in the place of look-alikes, where check points speak for it.

        A knock that moves the lens between strips flown to and fro is, to the fit, an error of the
        GNSS, and the named effect has fewer parameters.
        """
        if self.second is None or len(self.second.check_points) < SETTINGS.enough_checks:
            return found, keys
        known = one.evidence.groups
        alike = {e.key: e for e in found.effects if e.kind == "ambiguous"}
        for key, effect in alike.items():
            mine = next((k for k in [key, *effect.rivals] if k in keys), None)
            if mine is None:
                continue
            fits = {}
            for n in shapes(one, key)[: SETTINGS.most_shapes]:
                try:
                    fits[n] = self._fit([known[n].key if k == mine else k for k in keys])
                except (InputError, AdjustmentFailed) as failed:
                    self.notes.append(f"The fit with {known[n].key} failed: {failed}")
            best = held_out.best_by_far(self.second, fits)
            if best is None:
                continue
            self.notes.append(
                f"The fit cannot tell {mine} and {known[best].key} apart; check points are "
                f"predicted better by far with {known[best].key}, so their error afterwards is no "
                "longer independent."
            )
            keys = [known[best].key if k == mine else k for k in keys]
            found = in_place_of(found, one, key, best)
            self.second = fits[best]
            self.gap = held_out.tie_gap(self.first, self.second, self.rows)
        return found, keys


def _effect(one, used: list[str], rivals: dict[str, dict[str, float]]) -> dict:
    out = {
        "slug": one.slug,
        "class": one.kind,
        "log_evidence": one.log_evidence,
        "parameters": one.parameters,
        "cannot_be_told_apart_from": one.alternatives,
        **one.where,
    }
    if one.values is not None:
        out |= {"group": one.values.kind, "values": one.values.to_json()}
    if not one.rivals:
        return out
    adjusted = next((key for key in [one.key, *one.rivals] if key in used), None)
    return out | {
        "separated_by": one.separate,
        "adjusted_with": adjusted,
        "held_out": {key: rivals[key] for key in one.rivals if key in rivals},
    }
