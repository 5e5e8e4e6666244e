"""Search, add the winners to the model, adjust again, search again from empty.

Strong effects bend the adjustment around them and inflate the noise: only after a refit is the
linearisation that of the truth, and only then can weaker effects be seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from corridor.core.adjustment import Adjustment, LinearSystem, listed
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import Candidates, Effect, candidates, every_effect
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis.evidence.blunders import Blunders, blunders, price, stands
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.jumps import with_jumps
from corridor.diagnosis.evidence.lens import Lens, lens_group, lens_of, names_of_lens
from corridor.diagnosis.evidence.nothing import probability_of_nothing
from corridor.diagnosis.evidence.plausibility import impossible, nameless, plausible
from corridor.diagnosis.evidence.profile_likelihood import (
    NoiseModel,
    beyond_noise,
    known,
    through_noise,
)
from corridor.diagnosis.evidence.scores import Influence, as_spread, drawn, inflation_of_scores
from corridor.diagnosis.evidence.search import Found, search, thresholds
from corridor.diagnosis.noise.gnss import GnssNoise
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS, Settings
from corridor.diagnosis.system.elimination import Elimination, too_wide
from corridor.diagnosis.system.equations import Equations, equations
from corridor.diagnosis.system.groups import of_some

# Rows of an image: its pose, the slow noise of its position, and as many values as its pose has.
_WITH_VALUES = 15

# Log evidence that a group has to bring, by its kind; or what makes it from evidence.
Threshold = dict[str, float] | Callable[[Evidence], dict[str, float]]


@brief
@dataclass
class Round:
    """One pass: the adjustment it began with, what it found there, and by which limits.

    keys: of the groups that were found. lens: as it is beside them. wrong: control points among
    them that failed their test. beside_nothing: with the noise of the GNSS beside the model it
    began with, of the first round, until it has been asked. Of large blocks the last round alone
    keeps its equations and evidence, until it is saved.
    """

    adjustment: Adjustment
    equations: Equations | None
    noise: GnssNoise | None
    noises: NoiseModel | None
    evidence: Evidence | None
    threshold: dict[str, float]
    found: Found
    keys: list[str]
    log: dict = field(default_factory=dict)
    lens: Lens | None = None
    wrong: Blunders = Blunders()
    beside_nothing: Evidence | None = None

    @property
    def misstated(self) -> np.ndarray | None:
        """Factors (flights, 3) on standard deviations of antenna positions that are stated much too
        well; None where they are not, or strong effects wait to be adjusted first: images that do
        not fit their model do not hold the cameras either."""
        found = self.found.evidence
        strong = {self.evidence.groups[n].key for n in found if found[n] > SETTINGS.clear_evidence}
        return self.noises.misstated if strong <= set(self.log["model"]) else None

    def evidence_at(
        self, fit: Adjustment, effects: list[Effect], priors: dict, lens: bool = True
    ) -> Evidence:
        """What another fit says of effects, with the noise of the GNSS and the lens of this one."""
        shapes = [] if self.lens is None or not lens else [self.lens.group.effect]
        e, rows = equations(fit, [*effects, *shapes], priors), ()
        if shapes and (group := lens_group(e)) is not None:
            rows = replace(self.lens, group=group).rows
        return Evidence(Elimination(e, self.noise, rows).reduced())

    def let_go(self) -> None:
        """Forget what can be made anew, once the findings are known."""
        # What the report tells, while the spectra are there.
        self.evidence.given({})
        self.evidence.given(self.found.chosen)
        self.evidence.let_go()
        self.noises.evidence.let_go()

    def make_room(self) -> None:
        """Of large blocks keep what images share, and what the report tells."""
        if self.adjustment.problem.image_count > SETTINGS.large_block:
            self.evidence.let_go_of_images()
            self.equations = self.noises = None

    def shed(self) -> None:
        """Let go of what is made anew, and of what weighs gigabytes in large blocks."""
        self.evidence.let_go()
        self.noises.evidence.let_go()
        if self.adjustment.problem.image_count > SETTINGS.large_block:
            self.equations = self.evidence = self.noises = None


@brief
@dataclass
class Course:
    """All rounds. first: the adjustment of the believed model; candidates: what was tested.

    impossible: keys of groups that would need a size which does not happen, and a sentence each.
    draws: what independent noise leaves of itself, see `clusters`. p_nothing: see `nothing`.
    unasked: a sentence on what such a block as a whole cannot be asked for.
    """

    first: Adjustment
    rounds: list[Round]
    candidates: Candidates
    notes: list[str] = field(default_factory=list)
    impossible: dict[str, str] = field(default_factory=dict)
    draws: list[np.ndarray] = field(default_factory=list)
    p_nothing: float = 1.0
    unasked: str = ""

    @property
    def idle(self) -> list[str]:
        """A sentence on each shape that the last round found and that does nothing."""
        return [
            f"Residuals are correlated as in {effect.called}; it neither moves the ground nor "
            "changes the residuals enough to matter, and is not a finding."
            for effect in self.candidates.effects if effect.slug in self.last.log["idle"]
        ]  # fmt: skip

    @property
    def last(self) -> Round:
        """The round whose findings count."""
        return self.rounds[-1]

    def members(self, keys: Iterable[str]) -> list[Effect]:
        """Effects of groups by their keys; several control points make one effect."""
        names = {effect.slug: effect for effect in self.candidates.effects}
        points: dict[str, list[str]] = {}
        for key in keys:
            slug, _, point = key.partition(".")
            points.setdefault(slug, []).extend([point] if point else [])
        return [of_some(names[slug], chosen) for slug, chosen in points.items()]


@dataclass(frozen=True)
class Question:
    """What is asked of a block beside the model one believes in.

    only, without: slugs of the catalogue to test, or to leave out. level: probability of a false
    name in a block that lacks nothing. seed: of what is drawn. settings: the numbers by which it
    is decided; default: the usual ones.
    """

    only: str | Iterable[str] | None = None
    without: str | Iterable[str] = ()
    level: float = 0.01
    seed: int = 0
    settings: Settings | None = None

    def __post_init__(self):
        if not 0.0 < self.level < 1.0:
            raise InputError(
                f"level {self.level} is not a probability: use a number between 0 and 1"
            )


def course_of(
    believed: ReferenceModel, asked: Question, say: Callable[[str], None] = lambda _: None
) -> Course:
    """Rounds of search and refit until they agree, three refits at most."""
    say("adjusting the believed model")
    adjustment = first = believed.adjust()
    system = adjustment.system
    chosen = candidates(
        believed.block, system.free, believed.effects, system.control_names,
        None if asked.only is None else listed(asked.only), listed(asked.without),
    )  # fmt: skip
    _check_priors(believed, chosen.effects)
    course = Course(first, [], chosen, _without_motion(believed.block, chosen))
    course.unasked = _without_images(system, chosen)
    threshold: Threshold = partial(
        thresholds, level=asked.level, rng=np.random.default_rng(asked.seed)
    )
    model: list[str] = []
    for number in range(1 + SETTINGS.most_refits):
        say(f"searching, round {number + 1}")
        one = _round(course, adjustment, believed, model, threshold)
        factor = one.misstated
        if factor is not None:
            believed.restate_positions(factor, one.adjustment)
            course.first = first = believed.adjust()
            try:
                adjustment = believed.adjust(course.members(model)) if model else first
            except (InputError, AdjustmentFailed):
                model, adjustment = [], first
            one = _round(course, adjustment, believed, model, threshold)
        course.rounds.append(one)
        if not number:
            rng = np.random.default_rng([asked.seed, 1])
            course.p_nothing = probability_of_nothing(one.beside_nothing, rng)
            if course.p_nothing >= asked.level:
                # What all tests together do not show has to show by itself (Good 1950).
                for kind in ("named", "beside_noise"):
                    one.threshold[kind] = max(one.threshold[kind], -np.log(asked.level))
        threshold, one.beside_nothing = one.threshold, None
        if number == SETTINGS.most_refits:
            break
        if set(one.keys) == set(model):
            started = _from_their_start(course, believed, one)
            if started is None:
                break
            model, adjustment = started
            say(f"adjusted with {', '.join(model)}")
            one.shed()
            continue
        model = one.keys
        chosen.effects = with_jumps(chosen.effects, one.evidence, one.found)
        say(f"adjusting with {', '.join(model) or 'nothing more'}")
        try:
            adjustment = believed.adjust(course.members(model)) if model else first
        except (InputError, AdjustmentFailed) as failed:
            course.notes.append(f"The refit with {', '.join(model)} failed: {failed}")
            break
        one.shed()
        if any(set(model) == set(before.keys) for before in course.rounds[:-1]):
            # Two models take turns: what the later refit says of itself decides.
            again = _round(course, adjustment, believed, model, threshold)
            course.rounds.append(again)
            break
    return course


def _without_motion(block: Block, chosen: Candidates) -> list[str]:
    """Take out candidates that need rows read while the camera moves, where it does not happen.

    A camera that reads its rows at once (`readout_s = 0`) shows none of them. Values for each image
    follow whatever differs from row to row: without speeds, rates or a readout nothing in the data
    makes a motion of it, and a shape of no catalogue says the same. Returns a sentence on that.
    """
    stated = [camera.readout_s for camera in block.cameras.values()]
    moving = any(stated) or block.has("images.vx") or len(block.rates) > 0 or len(block.track) > 0
    at_once = all(one == 0.0 for one in stated)
    gone = [
        effect
        for effect in chosen.effects
        if effect.during_readout and (at_once or (effect.group == "image" and not moving))
    ]
    if at_once:
        # No column would make one of them the cause.
        motions = {effect.slug for effect in every_effect() if effect.place == "motion"}
        chosen.untestable = {k: v for k, v in chosen.untestable.items() if k not in motions}
    if not gone:
        return []
    chosen.effects = [effect for effect in chosen.effects if effect not in gone]
    names = ", ".join(sorted(effect.slug for effect in gone))
    names += " is" if len(gone) == 1 else " are"
    if at_once:
        return [
            f"block.toml states that all rows are read at once (readout_s = 0): {names} not tested."
        ]
    return [
        f"Nothing in the block states how the camera moves while rows are read: {names} not "
        "tested, and what differs from row to row has no name. Velocities in images.csv, or "
        "readout_s in block.toml, would give it one."
    ]


def _without_images(system: LinearSystem, chosen: Candidates) -> str:
    """Take out what an area of photographs is too large for; a sentence on that, or nothing."""
    few = system.gnss.sigma.size < 3 * SETTINGS.fewest
    noise = not few and not known(system)
    gone = [
        effect
        for effect in chosen.effects
        if (noise and effect.place == "antenna")
        or (effect.group == "image" and too_wide(system, _WITH_VALUES))
    ]
    if not gone:
        return ""
    chosen.effects = [effect for effect in chosen.effects if effect not in gone]
    chosen.untestable |= {
        effect.slug: "a block of a few neighbouring strips, in place of the whole area"
        for effect in gone
    }
    return (
        f"{'Errors of the GNSS and values' if noise else 'Values'} for each image ({len(gone)} "
        f"effects) cannot be told of this block as a whole: its {system.problem.image_count} "
        "images are no corridor, but hang together with others up to "
        f"{system.problem.bandwidth - 1} places away; a few neighbouring strips can be asked."
    )


def _from_their_start(
    course: Course, believed: ReferenceModel, one: Round
) -> tuple[list[str], Adjustment] | None:
    """The model with what is no small change of it, where that fits better, and the fit.

    A delay does nothing without a readout: of an effect that starts elsewhere than at nothing the
    equations at nothing say too little, and it is adjusted once from its start, in the place of
    shapes of no catalogue. The search of the next round drops what it makes needless.
    """
    number, groups = one.evidence.number, one.evidence.groups
    named = [key for key in one.keys if not groups[number[key]].generic]
    for effect in course.candidates.effects:
        if effect.slug in one.keys or not any(p.start for p in effect.parameters(believed.block)):
            continue
        # Beside what was found, or in the place of what shows in the same way.
        others = [key for key in named if groups[number[key]].effect.place != effect.place]
        for kept in (named, others)[: 1 + (others != named)]:
            keys = [*kept, effect.slug]
            try:
                fit = believed.adjust(course.members(keys))
            except (InputError, AdjustmentFailed):
                continue
            gain = (one.adjustment.cost - fit.cost) / fit.sigma0**2
            # Of two that fit alike the one with fewer unknowns is better, by however little.
            simpler = len(fit.system.columns) < len(one.adjustment.system.columns)
            if gain > (0.0 if simpler else 2.0 * SETTINGS.look_alike_log_odds):
                return keys, fit
    return None


def _round(
    course: Course,
    adjustment: Adjustment,
    believed: ReferenceModel,
    model: list[str],
    threshold: Threshold,
) -> Round:
    """A search beside the lens as it is beside what that search finds."""
    effects = course.candidates.effects
    e = equations(adjustment, effects, believed.priors_of(effects))
    noise = course.last.noise if course.rounds else None
    asked = _Asked(adjustment, e, model, course.impossible, course.draws, noise)
    whole, shape = Evidence(Elimination(e, None).reduced()), lens_group(e)
    there = {whole.number[key]: _kappa(whole, key) for key in model if key in whole.number}
    lens = None if shape is None else lens_of(whole, shape, there)
    one = asked.search(lens, threshold)
    if shape is None:
        return one
    again = lens_of(whole, shape, one.found.chosen)
    if (again is None) != (lens is None):
        # What was found is what the lens seemed to be, or the other way round.
        one = asked.search(again, one.threshold)
        again = again and lens_of(whole, shape, one.found.chosen)
    one.lens = again
    return one


@dataclass
class _Asked:
    """The equations of a round, and what they say with the GNSS as good as it says.

    model: keys of what has been adjusted. barred: keys of what is no explanation, and why; it
    grows. draws: of the course, made once. noise: of the GNSS, as the round before has it.
    """

    adjustment: Adjustment
    equations: Equations
    model: list[str]
    barred: dict[str, str]
    draws: list[np.ndarray]
    noise: GnssNoise | None

    def search(self, lens: Lens | None, threshold: Threshold) -> Round:
        """What is found beside a lens."""
        e, model = self.equations, self.model
        plain = self._evidence(None, lens)
        # The stated noise is asked about what the antenna feels and what is in the model.
        images = len(e.system.columns.images)
        plain.barred |= {
            group.key
            for group in e.groups
            if group.own is not None and len(group) > images and group.key not in model
        }
        start = {plain.number[key]: _kappa(plain, key) for key in model if key in plain.number}
        noises = NoiseModel(plain, self.noise, start)
        noise, _ = noises.given(start)
        evidence = self._evidence(noise, lens)
        if not isinstance(threshold, dict):
            threshold = threshold(evidence)
        suspected = threshold["suspected"]
        before = evidence
        found, wrong = self._found(evidence, plain, suspected)
        log = {"model": list(model), "sigma_px": float(np.median(e.scales.of_observation))}
        more = through_noise(noises, plain, evidence, found, threshold, model)
        if more:
            noise, _ = noises.given(more)
            evidence = self._evidence(noise, lens)
            found, wrong = self._found(evidence, plain, suspected)
            log["through_noise"] = [plain.groups[n].key for n in more]
        found = plausible(evidence, found, suspected)
        idle = [n for n in found.chosen if not self._matters(evidence, found, n)]
        found = found.without(idle)
        log["idle"] = [evidence.groups[n].key for n in idle]
        found = beyond_noise(noises, found, suspected)
        evidence.inflation = self._inflation(evidence, found)
        found = as_spread(evidence, found, suspected)
        keys = {n: evidence.groups[n].key for n in found.chosen}
        log["found"] = {keys[n]: float(value) for n, value in found.evidence.items()}
        log["inflation"] = {key: float(evidence.inflation[n]) for n, key in keys.items()}
        return Round(
            self.adjustment, e, noise, noises, evidence, threshold, found, [*keys.values()], log,
            wrong=wrong, beside_nothing=before,
        )  # fmt: skip

    def _evidence(self, noise: GnssNoise | None, lens: Lens | None) -> Evidence:
        rows = () if lens is None else lens.rows
        return Evidence(Elimination(self.equations, noise, rows).reduced(), self._barred())

    def _inflation(self, evidence: Evidence, found: Found) -> np.ndarray:
        """Factors (groups,) on the variance of scores, asked of what has been adjusted and found.

        Beside a model that does not fit, residuals hang together by what it misses.
        """
        both = [n for n in found.chosen if evidence.groups[n].key in self.model]
        if not any(evidence.groups[n].single is None for n in both):
            return evidence.inflation
        if not self.draws:
            self.draws += drawn(self.adjustment, self.equations)
        influence = Influence(evidence.reduced.elimination, self.draws)
        return inflation_of_scores(influence, evidence, both)

    def _matters(self, evidence: Evidence, found: Found, n: int) -> bool:
        """Whether a group of a model does anything to the ground, or to the residuals.

        Residuals of one image always hang together, and a shape of its own in each image follows
        them. It would be taken out again where it has been adjusted (see `held_out.Cost`, which
        has the same limits): what it does to data that no fit has used is less than what it does
        to those of the fit.
        """
        group = evidence.groups[n]
        if group.own is None or not group.generic or group.effect.place != "image":
            return True
        e = self.equations
        rest = {k: kappa for k, kappa in found.chosen.items() if k != n}
        fit = evidence.given(rest, only=n)[n].fit
        weight = e.scales.of_observation**-2.0
        square = float(((e.pixels**2).sum(axis=1) * weight)[np.isfinite(weight)].sum())
        if 2.0 * fit > (1.0 - SETTINGS.cost_ratio**2) * square:
            return True
        values = evidence.of_each_image(found.chosen, n)
        moved = Influence(evidence.reduced.elimination).ground_moved_by_images(group, values)
        sigmas = np.abs(moved / self.adjustment.point_sigma)
        return bool(np.nanmedian(sigmas, axis=0).max() > SETTINGS.implausible_sigma)

    @property
    def _moving(self) -> bool:
        """Whether the block states how the camera moves during a readout, or that there is one."""
        block = self.adjustment.problem.block
        return len(block.rates) > 0 or any(c.readout_s for c in block.cameras.values())

    def _barred(self) -> set[str]:
        """What is no explanation: impossible sizes, and other names of a lens that is modelled."""
        return set(self.barred) | names_of_lens(self.equations)

    def _found(
        self, evidence: Evidence, plain: Evidence, threshold: float
    ) -> tuple[Found, Blunders]:
        """What explains the data, control points that failed their test first, and these.

        Only what is clearly likelier than blunders takes their place: what needs none, or less of
        them than a handful.
        """
        wrong, found = blunders(evidence), self._possible(evidence, threshold)
        if wrong.found is None:
            return found, Blunders()
        plain.widen()
        for n, names in wrong.found.of_point.items():
            evidence.narrow(n, names)
            plain.narrow(n, names)
        kept = self._possible(evidence, threshold, wrong.found.points)
        rest = {n: kappa for n, kappa in kept.chosen.items() if n not in kept.kept}
        without, with_them = (m.total + price(evidence.groups, m.chosen) for m in (found, kept))
        likely = without - with_them <= SETTINGS.model_log_odds
        # A point that explains nothing beside the others is not wrong, whatever it was alone.
        likely = likely and min(kept.evidence[n] for n in kept.kept) > 0.0
        if likely and stands(evidence, wrong.found, rest):
            return kept, wrong
        evidence.widen()
        plain.widen()
        return found, Blunders()

    def _possible(self, evidence: Evidence, threshold: float, kept=()) -> Found:
        """The search without what needs an impossible size or has no name; barred grows by that."""
        while True:
            found = search(evidence, threshold, self.model, kept)
            beyond = impossible(evidence, found) | nameless(evidence, found, self._moving)
            if not beyond:
                return found
            self.barred |= beyond
            evidence.barred |= set(beyond)


def _kappa(evidence: Evidence, key: str) -> float:
    """A wide prior for a group that is in the model already."""
    return 1.0 if evidence.groups[evidence.number[key]].known else SETTINGS.prior_of_adjusted


def _check_priors(believed: ReferenceModel, tested: list[Effect]) -> None:
    """Refuse priors of what is neither estimated nor a candidate."""
    known = {effect.slug for effect in (*believed.effects, *tested)} | {"camera", "lever_arm"}
    for label in believed.priors:
        if label.partition(".")[0] not in known:
            raise InputError(
                f"prior {label}: nothing of that name is estimated or tested; correct the name, "
                "or add the column that the effect needs"
            )
