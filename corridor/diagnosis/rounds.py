"""Search, add the winners to the model, adjust again, search again from empty.

Strong effects bend the adjustment around them and inflate the noise: only after a refit is the
linearisation that of the truth, and only then can weaker effects be seen.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from corridor.adjustment import Adjustment
from corridor.diagnosis.candidates import Candidates, candidates, with_points
from corridor.diagnosis.equations import Equations, equations
from corridor.diagnosis.evidence import Evidence, effect_sizes
from corridor.diagnosis.gnss_noise import GnssNoise
from corridor.diagnosis.noise_model import NoiseModel
from corridor.diagnosis.reduced import Elimination
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.search import Found, contributions, search, tuned
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
    """All rounds. first: the adjustment of the believed model; candidates: what was tested."""

    first: Adjustment
    rounds: list[Round]
    candidates: Candidates
    notes: list[str] = field(default_factory=list)

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
        one = _round(adjustment, believed, chosen.effects, model, threshold, level, seed)
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
            again = _round(adjustment, believed, chosen.effects, model, threshold, level, seed)
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


def _round(adjustment, believed, effects, model, threshold, level, seed) -> Round:
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
    noises = NoiseModel(e.system, stated, plain)
    # A third of a gigabyte with a thousand images, and no longer needed.
    del stated
    start = {plain.number[key]: _kappa(plain, key) for key in model if key in plain.number}
    noise, _ = noises.given(start)
    evidence = Evidence(Elimination(e, noise).reduce())
    if threshold is None:
        threshold = thresholds(evidence, level, np.random.default_rng(seed))
    found = search(evidence, threshold["suspected"], model)
    log = {"model": list(model), "sigma_px": float(np.median(e.scales.of_observation))}
    more = _through_noise(noises, plain, evidence, found, threshold, model)
    if more:
        noise, _ = noises.given(more)
        evidence = Evidence(Elimination(e, noise).reduce())
        found = search(evidence, threshold["suspected"], model)
        log["through_noise"] = [plain.groups[n].key for n in more]
    found = _kept(evidence, found, model)
    found = _at_any_size(evidence, found, threshold["suspected"])
    found = _without_parts(evidence, found, threshold["suspected"])
    found = _beyond_noise(noises, found, threshold["suspected"])
    log["found"] = {evidence.groups[n].key: float(v) for n, v in found.evidence.items()}
    keys = [evidence.groups[n].key for n in found.chosen]
    return Round(adjustment, e, noise, noises, evidence, threshold, found, keys, log)


def _kept(evidence: Evidence, found: Found, model: list[str]) -> Found:
    """The model that is in place, where another of its size is hardly better.

    Look-alikes would take turns for ever; that they are look-alikes is said in the verdict.
    """
    numbers = [evidence.number[key] for key in model if key in evidence.number]
    if not numbers or len(numbers) != len(found.chosen) or set(numbers) == set(found.chosen):
        return found
    mine = tuned(evidence, dict.fromkeys(numbers, 1.0))
    total = evidence.model(mine)[0]
    each = contributions(evidence, mine)
    if found.total - total > SETTINGS.model_log_odds:
        return found
    order = sorted(mine, key=lambda n: -each[n])
    return Found({n: mine[n] for n in order}, {n: each[n] for n in order}, total)


def _at_any_size(evidence: Evidence, found: Found, threshold: float) -> Found:
    """The model without what is there only because another effect was held small.

    One prior for all parameters of a group shrinks the few that are large, and a second group takes
    up what is left. With the others free to be as large as they like it has nothing to explain.
    """
    groups, chosen = evidence.groups, dict(found.chosen)
    for n in sorted(chosen, key=lambda n: found.evidence[n]):
        others = {
            k: kappa
            if groups[k].known or len(groups[k]) > SETTINGS.most_free
            else SETTINGS.implausible_size
            for k, kappa in chosen.items()
            if k != n
        }
        # The strongest is never a part of what is weaker.
        if not others or found.evidence[n] == max(found.evidence[k] for k in chosen):
            continue
        if evidence.given(others)[n].evidence < threshold:
            del chosen[n]
    if len(chosen) == len(found.chosen):
        return found
    chosen = tuned(evidence, chosen)
    return Found(chosen, contributions(evidence, chosen), evidence.model(chosen)[0])


def _without_parts(evidence: Evidence, found: Found, threshold: float) -> Found:
    """The model without named effects that are part of an unknown one, or what it leaves.

    Where a generic shape explains more than a named effect of the same side, the named one is
    not the cause, and makes up for what the shape is too coarse for.
    """
    groups = evidence.groups
    generic = [n for n in found.chosen if groups[n].generic]
    chosen = {
        n: kappa
        for n, kappa in found.chosen.items()
        if not any(
            _side(groups[n]) == _side(groups[k])
            and (
                found.evidence[n] < SETTINGS.share_beside_generic * found.evidence[k]
                or (kappa >= SETTINGS.implausible_size and not groups[n].generic)
            )
            for k in generic
            if k != n
        )
    }
    if len(chosen) == len(found.chosen):
        return found
    each = contributions(evidence, chosen)
    return Found(chosen, each, evidence.model(chosen)[0])


def _side(group) -> str:
    """Image, antenna or ground: where an effect shows."""
    return group.effect.place if group.effect.place in ("antenna", "ground") else "image"


def _kappa(evidence: Evidence, key: str) -> float:
    """A wide prior for a group that is in the model already."""
    return 1.0 if evidence.groups[evidence.number[key]].known else SETTINGS.prior_of_adjusted


def _through_noise(noises, plain, evidence, found, threshold, model) -> dict[int, float] | None:
    """A model with one more group, where noise and group together explain the data better.

    None where nothing hides in the noise, or strong effects wait to be adjusted first. model:
    keys of what has been. The shortlist is what would win if the GNSS were as
    good as it says.
    """
    if noises.few:
        return None
    strong = [
        evidence.groups[n].key for n, v in found.evidence.items() if v > SETTINGS.clear_evidence
    ]
    if not set(strong) <= set(model):
        return None
    here = evidence.given(found.chosen)
    if max((gain.evidence for gain in here), default=0.0) > SETTINGS.clear_evidence:
        return None
    if not found.chosen or min(found.evidence.values()) < SETTINGS.clear_evidence:
        base = {
            n: k for n, k in found.chosen.items() if found.evidence[n] >= SETTINGS.clear_evidence
        }
    else:
        base = dict(found.chosen)
    base = {n: max(k, 1.0) for n, k in base.items()}
    at_stated = plain.given(base)
    order = sorted(range(len(at_stated)), key=lambda n: -at_stated[n].evidence)
    short = [n for n in order if at_stated[n].evidence > threshold["named"]][: SETTINGS.shortlist]
    ranked = sorted(range(len(here)), key=lambda n: -here[n].evidence)
    short += [n for n in ranked[:2] if n not in short and here[n].evidence > 0.0]
    short = [n for n in short if n not in base and noises.touches(n) > SETTINGS.gnss_share]
    if not short:
        return None
    _, total = noises.given(base)
    best = None
    for n in short:
        found_total, kappa = _beside_noise(noises, base, n, at_stated[n].kappa)
        if best is None or found_total > best[0]:
            best = found_total, base | {n: kappa}
    return best[1] if best[0] - total > threshold["suspected"] else None


def _beyond_noise(noises, found: Found, threshold: float) -> Found:
    """The model with the evidence of what the antenna feels against noise that may do the same.

    Noise that was estimated with an effect in the model leaves all of it to the effect. What is
    missing without the effect is what noise of another size and slowness cannot make up for.
    """
    if noises.few:
        return found
    each = dict(found.evidence)
    for n, gain in found.evidence.items():
        if gain > SETTINGS.clear_evidence or noises.touches(n) <= SETTINGS.gnss_share:
            continue
        rest = {
            k: kappa
            for k, kappa in found.chosen.items()
            if k != n and noises.evidence.block(noises.evidence.groups[k])[0] is not None
        }
        _, without = noises.given(rest)
        total, _ = _beside_noise(noises, rest, n, found.chosen[n])
        each[n] = min(gain, total - without)
    order = sorted((n for n in each if each[n] > threshold), key=lambda n: -each[n])
    return Found({n: found.chosen[n] for n in order}, {n: each[n] for n in order}, found.total)


def _beside_noise(noises, base, n: int, kappa: float) -> tuple[float, float]:
    """Log probability of the data with one more group, averaged over its sizes, and the likeliest.

    The noise is estimated with the group in the model, of size `kappa`.
    """
    found, total = noises.given(base | {n: kappa})
    if noises.evidence.groups[n].known:
        return total, kappa
    each: dict[int, float] = {}
    sizes, _ = effect_sizes()
    begin = int(np.argmin(np.abs(np.log(sizes / kappa))))
    for upwards in (range(begin, len(sizes)), range(begin - 1, -1, -1)):
        for k in upwards:
            each[k] = noises.at(base | {n: float(sizes[k])}, found)
            if each[k] < max(each.values()) - SETTINGS.model_log_odds:
                break
    return float(np.logaddexp.reduce(list(each.values()))), float(sizes[max(each, key=each.get)])


def _check_priors(believed: ReferenceModel, names: dict[str, Effect]) -> None:
    """Refuse priors of what is neither estimated nor a candidate."""
    known = {effect.slug for effect in believed.effects} | set(names) | {"camera", "lever_arm"}
    for label in believed.priors:
        if label.partition(".")[0] not in known:
            raise InputError(
                f"prior {label}: nothing of that name is estimated or tested; correct the name, "
                "or add the column that the effect needs"
            )
