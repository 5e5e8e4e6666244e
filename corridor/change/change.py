"""From two blocks to what changed between them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from corridor import adjustment
from corridor.adjustment import Adjustment, Model
from corridor.block import Block, read
from corridor.change.clouds import Cloud
from corridor.change.comparison import Comparison
from corridor.change.cores import Cores, make_cores
from corridor.change.epochs import (
    check_blocks,
    check_datum,
    check_meeting,
    check_names,
    check_overlap,
    clouds,
    usual_datum,
)
from corridor.change.evidence import gathered
from corridor.change.explanation import Explanation, explain
from corridor.change.joint import Joint
from corridor.change.nearing import brought
from corridor.change.points import point_changes
from corridor.change.result import Change, Compared
from corridor.change.signature import Signatures
from corridor.change.surface import surface_change
from corridor.change.together import joined, together_clouds
from corridor.change.volume import volume
from corridor.effects import find
from corridor.errors import InputError

Dated = Block | Adjustment | str | os.PathLike
_DATES = ("the first date", "the second date")


def change(
    before: Dated,
    after: Dated,
    model: Model | None = None,
    *,
    threads: int = 1,
    progress: Callable[[str], None] | None = None,
    **options,
) -> Change:
    """What moved between two dates, what the camera explains of it, and how sure that is.

    before, after: blocks, their folders, or adjustments of them.
    model: of both adjustments (default: that of `corridor.adjust`).
    options: of `Comparison`: `datum="stable"`, `polygons={"toe": corners}`, `same_ties=True`.

    Raises InputError, one sentence, where the two cannot be compared, AdjustmentFailed where one of
    them does not converge.
    """
    asked = Comparison(**options)
    given = (before, after)
    blocks = tuple(one.start if isinstance(one, Adjustment) else read(one) for one in given)
    check_blocks(*blocks)
    run = _Run(model, asked, threads, progress or (lambda text: None))
    adjusted = tuple(
        one if isinstance(one, Adjustment) else run.adjusted(block, name)
        for one, block, name in zip(given, blocks, _DATES, strict=True)
    )
    for one in adjusted:
        if not one.converged:
            raise adjustment.not_converged(one)
    if asked.datum is None:
        run.asked = asked = replace(asked, datum=usual_datum(adjusted))
    check_datum(*adjusted, asked.datum)
    compared = run.compared(adjusted)
    gained, notes = None, []
    anew = partial(run.compared_with, adjusted, blocks)
    if asked.together:
        chosen = _stable_names(compared, asked.stable)
        notes.append(_told(chosen, asked.same_camera))
        apart = compared
        anew = partial(run.compared_together, blocks, chosen)
        compared = anew(())
        if apart.surface is not None and len(apart.surface):
            gained = float(np.median(apart.surface.sigma)), float(np.median(compared.surface.sigma))
    remaining, explanation = None, None
    if asked.camera and (compared.points is not None or compared.surface is not None):
        compared, remaining, explanation = run.explained(compared, anew)
    names = tuple(block.name for block in blocks)
    return Change(names, asked, compared, remaining, explanation, gained, tuple(notes))


@dataclass
class _Run:
    """One comparison and how it is made. cores: those of the first surface."""

    model: Model | None
    asked: Comparison
    threads: int
    say: Callable[[str], None]
    cores: Cores | None = None

    def adjusted(self, block: Block, name: str, effects: Iterable[str] = ()) -> Adjustment:
        """The block adjusted, with some effects more and what one expects of them beforehand."""
        self.say(f"adjusting {name}")
        model = self.model or Model()
        if effects:
            every = [find(slug) for slug in sorted(effects)]
            # Some can do what a free camera does: their prior keeps both in bounds.
            known = {
                f"{effect.slug}.{parameter.name}": (0.0, parameter.scale)
                for effect in every
                for parameter in effect.form(block).parameters(block)
            }
            slugs = [effect.slug for effect in every]
            model = replace(
                model, effects=(*model.effects, *slugs), priors={**known, **model.priors}
            )
        return adjustment.adjust(block, model=model, threads=self.threads)

    def _cores_of(self, first: Cloud, second: Cloud) -> Cores:
        """Core points of both clouds, the same ones in plan each time, on the ground as it is.

        Modelled otherwise, the ground of a weak datum lies metres higher or lower.
        """
        asked = self.asked
        if self.cores is None:
            self.cores = make_cores(
                first.xyz, second.xyz, asked.spacing, asked.radius, asked.normal, asked.profile
            )
            return self.cores
        known = self.cores
        return make_cores(
            first.xyz, second.xyz, known.spacing, known.radius, asked.normal, at=known.xyz
        )

    def compared(self, adjusted: tuple[Adjustment, Adjustment]) -> Compared:
        pair = clouds(*adjusted, self.asked.same_ties, self.asked.rays)
        return self._compared(adjusted, pair)

    def compared_with(self, adjusted, blocks, shown: tuple[set[str], ...]) -> Compared:
        """The comparison with effects (of each date) modelled that the measurements show."""
        again = tuple(
            self.adjusted(block, f"{name} with {', '.join(sorted(slugs))}", slugs) if slugs else one
            for block, name, slugs, one in zip(blocks, _DATES, shown, adjusted, strict=True)
        )
        return self.compared(again)

    def compared_together(self, blocks, stable, shown: tuple[set[str], ...]) -> Compared:
        """The same in one adjustment of both dates; effects are of both."""
        asked = self.asked
        block = joined(*blocks, stable, asked.same_camera, asked.same_ties)
        one = self.adjusted(block, "both dates together", set().union(*shown))
        return self._compared((one, one), together_clouds(one, asked.same_ties, asked.rays))

    def _compared(self, adjusted, pair: tuple[Cloud, Cloud]) -> Compared:
        asked = self.asked
        check_overlap(pair[0].epoch.xyz, pair[1].epoch.xyz)
        if asked.datum == "stable" and pair[0].epoch is not pair[1].epoch:
            pair = pair[0], brought(*pair, asked.motion, asked.same_ties)
        joint = Joint(*pair, asked.common, asked.bias)
        self.say("covariances of the points")
        points = point_changes(joint, asked.level, asked.datum, asked.motion)
        if points is not None:
            check_names(points.names, points.shift, points.sigma, asked.largest)
        surface, volumes = None, {}
        if asked.surface:
            cores = self._cores_of(*pair)
            check_meeting(pair[0].xyz, pair[1].xyz, cores)
            self.say(f"covariances of {len(cores)} core points")
            options = {"degree": asked.degree, "sampled": not asked.same_ties}
            surface = surface_change(
                joint, cores, asked.level, datum=asked.datum, kind=asked.motion, **options
            )
            for name, polygon in (asked.polygons or {}).items():
                volumes[name] = volume(joint, polygon, cores, laying=surface.laying, **options)
        return Compared(adjusted, joint, points, surface, volumes)

    def explained(
        self, compared: Compared, anew: Callable[[tuple[set[str], ...]], Compared]
    ) -> tuple[Compared, Compared | None, Explanation | None]:
        """The change, the one with what the measurements show modelled, and what effects say."""
        self.say("what the camera could do to the ground")
        evidence, level = self._evidence(compared), self.asked.level
        if evidence is None:
            return compared, None, None
        compared = replace(compared, points=evidence.judged(compared.points, level))
        first = explain(evidence, level)
        if not any(first.shown):
            return compared, None, first
        remaining = anew(first.shown)
        again = self._evidence(remaining)
        remaining = replace(remaining, points=again.judged(remaining.points, level))
        plain = again.test(level)
        visible = _visible(evidence, again, level)
        last = explain(again, level, first.shown)
        return (
            compared,
            remaining,
            replace(
                last,
                as_adjusted=first.as_adjusted,
                shown_modelled=plain,
                visible=visible,
                table=first.table,
                explained=first.explained,
            ),
        )

    def _evidence(self, compared: Compared):
        epochs = [compared.joint.before.epoch]
        if not compared.joint.together:
            epochs.append(compared.joint.after.epoch)
        held = compared.points is None or compared.points.held.all()
        if held and (compared.surface is None or not len(compared.surface)):
            return None
        signatures = tuple(Signatures(epoch) for epoch in epochs)
        return gathered(compared.joint, compared.points, compared.surface, signatures)


def _visible(before, after, level: float) -> bool:
    """Whether the change as it was would be significant with the errors as they are now."""
    if len(before) != len(after):
        return True
    return after.tested(before.value, after.covariance, level).significant


def _stable_names(compared: Compared, stable: Iterable[str] | None) -> list[str]:
    """Points that are to be one point in both dates. Raises InputError for a name nobody knows."""
    points = compared.points
    known = [] if points is None else list(points.names)
    if stable is None:
        return [] if points is None else list(points.names[points.stable | points.held])
    unknown = [name for name in stable if name not in known]
    if unknown:
        raise InputError(
            f"point {unknown[0]} is to stand still, but both epochs do not show it: they share "
            f"{', '.join(known[:20]) or 'no point'}"
        )
    return list(stable)


def _told(stable: list[str], same_camera: bool) -> str:
    camera = "one camera calibration for both" if same_camera else "a calibration for each date"
    if not stable:
        return f"Both dates in one adjustment, {camera}; no point is common to both."
    shown = ", ".join(stable[:8]) + (", ..." if len(stable) > 8 else "")
    return f"Both dates in one adjustment, {camera}; common as standing still: {shown}."
