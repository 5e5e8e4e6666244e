"""A block as arrays that the kernels can run over, and the list of its unknowns."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from corridor.core.adjustment.distances import ENDS, Distances, distances_of, with_ends
from corridor.core.adjustment.model import EFFECT, Model, ParameterId, Setting, listed_effects
from corridor.core.adjustment.observations import (
    Attitudes,
    Control,
    Gnss,
    Network,
    attitudes_of,
    control_of,
    gnss_of,
    network_of,
)
from corridor.core.adjustment.rigs import Rigs, rigs_in
from corridor.core.adjustment.uncertain_motion import MotionScale, prior_sigma, velocity_errors
from corridor.core.adjustment.unknowns import (
    Priors,
    State,
    Unknowns,
    Wanted,
    per_image_names,
    priors_of,
    refuse_twice,
    started,
    unknowns_of,
)
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import (
    Effect,
    EffectValues,
    Images,
    Stack,
    Values,
    believed_of,
    stated_lever_arms,
)
from corridor.core.engine.scene import PANEL
from corridor.core.options import made

# What may be measured of poses directly.
POSE_KINDS = ("gnss", "attitude")


@brief
@dataclass
class Problem(Network, Control, Distances, Gnss, Attitudes, Rigs, Unknowns, Priors):
    """Everything that stays the same from one iteration to the next.

    images: in the order of the problem. roles: of the rows of ground.csv, as asked for. free:
    interior parameters of each camera. idle (k, 2): image and unknown 6.. that nothing can
    determine, held at its start. beside: slugs of errors of velocities, which no table lists.
    notes: sentences for the reader.
    """

    block: Block
    model: Model
    images: Images
    roles: np.ndarray
    stack: Stack
    free: dict[str, tuple[str, ...]]
    arms_free: bool
    idle: np.ndarray
    start: State
    notes: list[str]
    beside: tuple[str, ...] = ()

    @property
    def image_count(self) -> int:
        return len(self.order)

    @property
    def exposure_count(self) -> int:
        """How many poses there are: images of a rig that were taken together have one."""
        return int(self.exposure[-1]) + 1 if len(self.exposure) else 0

    def measured(self, kind: str) -> np.ndarray:
        """Images (k,) of which a kind of `POSE_KINDS` is measured."""
        return getattr(self, f"{kind}_image")

    def weight_of(self, kind: str) -> np.ndarray:
        """Weights (k, 3) of a kind of `POSE_KINDS`."""
        return getattr(self, f"{kind}_weight")

    @property
    def shared_count(self) -> int:
        """How many unknowns images share."""
        return len(self.unknowns)

    @property
    def wide(self) -> int:
        """Columns of the shared unknowns in whole panels (at least one)."""
        return max(-(-self.shared_count // PANEL), 1) * PANEL

    @property
    def observation_count(self) -> int:
        """Single numbers measured, priors among them."""
        return (
            2 * len(self.img)
            + 3 * len(self.control_given)
            + len(self.distance_given)
            + 3 * sum(len(self.measured(kind)) for kind in POSE_KINDS)
            + 6 * len(self.rig_image)
            + int(np.count_nonzero(self.prior_weight))
            + int(np.count_nonzero(self.per_image_prior[1]))
        )

    @property
    def unknown_count(self) -> int:
        """Single numbers estimated."""
        return self.image_count * self.d + 3 * len(self.ptr[1:]) + self.shared_count

    @property
    def point_names(self) -> np.ndarray:
        """Names of the points, ties and marks, in the order of the problem."""
        return self.point_index.to_numpy(dtype=object)

    @property
    def names(self) -> pd.Index:
        """Names that `point_codes` count: of all points, ties and then marks."""
        ties, marks = (
            t["point"].dtype.categories for t in (self.block.tie_points, self.block.marks)
        )
        return ties.append(marks) if len(marks) else ties

    @property
    def point_index(self) -> pd.Index:
        """`point_names` without an object for each name."""
        return self.names.take(self.point_codes)

    def values(
        self,
        state: State,
        shared_sigma: np.ndarray | None = None,
        per_image_sigma: np.ndarray | None = None,
    ) -> Values:
        """Values of the effects at a state, of the groups that are estimated.

        shared_sigma: of the `unknowns`. per_image_sigma: (images, unknowns of each). What is held
        has the standard deviation 0.
        """
        out = []
        held = self.model.held
        for slug, member in self.stack.members.items():
            if slug in self.beside:
                continue
            # Values of images are kept in the order of the problem.
            of_images = member.effect.place != "ground" and member.effect.group == "image"
            groups = [str(n) for n in (self.images.names if of_images else member.groups)]
            value, sigma = (np.full((len(groups), len(member.parameters)), np.nan) for _ in "vs")
            for k, parameter in enumerate(member.parameters):
                for g, group in enumerate(groups):
                    which = ParameterId(EFFECT, slug, parameter.name, group)
                    if any(other.means(which) for other in held):
                        value[g, k], sigma[g, k] = state.effects[slug][g, k], 0.0
            for n, (other, k) in enumerate(self.per_image_unknowns):
                if other == slug:
                    value[:, k] = state.effects[slug][:, k]
                    value[self.idle[self.idle[:, 1] == 6 + n, 0], k] = np.nan
                    if per_image_sigma is not None:
                        sigma[:, k] = per_image_sigma[:, n]
            for n, unknown in enumerate(self.unknowns):
                if (unknown.kind, unknown.owner) == ("effect", slug):
                    value[unknown.at] = state.effects[slug][unknown.at]
                    if shared_sigma is not None:
                        sigma[unknown.at] = shared_sigma[n]
            out.append(EffectValues(member.effect, groups, member.parameters, value, sigma))
        return Values(out)


def make_problem(block: Block, model: Model | None = None, **options) -> Problem:
    """The problem of adjusting a block whose poses and points all have start values.

    model, or the options of `Model` in its place. Raises InputError for wrong input.
    """
    model = made(Model, model, options, "model")
    images = as_given = Images.of(block)
    roles = model.roles(block)
    names = block.ground["point"].to_numpy(dtype=object)
    asked = np.flatnonzero(roles == "control")
    # Whatever is wrong with the effects is said before the network is looked at.
    effects = listed_effects(model.effects)
    effects = [*effects, *believed_of(block, effects)]
    Stack(block, effects, list(names[asked]), as_given)
    beside = velocity_errors(block, effects)
    effects += beside
    network = network_of(block, images, set(names[asked]), set(names[roles == "unused"]))
    images = images.reordered(network.order)
    rank = np.empty_like(network.order)
    rank[network.order] = np.arange(len(rank))
    gnss, attitudes = gnss_of(block, rank), attitudes_of(block, rank)
    rigs = rigs_in(block, rank)
    control, notes = control_of(block, network, asked)
    distances, control, more = distances_of(block, network, control)
    notes += more
    stack = Stack(block, effects, list(names[control.control_rows]), as_given)

    arms_free = bool(len(gnss.gnss_image)) and model.arms_free(block)
    free, settings = model.free(block), model.settings_of(block)
    asked_for = [which for which, wish in settings.items() if wish.prior]
    for effect in effects:
        for (name, group), prior in effect.priors(block).items():
            which = ParameterId(EFFECT, effect.slug, name, group)
            if not any(other.means(which) for other in asked_for):
                settings.setdefault(which, Setting()).prior = prior
    measured = {"antenna": gnss.gnss_image, "attitude": attitudes.attitude_image}
    wanted = Wanted(
        free, arms_free, measured, list(names[control.control_rows]), distances.distance_rows,
        model.held,
    )  # fmt: skip
    unknowns = with_ends(unknowns_of(images, stack, wanted), distances)
    own = per_image_names(stack, unknowns.per_image_unknowns)
    priors = priors_of(unknowns.unknowns, own, settings, len(rank))
    for effect in beside:
        sigma = prior_sigma(block, effect, model.motion or MotionScale())
        if effect.group == "image":
            mine = [n for n, which in enumerate(own) if which.owner == effect.slug]
            priors.per_image_prior[1][:, mine] = sigma[network.order] ** -2.0
        else:
            mine = [n for n, u in enumerate(unknowns.unknowns) if u.owner == effect.slug]
            priors.prior_weight[mine] = sigma.ravel() ** -2.0
    refuse_twice(stack, free, unknowns.unknowns, own, priors)
    ends = {ENDS: np.zeros(distances.end_start.shape)} if distances.end_names else {}
    state = State(
        centre=images.centre,
        rotation=images.rotation,
        points=network.point_start,
        interior=np.array([c.interior for c in block.cameras.values()]),
        effects=stack.start() | ends,
        arms=stated_lever_arms(block),
    )
    return Problem(
        **vars(network),
        **vars(control),
        **vars(gnss),
        **vars(attitudes),
        **vars(distances),
        **vars(rigs),
        **vars(unknowns),
        **vars(priors),
        block=block,
        model=model,
        images=images,
        roles=roles,
        stack=stack,
        free=free,
        arms_free=arms_free,
        idle=_idle(stack, unknowns, measured, priors, len(rank)),
        start=started(state, images, stack, settings),
        notes=notes,
        beside=tuple(effect.slug for effect in beside),
    )


def _idle(
    stack: Stack, unknowns: Unknowns, measured: Mapping, priors: Priors, count: int
) -> np.ndarray:
    """(k, 2) image and unknown: one without GNSS has nothing to say on its own antenna."""
    silent = {place: np.setdiff1d(np.arange(count), some) for place, some in measured.items()}
    idle = [
        (image, 6 + n)
        for n, (slug, _) in enumerate(unknowns.per_image_unknowns)
        for image in silent.get(stack.members[slug].effect.place, ())
        if not priors.per_image_prior[1, image, n]
    ]
    return np.array(idle, dtype=np.int64).reshape(-1, 2)


def problem_of_points(problem: Problem, points: np.ndarray) -> Problem:
    """The same images with the rays of some points (k,) alone, in that order."""
    p, length = problem, np.diff(problem.ptr)[points]
    ptr = np.concatenate([[0], np.cumsum(length)])
    rays = np.repeat(p.ptr[points] - ptr[:-1], length) + np.arange(ptr[-1])
    return replace(
        p,
        ptr=ptr.astype(p.ptr.dtype),
        **{name: getattr(p, name)[rays] for name in ("img", "xy", "row")},
        weight=p.weight[rays] if len(p.weight) == len(p.img) else p.weight,
        skewed=p.skewed[rays] if len(p.skewed) else p.skewed,
        **{
            name: getattr(p, name)[points]
            for name in ("point_codes", "point_kinds", "point_start", "control")
        },
    )


def with_effects(problem: Problem, tested: Iterable[Effect]) -> Problem:
    """The same measurements with columns for effects that are tested, but for those of the antenna.

    Tested effects have no prior and may do what a free camera does: nothing is solved for them.
    Everything else stays as it was estimated, with its priors.
    """
    p, tested = problem, list(tested)
    slugs = {effect.slug for effect in tested}
    kept = [m.effect for slug, m in p.stack.members.items() if slug not in slugs]
    here = [effect for effect in tested if effect.place != "antenna"]
    control = list(p.block.ground["point"].to_numpy(dtype=object)[p.control_rows])
    stack = Stack(p.block, [*kept, *here], control, p.stack.images)
    measured = {"antenna": p.gnss_image, "attitude": p.attitude_image}
    wanted = Wanted(p.free, p.arms_free, measured, control, p.distance_rows, p.model.held)
    unknowns = with_ends(unknowns_of(p.images, stack, wanted), p)
    given = zip(p.unknowns, p.prior_value, p.prior_weight, strict=True)
    priors = {(u.kind, u.owner, u.label): prior for u, *prior in given}
    own = unknowns.per_image_unknowns
    of_images = dict(zip(p.per_image_unknowns, p.per_image_prior.transpose(2, 0, 1), strict=True))
    number = {key: 6 + n for n, key in enumerate(own)}
    idle = [(image, p.per_image_unknowns[n - 6]) for image, n in p.idle]
    idle = [(image, number[key]) for image, key in idle if key[0] not in slugs]
    nothing = (0.0, 0.0)
    shared_priors = [
        nothing if u.kind == "effect" and u.owner in slugs else priors[u.kind, u.owner, u.label]
        for u in unknowns.unknowns
    ]
    free = np.zeros((2, p.image_count))
    ends = {ENDS: p.start.effects[ENDS]} if p.end_names else {}
    per_image_priors = [free if key[0] in slugs else of_images[key] for key in own]
    value, weight = np.array(shared_priors, float).reshape(-1, 2).T
    return replace(
        p,
        **vars(unknowns),
        stack=stack,
        beside=tuple(slug for slug in p.beside if slug not in slugs),
        prior_value=value,
        prior_weight=weight,
        per_image_prior=np.array(per_image_priors).reshape(-1, *free.shape).transpose(1, 2, 0),
        idle=np.array(idle, dtype=np.int64).reshape(-1, 2),
        start=replace(p.start, effects=stack.start() | ends),
    )
