"""From two blocks to what changed between them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from corridor import adjustment
from corridor.adjustment import Adjustment, Model
from corridor.block import Block, read
from corridor.change.clouds import Cloud
from corridor.change.cores import Cores, make_cores
from corridor.change.epochs import (
    Chosen,
    check_blocks,
    check_datum,
    check_names,
    check_overlap,
    clouds,
)
from corridor.change.evidence import gathered, tested
from corridor.change.explanation import Explanation, explain
from corridor.change.joint import Joint
from corridor.change.points import point_changes
from corridor.change.result import Asked, Change, Compared
from corridor.change.signature import Signatures
from corridor.change.stable import MOTIONS
from corridor.change.surface import surface_change
from corridor.change.together import joined, together_clouds
from corridor.change.volume import volume
from corridor.effects import find
from corridor.errors import InputError

Dated = Block | Adjustment | str | os.PathLike
DATUMS = ("stated", "stable")
_DATES = ("the first date", "the second date")


@dataclass(frozen=True)
class Surface:
    """How the surface is compared.

    spacing: of the core points, m (default: half the radius). radius: of the cylinder in which
    points count, m (default: so that it holds some 15). normal: `local` or `vertical`. degree: 0
    the mean of the points (M3C2), 1 a plane, 2 with curvature. profile (n, 2): core points along
    this line instead of a grid. polygons: name -> (n, 2), m, for volumes. rays: images that must
    show a tie point. same_ties: a tie point of one name is one point of the ground. largest: m,
    displacement of a named point beyond which the name means something else.
    """

    spacing: float | None = None
    radius: float | None = None
    normal: str = "local"
    degree: int = 0
    profile: np.ndarray | None = None
    polygons: Mapping[str, np.ndarray] | None = None
    rays: int = 3
    same_ties: bool = False
    largest: float = 5.0


def change(
    before: Dated,
    after: Dated,
    *,
    model: Model | None = None,
    common: Iterable[str] = ("control", "priors"),
    gnss_bias: float | Iterable[float] | None = None,
    datum: str = "stated",
    motion: str = "rigid",
    level: float = 0.01,
    surface: bool = True,
    camera: bool = True,
    together: bool = False,
    stable: Iterable[str] | None = None,
    same_camera: bool = False,
    threads: int = 1,
    progress: Callable[[str], None] | None = None,
    **options,
) -> Change:
    """What moved between two dates, what the camera explains of it, and how sure that is.

    before, after: blocks, their folders, or adjustments of them.
    model: of both adjustments (default: that of `corridor.adjust`).
    common: errors that both epochs share, of `control` (the same coordinates of a control point in
        both), `priors` (the same value known beforehand), `gnss` (the base station's).
    gnss_bias: standard deviation, m (one number or three), of a constant error of the GNSS.
    datum: `stated`: as each epoch's control and GNSS say; `stable`: laid together on what stands
        still by a motion: `translation`, `rigid`, `similarity`.
    level: false discovery rate of single tests, level of the global ones.
    surface: whether surfaces are compared. camera: whether effects of the camera are asked for.
    together: both dates in one adjustment. stable: ground points that stand still, one point
        there (default: those that do as far as can be seen). same_camera: one calibration.
    options: of `Surface`.

    Raises InputError, one sentence, where the two cannot be compared.
    """
    say = progress or (lambda text: None)
    asked = _asked(level, common, datum, motion, together)
    how = Surface(**options)
    given = (before, after)
    blocks = tuple(one.start if isinstance(one, Adjustment) else read(one) for one in given)
    check_blocks(*blocks)
    bias = None if gnss_bias is None else np.broadcast_to(np.asarray(gnss_bias, float), 3)
    run = _Run(model, asked, how, bias, surface, threads, say)
    adjusted = tuple(
        one if isinstance(one, Adjustment) else run.adjusted(block, name)
        for one, block, name in zip(given, blocks, _DATES, strict=True)
    )
    check_datum(*adjusted, datum)
    compared = run.compared(adjusted)
    gained, notes = None, []
    anew = partial(run.compared_with, adjusted, blocks)
    if together:
        chosen = _stable_names(compared, stable)
        notes.append(_told(chosen, same_camera))
        apart = compared
        anew = partial(run.compared_together, blocks, chosen, same_camera)
        compared = anew(())
        if apart.surface is not None and len(apart.surface):
            gained = float(np.median(apart.surface.sigma)), float(np.median(compared.surface.sigma))
    remaining, explanation = None, None
    if camera and (compared.points is not None or compared.surface is not None):
        compared, remaining, explanation = run.explained(compared, anew)
    names = tuple(block.name for block in blocks)
    return Change(names, asked, compared, remaining, explanation, gained, tuple(notes))


def _asked(level, common, datum, motion, together) -> Asked:
    if datum not in DATUMS:
        raise InputError(f"datum {datum!r} is unknown: use {' or '.join(DATUMS)}")
    if motion not in MOTIONS:
        raise InputError(f"motion {motion!r} is unknown: use one of {', '.join(MOTIONS)}")
    if not 0 < level < 1:
        raise InputError(f"level {level} is no probability between 0 and 1")
    return Asked(level, tuple(common), datum, motion, together)


@dataclass
class _Run:
    """One comparison and how it is made. cores: those of the first surface."""

    model: Model | None
    asked: Asked
    how: Surface
    bias: np.ndarray | None
    with_surface: bool
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
        how = self.how
        if self.cores is None:
            self.cores = make_cores(
                first.xyz, second.xyz, how.spacing, how.radius, how.normal, how.profile
            )
            return self.cores
        known = self.cores
        return make_cores(
            first.xyz, second.xyz, known.spacing, known.radius, how.normal, at=known.xyz
        )

    def _clouds(self, adjusted) -> tuple[Cloud, Cloud]:
        return clouds(*adjusted, Chosen(self.how.rays), self.how.same_ties)

    def compared(self, adjusted: tuple[Adjustment, Adjustment]) -> Compared:
        return self._compared(adjusted, self._clouds(adjusted))

    def compared_with(self, adjusted, blocks, shown: tuple[set[str], ...]) -> Compared:
        """The comparison with effects (of each date) modelled that the measurements show."""
        again = tuple(
            self.adjusted(block, f"{name} with {', '.join(sorted(slugs))}", slugs) if slugs else one
            for block, name, slugs, one in zip(blocks, _DATES, shown, adjusted, strict=True)
        )
        return self.compared(again)

    def compared_together(
        self, blocks, stable, same_camera, shown: tuple[set[str], ...]
    ) -> Compared:
        """The same in one adjustment of both dates; effects are of both."""
        block = joined(*blocks, stable, same_camera, self.how.same_ties)
        one = self.adjusted(block, "both dates together", set().union(*shown))
        pair = together_clouds(one, Chosen(self.how.rays), self.how.same_ties)
        return self._compared((one, one), pair)

    def _compared(self, adjusted, pair: tuple[Cloud, Cloud]) -> Compared:
        asked, how = self.asked, self.how
        check_overlap(pair[0].epoch.xyz, pair[1].epoch.xyz)
        joint = Joint(*pair, asked.common, self.bias)
        self.say("covariances of the points")
        points = point_changes(joint, asked.level, asked.datum, asked.motion)
        if points is not None:
            check_names(points.names, points.shift, points.sigma, how.largest)
        surface, volumes = None, {}
        if self.with_surface:
            cores = self._cores_of(*pair)
            self.say(f"covariances of {len(cores)} core points")
            options = {"degree": how.degree, "sampled": not how.same_ties}
            options |= {"datum": asked.datum, "kind": asked.motion}
            surface = surface_change(joint, cores, asked.level, **options)
            for name, polygon in (how.polygons or {}).items():
                volumes[name] = volume(
                    joint, polygon, cores, how.degree, not how.same_ties, surface.laying
                )
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
    return tested(before.value, after.covariance, level, after.freedom).significant


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
