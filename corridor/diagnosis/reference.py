"""The believed model: what `corridor adjust` would be given, adjusted robustly."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from corridor.core import adjustment
from corridor.core.adjustment import (
    REFERENCE_CAMERA,
    Adjustment,
    Model,
    Run,
    arms_unseen,
    camera_of,
    without_depth,
    without_ties,
)
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import Effect, believed_of
from corridor.core.errors import AdjustmentFailed, some
from corridor.core.geometry import GROSS
from corridor.core.output import counted
from corridor.diagnosis.noise.image import scale_of
from corridor.diagnosis.settings import SETTINGS

# Step, in standard deviations, below which only weights are still on their way.
CREEPING = 0.1
# Damping, as a share of the diagonal, that shortens no step but along what nothing determines.
HARDLY_DAMPED = 1e-6
# What the first adjustment says of what it decided.
_DECISIONS = ("left out", "set aside", "contradict the stated", "miss each other")
# Control that was set aside for more than a candidate's prior allows (three times
# `prior_of_adjusted` scales of 0.05 m) stays aside; of less the evidence decides.
_FAR_CONTROL_M = 1.5
# Iterations over which the cost of one that has settled is compared.
_LAST = 5


@brief
@dataclass
class ReferenceModel:
    """A block and the options of its adjustment.

    model: what the user believes in; its priors are also of candidates. begun: where poses, points,
    cameras and believed effects (values by name) were left by an adjustment: the next one starts
    from there, its robust loss anew.
    astray: that one went far: what is added begins where the block states, not in its wrong valley.
    scale: of Student's t in stated standard deviations, as that adjustment's tie points have it.
    left_out: a sentence on each kind of what it could not use. run: how it is adjusted, in silence;
    max_iterations None: as the settings say.
    """

    block: Block
    model: Model
    run: Run = Run()
    begun: tuple[Block, dict[str, float]] | None = None
    scale: float = 1.0
    astray: bool = False
    left_out: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, block: Block, model: Model, run: Run | None = None) -> ReferenceModel:
        """The believed model with the camera of a diagnosis where it has no other."""
        camera = camera_of(block, REFERENCE_CAMERA) if model.camera is None else model.camera
        effects = [*model.effects, *believed_of(block, model.effects)]
        model = replace(model, camera=camera, effects=effects)
        return cls(block, model, replace(run or Run(), progress=None))

    @property
    def effects(self) -> list[Effect]:
        """Effects the user believes in."""
        return self.model.effects

    @property
    def priors(self) -> dict:
        """Priors by name, of the believed model and of candidates."""
        return {str(which): wish.prior for which, wish in self.model.settings.items() if wish.prior}

    def priors_of(self, effects: Iterable[Effect]) -> dict:
        """Priors that name cameras, lever arms, believed effects or one of `effects`."""
        known = {effect.slug: effect for effect in (*self.effects, *effects)}
        out = {}
        for which, wish in self.model.settings.items():
            if wish.prior is None or (which.kind == "effect" and which.owner not in known):
                continue
            if not which.name:
                first = known[which.owner].parameters(self.block)[0].name
                which = replace(which, name=first)
            out[str(which)] = wish.prior
        return out

    def _refitted(
        self, block: Block, model: Model, brief: bool, near: bool, motion: bool
    ) -> Adjustment:
        """By the solver alone: all adjustments that are compared are of the same observations.

        brief: few iterations are given. Then a fifth of all, and all where the cost still falls.
        near, motion: as of `core.adjustment.refit`.
        """
        most = self.run.max_iterations or SETTINGS.iterations
        few = min(SETTINGS.iterations_of_shapes, most)
        for iterations in (few, max(few, most // 5), most) if brief else (most // 5, most):
            run = replace(self.run, max_iterations=iterations)
            result = adjustment.refit(block, model, run, near, motion)
            cost = [step["cost"] for step in result.history]
            # The first few may begin with squares, of which the cost is another one.
            settled = SETTINGS.creeping if iterations == few and brief else SETTINGS.settled
            if result.converged or cost[-min(_LAST, len(cost))] - cost[-1] < settled * cost[-1]:
                break
            left, values = self._left(result)
            block, model, near = _from(block, left), model.starting(values), True
        return result

    def _left(self, result: Adjustment) -> tuple[Block, dict[str, float]]:
        """Where an adjustment ended: what follows begins there. A rig whose members hang as found,
        in an effect that begins with nothing, would be as far from its end as ever."""
        return result.as_left({effect.slug for effect in self.effects})

    def _first(self, model: Model) -> Adjustment:
        """By the verb, which decides what all others go by."""
        most = self.run.max_iterations or SETTINGS.iterations
        run = Run(self.run.threads, max_iterations=most, strict=self.run.strict)
        return adjustment.adjust(self.block, model=model, run=run, weights="marks")

    def adjust(
        self,
        more: Iterable[Effect] = (),
        block: Block | None = None,
        near: bool = False,
        after: Adjustment | None = None,
    ) -> Adjustment:
        """The robust adjustment with more effects.

        after: of about the same model: it begins where that ended, and its loss counts at once.
        near: as a rival of what has been fitted: it begins beside that, and a few iterations tell.
        Shapes with a hundred parameters creep to an end that they need not reach either.
        Effects that can do what a free camera can are held by a wide prior, those of single images
        by the spread one would expect of them, and what can only be so large by that.
        """
        more = list(more)
        priors = self.priors_of(more)
        for effect in more:
            held = effect.stands_in_for or effect.generic or effect.group in ("image", "point")
            for parameter in effect.parameters(self.block):
                each = effect.group == "image" or (effect.group == "point" and effect.generic)
                size = 1.0 if each else SETTINGS.prior_of_adjusted
                wide = size * parameter.scale
                sigma = min(wide if held else np.inf, parameter.most / SETTINGS.implausible_sigma)
                if np.isfinite(sigma):
                    priors.setdefault(f"{effect.slug}.{parameter.name}", (0.0, sigma))
        block = self.block if block is None else block
        first, model = self.begun is None, self.model
        if not first and not (more and self.astray):
            left, values = self.begun if after is None else self._left(after)
            block, model = _from(block, left), model.starting(values)
        # Positions of metres are weighted by their scatter first, for which squares do.
        coarse = first and arms_unseen(block)
        model = replace(
            model.with_priors(priors),
            effects=[*self.effects, *more],
            loss="squares" if coarse else f"cauchy:{SETTINGS.student_nu**0.5 * self.scale!r}",
        )
        if first:
            result = self._first(model)
        else:
            brief = (near and not self.astray) or any(effect.generic for effect in more)
            begins = (near or after is not None) and not (more and self.astray)
            result = self._refitted(block, model, brief, begins, motion=not near)
        # Warnings compare what comes out with what the block states, not with where it began.
        result.start = replace(result.start, cameras=self.block.cameras)
        if not first:
            return result
        _refuse_astray(result)
        self._decided_by(result)
        result = self.adjust(more)
        _refuse_astray(result)
        return result

    def _decided_by(self, result: Adjustment) -> None:
        """What the first adjustment decided holds for all that are compared with it."""
        self.astray = 2 * result.iterations > SETTINGS.iterations
        self.begun, self.scale = self._left(result), _scale(result)
        arm = "free" if result.problem.arms_free else "fixed"
        self.model = replace(self.model, lever_arm=arm)
        images = set(result.problem.images.names)
        flat = without_depth(result.system, self.scale)
        seen = without_ties(result.problem.block, flat)
        self.left_out = [note for note in result.notes if any(word in note for word in _DECISIONS)]
        if flat:
            self.left_out.append(
                f"{counted(len(flat), 'tie point')} with parallel rays left out "
                f"({some(sorted(flat), 5)}): nothing determines how far away they are."
            )
        block = self.block
        if len(images) < len(block.images):
            block = block.select(images=[n for n in block.images["image"] if n in images])
        gnss = result.start.gnss
        if len(gnss) == len(block.gnss) > 0:
            # What was set aside says nothing, whatever noise is estimated of the rest.
            factor = (result.start.gnss_sigma() / block.gnss_sigma()).max(axis=1)
            gnss = gnss[factor < GROSS * np.median(factor)].reset_index(drop=True)
        sigma = result.start.ground_sigma()
        far = (sigma > _FAR_CONTROL_M) & (sigma > block.ground_sigma())
        if far.any():
            block = block.copy()
            block.put("ground", ("sx", "sy", "sz"), np.where(far, sigma, block.ground_sigma()))
        self.block = replace(
            block,
            ground=block.ground.assign(role=result.start.ground["role"].to_numpy()),
            tie_points=seen.tie_points,
            marks=seen.marks,
            gnss=gnss,
            extra=result.start.extra,
        )

    def restate_positions(self, factor: np.ndarray, result: Adjustment) -> None:
        """Give antenna positions of each flight so many times (flights, 3) their standard
        deviations; result: the adjustment that the flights are those of."""
        block, names = self.block.copy(), list(result.problem.images.flight_names)
        flight = np.array([names.index(name) for name in block.flight_names])
        row = flight[block.image_flight[block.image_rows("gnss")]]
        before = block.gnss_sigma()
        after = before * factor[row]
        block.put("gnss", ("sx", "sy", "sz"), after)
        self.block = block
        for number in np.flatnonzero((factor > 1.0).any(axis=1)):
            said, told = (1000.0 * np.median(one[row == number], axis=0) for one in (before, after))
            self.left_out.append(
                f"GNSS positions of flight {names[number]} count with ({told[0]:.3g}, "
                f"{told[1]:.3g}, {told[2]:.3g}) mm in x, y, z, where ({said[0]:.3g}, {said[1]:.3g},"
                f" {said[2]:.3g}) mm are stated: with so little the cameras follow them, and the "
                "images contradict it."
            )


def _from(block: Block, at: Block) -> Block:
    """The block with poses, points and cameras of another of the same as start."""
    cameras = {
        name: one.with_interior(at.cameras[name].interior) for name, one in block.cameras.items()
    }
    return replace(block, images=at.images, points=at.points, cameras=cameras)


def _refuse_astray(result: Adjustment) -> None:
    """Raises AdjustmentFailed where the iterations are nowhere near their end.

    The weights of a robust loss may creep for long, in small steps that need hardly any damping.
    """
    last = result.history[-1]
    if result.converged or (last["damping"] <= HARDLY_DAMPED and last["step"] < CREEPING):
        return
    raise AdjustmentFailed(
        f"the adjustment of {result.start.name} did not converge in {result.iterations} "
        "iterations, and what is missing cannot be told from it: `corridor adjust` prints what "
        "lies far from the start values; --iterations allows more"
    )


def _scale(adjustment: Adjustment) -> float:
    """Scale of Student's t of the tie points in stated standard deviations; 1 without any."""
    system = adjustment.system
    square = (system.residuals().pixels ** 2).sum(axis=1) / system.image_rows.sigma**2
    square = square[system.image_rows.tie & np.isfinite(square)]
    return float(np.clip(scale_of(square), *SETTINGS.noise_factor_range)) if len(square) else 1.0
