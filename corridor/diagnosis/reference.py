"""The believed model: what `corridor adjust` would be given, adjusted robustly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from corridor import adjustment
from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.diagnosis.robust import scale_of
from corridor.effects import Effect, find

# Stated standard deviations are wrong by this much at most, or the loss would see nothing else.
TRUSTED = 0.02, 20.0
# Cauchy's weights of this width are Student's t with four degrees of freedom and scale one.
WIDTH = 2.0


@dataclass
class ReferenceModel:
    """A block and the options of its adjustment.

    camera, control, check, lever_arm: as of `corridor.adjust`. effects: those the user believes
    in. priors: of the believed model, and of candidates. begun: where poses, points and cameras
    were left by an adjustment: the next one starts from there, its robust loss anew. scale: of
    Student's t in stated standard deviations, as that adjustment's tie points have it.
    """

    block: Block
    camera: str | Mapping[str, str] | None
    effects: list[Effect]
    control: list[str] | None
    check: list[str] | None
    priors: dict = field(default_factory=dict)
    lever_arm: str | None = None
    threads: int = 1
    begun: Block | None = None
    scale: float = 1.0

    @classmethod
    def of(
        cls, block, camera, effects: Iterable, control, check, priors, threads
    ) -> ReferenceModel:
        """The believed model with its defaults.

        Default of the camera: Fraser's ten parameters, or none where the camera is calibrated.
        """
        if camera is None:
            camera = {
                name: "fixed" if c.calibrated else "fraser10" for name, c in block.cameras.items()
            }
        effects = [effect if isinstance(effect, Effect) else find(effect) for effect in effects]
        control, check = (None if v is None else list(v) for v in (control, check))
        return cls(
            block, camera, effects, control, check, dict(priors or {}), None, max(threads, 1)
        )

    @property
    def options(self) -> dict:
        """camera, control, check, lever_arm."""
        return {
            "camera": self.camera, "control": self.control, "check": self.check,
            "lever_arm": self.lever_arm,
        }  # fmt: skip

    def priors_of(self, effects: Iterable[Effect]) -> dict:
        """Priors that name cameras, lever arms, believed effects or one of `effects`."""
        known = {effect.slug for effect in (*self.effects, *effects)} | {"camera", "lever_arm"}
        out = {}
        for name, prior in self.priors.items():
            owner, _, rest = name.partition(".")
            if owner not in known:
                continue
            if not rest:
                effect = next(e for e in (*self.effects, *effects) if e.slug == owner)
                name = f"{owner}.{effect.parameters(self.block)[0].name}"
            out[name] = prior
        return out

    def adjust(self, more: Iterable[Effect] = (), block: Block | None = None) -> Adjustment:
        """The robust adjustment with more effects.

        Effects that can do what a free camera can are held by a wide prior, and those of single
        images by the spread one would expect of them.
        """
        more = list(more)
        priors = self.priors_of(more)
        for effect in more:
            if not (effect.stands_in_for or effect.generic or effect.group in ("image", "point")):
                continue
            for parameter in effect.parameters(self.block):
                wide = 1.0 if effect.group == "image" else 10.0
                name = f"{effect.slug}.{parameter.name}"
                priors.setdefault(name, (0.0, wide * parameter.scale))
        block = self.block if block is None else block
        if self.begun is not None:
            near = self.begun
            block = replace(block, images=near.images, points=near.points, cameras=near.cameras)
        result = adjustment.adjust(
            block, self.camera, [*self.effects, *more],
            self.control, self.check, f"cauchy:{WIDTH * self.scale!r}", priors, self.lever_arm,
            self.threads, max_iterations=_enough(more),
        )  # fmt: skip
        if self.begun is not None:
            return result
        self.begun, self.scale = result.block, _scale(result)
        return self.adjust(more)


def _scale(adjustment: Adjustment) -> float:
    """Scale of Student's t of the tie points in stated standard deviations; 1 without any."""
    p = adjustment.problem
    residual, _ = adjustment.normal.look(adjustment.state, passes=5)
    square = (residual**2).sum(axis=1) * p.weight**2
    square = square[(p.row < p.tie_count) & np.isfinite(square)]
    return float(np.clip(scale_of(square), *TRUSTED)) if len(square) else 1.0


def _enough(effects: list[Effect]) -> int:
    """Iterations: shapes with a hundred parameters creep to their end, and need not reach it."""
    return 6 if any(effect.generic for effect in effects) else 50
