"""Search, add the winners to the model, adjust again, search again from empty.

Strong effects bend the adjustment around them and inflate the noise: only after a refit is the
linearisation that of the truth, and only then can weaker effects be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from corridor.adjustment import Adjustment
from corridor.diagnosis.beside_noise import beyond_noise, through_noise
from corridor.diagnosis.candidates import Candidates, candidates, with_points
from corridor.diagnosis.equations import Equations, equations
from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.gnss_noise import GnssNoise
from corridor.diagnosis.noise_model import NoiseModel
from corridor.diagnosis.plausibility import impossible, plausible
from corridor.diagnosis.reduced import Elimination
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.search import Found, search
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.threshold import thresholds
from corridor.effects import Effect
from corridor.errors import AdjustmentFailed, InputError


@dataclass
class Round:
    """One pass: the adjustment it began with, what it found there, and by which limits.

    keys: of the groups that were found. Of large blocks the last round alone keeps its equations
    and evidence.
    """

    adjustment: Adjustment
    equations: Equations | None
    noise: GnssNoise
    noises: NoiseModel | None
    evidence: Evidence | None
    threshold: dict[str, float]
    found: Found
    keys: list[str]
    log: dict = field(default_factory=dict)

    def shed(self) -> None:
        """Let go of what weighs gigabytes in a block of a thousand images."""
        if len(self.adjustment.block.images) > SETTINGS.large_block:
            self.equations = self.evidence = self.noises = None


@dataclass
class Course:
    """All rounds. first: the adjustment of the believed model; candidates: what was tested.

    impossible: keys of groups that would need a size which does not happen, and a sentence each.
    """

    first: Adjustment
    rounds: list[Round]
    candidates: Candidates
    notes: list[str] = field(default_factory=list)
    impossible: dict[str, str] = field(default_factory=dict)

    @property
    def last(self) -> Round:
        """The round whose findings count."""
        return self.rounds[-1]


def run(
    believed: ReferenceModel,
    only=None,
    without=(),
    level: float = 0.01,
    seed: int = 0,
    progress=None,
) -> Course:
    """Rounds of search and refit until they agree, three refits at most."""
    say = progress or (lambda _: None)
    say({"message": "adjusting the believed model"})
    adjustment = first = believed.adjust()
    system = adjustment.system
    chosen = candidates(
        believed.block, system.free, believed.effects, system.control_names, only, without
    )
    names = {effect.slug: effect for effect in chosen.effects}
    _check_priors(believed, names)
    course = Course(first, [], chosen)
    threshold = None
    model: list[str] = []
    for number in range(1 + SETTINGS.most_refits):
        say({"message": f"searching, round {number + 1}"})
        one = _round(course, adjustment, believed, model, threshold, level, seed)
        threshold = one.threshold
        course.rounds.append(one)
        if set(one.keys) == set(model) or number == SETTINGS.most_refits:
            break
        model = one.keys
        say({"message": f"adjusting with {', '.join(model) or 'nothing more'}"})
        try:
            adjustment = believed.adjust(members(names, model)) if model else first
        except (InputError, AdjustmentFailed) as failed:
            course.notes.append(f"The refit with {', '.join(model)} failed: {failed}")
            break
        one.shed()
        if any(set(model) == set(before.keys) for before in course.rounds[:-1]):
            # Two models take turns: what the later refit says of itself decides.
            again = _round(course, adjustment, believed, model, threshold, level, seed)
            course.rounds.append(again)
            break
    return course


def members(names: dict[str, Effect], keys: list[str]) -> list[Effect]:
    """Effects of groups by their keys; several control points make one effect."""
    points: dict[str, list[str]] = {}
    for key in keys:
        slug, _, point = key.partition(".")
        points.setdefault(slug, []).extend([point] if point else [])
    return [with_points(names[slug], chosen) for slug, chosen in points.items()]


def _round(course, adjustment, believed, model, threshold, level, seed) -> Round:
    effects, barred = course.candidates.effects, course.impossible
    e = equations(adjustment, effects, believed.priors_of(effects))
    stated = Elimination(e, None)
    # The stated noise is asked about what the antenna feels and what is in the model: no more.
    images = len(e.system.columns.images)
    several = {
        group.own
        for group in e.groups
        if group.own is not None and len(group) > images and group.key not in model
    }
    plain = Evidence(stated.reduce(but=several))
    plain.barred |= set(barred)
    noises = NoiseModel(e.system, stated, plain)
    # A third of a gigabyte with a thousand images, and no longer needed.
    del stated
    start = {plain.number[key]: _kappa(plain, key) for key in model if key in plain.number}
    noise, _ = noises.given(start)
    evidence = Evidence(Elimination(e, noise).reduce(), barred)
    if threshold is None:
        threshold = thresholds(evidence, level, np.random.default_rng(seed))
    found = _searched(evidence, threshold["suspected"], model, barred)
    log = {"model": list(model), "sigma_px": float(np.median(e.scales.of_observation))}
    more = through_noise(noises, plain, evidence, found, threshold, model)
    if more:
        noise, _ = noises.given(more)
        evidence = Evidence(Elimination(e, noise).reduce(), barred)
        found = _searched(evidence, threshold["suspected"], model, barred)
        log["through_noise"] = [plain.groups[n].key for n in more]
    found = plausible(evidence, found, model, threshold["suspected"])
    found = beyond_noise(noises, found, threshold["suspected"])
    log["found"] = {evidence.groups[n].key: float(v) for n, v in found.evidence.items()}
    keys = [evidence.groups[n].key for n in found.chosen]
    return Round(adjustment, e, noise, noises, evidence, threshold, found, keys, log)


def _searched(evidence: Evidence, threshold: float, model: list[str], barred: dict) -> Found:
    """The search without what would need an impossible size; barred grows by that."""
    while True:
        found = search(evidence, threshold, model)
        beyond = impossible(evidence, found)
        if not beyond:
            return found
        barred |= beyond
        evidence.barred |= set(beyond)


def _kappa(evidence: Evidence, key: str) -> float:
    """A wide prior for a group that is in the model already."""
    return 1.0 if evidence.groups[evidence.number[key]].known else SETTINGS.prior_of_adjusted


def _check_priors(believed: ReferenceModel, names: dict[str, Effect]) -> None:
    """Refuse priors of what is neither estimated nor a candidate."""
    known = {effect.slug for effect in believed.effects} | set(names) | {"camera", "lever_arm"}
    for label in believed.priors:
        if label.partition(".")[0] not in known:
            raise InputError(
                f"prior {label}: nothing of that name is estimated or tested; correct the name, "
                "or add the column that the effect needs"
            )
