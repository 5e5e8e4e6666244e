"""The believed model: what `corridor adjust` would be given, adjusted robustly."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from corridor.core import adjustment
from corridor.core.adjustment import (
    REFERENCE_CAMERA,
    SEES_ARM_M,
    Adjustment,
    Model,
    Run,
    arms_unseen,
    camera_of,
)
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import Effect, believed_of
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import robust_scale
from corridor.diagnosis.noise.image import scale_of
from corridor.diagnosis.settings import SETTINGS

# Step, in standard deviations, below which only weights are still on their way.
CREEPING = 0.1


@brief
@dataclass
class ReferenceModel:
    """A block and the options of its adjustment.

    model: what the user believes in; its priors are also of candidates. begun: where poses, points
    and cameras were left by an adjustment: the next one starts from there, its robust loss anew.
    astray: that one went far: what is added begins where the block states, not in its wrong valley.
    scale: of Student's t in stated standard deviations, as that adjustment's tie points have it.
    run: how it is adjusted, in silence; max_iterations None: as the settings say.
    """

    block: Block
    model: Model
    run: Run = Run()
    begun: Block | None = None
    scale: float = 1.0
    astray: bool = False

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

    def _run(self, block: Block, model: Model, brief: bool) -> Adjustment:
        """brief: shapes with a hundred parameters creep to an end that they need not reach.

        They are given time where the cost still falls: what they start from is nowhere near.
        """
        most = self.run.max_iterations or SETTINGS.iterations
        few = min(SETTINGS.iterations_of_shapes, most)
        for iterations in (few, most) if brief else (most,):
            # What is held out must not take images with it: after the first the block is sound, or
            # refused, and all adjustments are of the same observations.
            strict = self.run.strict or self.begun is not None
            run = Run(self.run.threads, max_iterations=iterations, strict=strict)
            result = adjustment.adjust(block, model=model, run=run, weights="stated")
            *_, before, last = (0.0, 0.0, *(step["cost"] for step in result.history))
            if result.converged or abs(before - last) < SETTINGS.creeping * last:
                break
        return result

    def adjust(self, more: Iterable[Effect] = (), block: Block | None = None) -> Adjustment:
        """The robust adjustment with more effects.

        Effects that can do what a free camera can are held by a wide prior, those of single images
        by the spread one would expect of them, and what can only be so large by that.
        """
        more = list(more)
        if self.begun is None:
            self._free_arm_that_is_seen()
        priors = self.priors_of(more)
        for effect in more:
            held = effect.stands_in_for or effect.generic or effect.group in ("image", "point")
            for parameter in effect.parameters(self.block):
                wide = (
                    SETTINGS.prior_of_adjusted_per_image
                    if effect.group == "image"
                    else SETTINGS.prior_of_adjusted
                ) * parameter.scale
                sigma = min(wide if held else np.inf, parameter.most / SETTINGS.implausible_sigma)
                if np.isfinite(sigma):
                    priors.setdefault(f"{effect.slug}.{parameter.name}", (0.0, sigma))
        block = self.block if block is None else block
        if self.begun is not None and not (more and self.astray):
            near = self.begun
            block = replace(block, images=near.images, points=near.points, cameras=near.cameras)
        model = replace(
            self.model.with_priors(priors),
            effects=[*self.effects, *more],
            loss=f"cauchy:{SETTINGS.cauchy_width * self.scale!r}",
        )
        result = self._run(block, model, any(effect.generic for effect in more))
        # Warnings compare what comes out with what the block states, not with where it began.
        result.start = replace(result.start, cameras=self.block.cameras)
        if self.begun is not None:
            return result
        _refuse_astray(result)
        self.astray = result.iterations > SETTINGS.usual_iterations
        self.begun, self.scale = result.start_again, _scale(result)
        # What the first one decided holds for all that are compared with it.
        arm = "free" if result.problem.arms_free else "fixed"
        self.model = replace(self.model, lever_arm=arm)
        self.block = replace(
            self.block,
            tie_points=result.block.tie_points,
            gnss=result.start.gnss,
            extra=result.start.extra,
        )
        result = self.adjust(more)
        _refuse_astray(result)
        return result

    def _free_arm_that_is_seen(self) -> None:
        """Free lever arms that nobody stated where the positions tell them.

        An adjustment holds them where the stated standard deviations are too coarse to see them;
        positions are often better than what an importer states. A candidate that is held by default
        would be tested against a noise that its being held has made.
        """
        block = self.block
        stated = block.lever_arm_fixed or block.lever_arm or self.model.lever_arm is not None
        if stated or not len(block.gnss) or not arms_unseen(block):
            return
        model = replace(
            self.model, lever_arm="free", loss=f"cauchy:{SETTINGS.cauchy_width * self.scale!r}"
        )
        try:
            found = self._run(block, model, False)
        except (InputError, AdjustmentFailed):
            return
        left = found.residuals["gnss"][["vx", "vy"]].to_numpy()
        if found.converged and robust_scale(left, axis=0).max() <= SEES_ARM_M:
            self.model = replace(self.model, lever_arm="free")


def _refuse_astray(result: Adjustment) -> None:
    """Raises AdjustmentFailed where the iterations are nowhere near their end.

    The weights of a robust loss may creep for long, in small steps that need no damping.
    """
    last = result.history[-1]
    if result.converged or (last["damping"] == 0.0 and last["step"] < CREEPING):
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
    return float(np.clip(scale_of(square), *SETTINGS.stated_sigma_range)) if len(square) else 1.0
