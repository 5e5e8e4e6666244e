"""From two blocks to what changed between them, or from one to what could be seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from corridor.core import adjustment, simulation
from corridor.core.adjustment import Adjustment, Model
from corridor.core.block import Block, read
from corridor.core.effects import find
from corridor.core.errors import InputError
from corridor.core.simulation import Plan, read_plan, ready_made
from corridor.tools.change.comparison import (
    Comparison,
    check_blocks,
    check_datum,
    check_meeting,
    check_names,
    check_overlap,
    usual_datum,
)
from corridor.tools.change.cores import Cores, make_cores
from corridor.tools.change.epoch import Cloud, clouds, together_clouds
from corridor.tools.change.explanation import (
    Evidence,
    Explanation,
    explain,
    explained_again,
    gathered,
)
from corridor.tools.change.joint import Joint
from corridor.tools.change.points import point_changes
from corridor.tools.change.registration import brought
from corridor.tools.change.result import Change, Compared
from corridor.tools.change.signature import Signatures
from corridor.tools.change.surface import SurfaceChange, surface_change, volume
from corridor.tools.change.together import joined

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
    run = _Run(model or Model(), asked, threads, progress or (lambda text: None), blocks)
    adjusted = tuple(
        one if isinstance(one, Adjustment) else run.adjust(block, name)
        for one, block, name in zip(given, blocks, _DATES, strict=True)
    )
    for one in adjusted:
        if not one.converged:
            raise adjustment.not_converged(one)
    if asked.datum is None:
        run.asked = asked = replace(asked, datum=usual_datum(adjusted))
    check_datum(*adjusted, asked.datum)
    compared = run.apart(adjusted)
    gained, notes = None, []
    if asked.together:
        run.stable = _stable_names(compared, asked.stable)
        notes.append(_told(run.stable, asked.same_camera))
        apart, compared = compared, run.together()
        if apart.surface is not None:
            gained = float(np.median(apart.surface.sigma)), float(np.median(compared.surface.sigma))
    remaining, explanation = None, None
    if asked.camera and (compared.points is not None or compared.surface is not None):
        compared, remaining, explanation = run.explained(compared)
    names = tuple(block.name for block in blocks)
    return Change(names, asked, compared, remaining, explanation, gained, tuple(notes))


def detection(
    what: Block | Adjustment | Plan | str | os.PathLike,
    model: Model | None = None,
    *,
    seed: int = 0,
    **options,
) -> SurfaceChange:
    """Levels of detection of two flights like this one; every distance is zero.

    what: a block, its adjustment, or a plan that nobody has flown yet (a `Plan`, a `.toml` file, or
        names of ready-made plans joined by +), which is then simulated from the seed.
    options: of `Comparison`. Raises InputError for what is none of these.
    """
    asked = Comparison(**options)
    one = what
    if not isinstance(what, Adjustment):
        one = adjustment.adjust(_flown(what, seed), model=model)
    joint = Joint(*clouds(one, one, asked.same_ties, asked.rays), asked.common, asked.bias)
    return surface_change(joint, _cores(joint, asked), **asked.surfaces)


def _flown(what: Block | Plan | str | os.PathLike, seed: int) -> Block:
    if isinstance(what, Block):
        return what
    if not isinstance(what, Plan):
        text = os.fspath(what)
        if not (text.endswith(".toml") or set(text.split("+")) <= set(ready_made())):
            return read(text)
        what = read_plan(text)
    return simulation.simulate(what, seed=seed)


def _cores(joint: Joint, asked: Comparison, known: Cores | None = None) -> Cores:
    """Core points of both clouds; known: at these places in plan, on the ground as it is now.

    Modelled otherwise, the ground of a weak datum lies metres higher or lower.
    """
    pair = joint.before.xyz, joint.after.xyz
    if known is None:
        return make_cores(*pair, asked.spacing, asked.radius, asked.normal, asked.profile)
    return make_cores(*pair, known.spacing, known.radius, asked.normal, at=known.xyz)


@dataclass
class _Run:
    """One comparison and how it is made. cores: those of the first surface. stable: ground points
    common to both dates, where these are adjusted together."""

    model: Model
    asked: Comparison
    threads: int
    say: Callable[[str], None]
    blocks: tuple[Block, Block]
    cores: Cores | None = None
    stable: list[str] | None = None

    def adjust(self, block: Block, name: str, slugs: Iterable[str] = ()) -> Adjustment:
        """The block adjusted, with some effects more and what one expects of them beforehand."""
        slugs = sorted(slugs)
        self.say(f"adjusting {name}" + (f" with {', '.join(slugs)}" if slugs else ""))
        # Some can do what a free camera does: their prior keeps both in bounds.
        known = {
            f"{slug}.{parameter.name}": (0.0, parameter.scale)
            for slug in slugs
            for parameter in find(slug).form(block).parameters(block)
        }
        model = replace(
            self.model,
            effects=(*self.model.effects, *slugs),
            priors={**known, **self.model.priors},
        )
        return adjustment.adjust(block, model=model, threads=self.threads)

    def apart(
        self, adjusted: tuple[Adjustment, ...], shown: tuple[set[str], ...] = (set(), set())
    ) -> Compared:
        """The comparison with effects (of each date) modelled that the measurements show."""
        again = tuple(
            self.adjust(block, name, slugs) if slugs else one
            for block, name, slugs, one in zip(self.blocks, _DATES, shown, adjusted, strict=True)
        )
        return self._compared(again, clouds(*again, self.asked.same_ties, self.asked.rays))

    def together(self, shown: tuple[set[str], ...] = ()) -> Compared:
        """The same in one adjustment of both dates; effects are of both."""
        block = joined(*self.blocks, self.stable, self.asked.same_camera)
        one = self.adjust(block, "both dates together", set().union(*shown))
        pair = together_clouds(one, self.asked.same_ties, self.asked.rays)
        return self._compared((one, one), pair)

    def _compared(self, adjusted: tuple[Adjustment, ...], pair: tuple[Cloud, Cloud]) -> Compared:
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
            cores = _cores(joint, asked, self.cores)
            self.cores = self.cores or cores
            check_meeting(pair[0].xyz, pair[1].xyz, cores)
            self.say(f"covariances of {len(cores)} core points")
            surface = surface_change(
                joint, cores, asked.level, datum=asked.datum, kind=asked.motion, **asked.surfaces
            )
            volumes = {
                name: volume(joint, polygon, cores, laying=surface.laying, **asked.surfaces)
                for name, polygon in (asked.polygons or {}).items()
            }
        return Compared(adjusted, joint, points, surface, volumes)

    def explained(self, compared: Compared) -> tuple[Compared, Compared | None, Explanation | None]:
        """The change, the one with what the measurements show modelled, and what effects say."""
        self.say("what the camera could do to the ground")
        evidence, level = _evidence(compared), self.asked.level
        if evidence is None:
            return compared, None, None
        compared = replace(compared, points=evidence.judged(compared.points, level))
        first = explain(evidence, level)
        if not any(first.shown):
            return compared, None, first
        if self.stable is None:
            remaining = self.apart(compared.adjustments, first.shown)
        else:
            remaining = self.together(first.shown)
        again = _evidence(remaining)
        remaining = replace(remaining, points=again.judged(remaining.points, level))
        return compared, remaining, explained_again(first, evidence, again, level)


def _evidence(compared: Compared) -> Evidence | None:
    """What is tested of a comparison; None where that is nothing."""
    held = compared.points is None or compared.points.held.all()
    if held and compared.surface is None:
        return None
    signatures = tuple(Signatures(epoch) for epoch in compared.joint.epochs)
    return gathered(compared.joint, compared.points, compared.surface, signatures)


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
