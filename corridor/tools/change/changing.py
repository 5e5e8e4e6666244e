"""From two blocks to what changed between them, or from one to what could be seen."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from corridor.core import adjustment, simulation
from corridor.core.adjustment import Adjustment, Model
from corridor.core.block import Block, read
from corridor.core.effects import find
from corridor.core.errors import InputError
from corridor.core.options import options
from corridor.core.output import Progress, telling
from corridor.core.simulation import Plan, read_plan, ready_made
from corridor.tools.change.admission import (
    BOTH_FLIGHTS,
    FLIGHTS,
    SLACK,
    Coordinates,
    Objection,
    held_apart,
    misfits,
    slips,
    strange_effects,
)
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
from corridor.tools.change.joint import Joint, control_of_both
from corridor.tools.change.layers import APART, layers, level, scatter_added, smoothest, typical
from corridor.tools.change.matching import without_gross_ties
from corridor.tools.change.points import point_changes
from corridor.tools.change.registration import registered
from corridor.tools.change.result import Change, Compared
from corridor.tools.change.sentence import (
    mark_apart,
    patch_apart,
    patch_layers,
    patch_level,
    patch_some,
    strips_apart,
)
from corridor.tools.change.signature import Signatures
from corridor.tools.change.significance import two_sided
from corridor.tools.change.surface import PatchChange, SurfaceChange, surface_change, volume
from corridor.tools.change.together import joined
from corridor.tools.change.witness import contradictions

Dated = Block | Adjustment | str | os.PathLike
_DATES, _BOTH = ("the first date", "the second date"), ("both dates",)
_NO_COMMON_CONTROL = (
    "No control point is common to both dates: a constant error of the GNSS of either date moves "
    "everything and is in no standard deviation. State how large it may be (--gnss-bias 0.02), or "
    "measure control that stands still at both dates."
)
_ANEW = (
    "Control points have other coordinates at the second date ({}), so they count as surveyed anew "
    "and the errors of both surveys are in the standard deviations: if it was one survey, give "
    "both dates the same coordinates."
)


@options(asked=Comparison)
def change(
    before: Dated,
    after: Dated,
    model: Model | None = None,
    *,
    asked: Comparison,
    threads: int = 1,
    progress: Callable[[Progress], None] | None = None,
) -> Change:
    """What moved between two dates, what the camera explains of it, and how sure that is.

    before, after: blocks, their folders, or adjustments of them, which are made again by the model
        where gross errors of tie points decide them, or an effect is to be modelled.
    model: of both adjustments (default: that of `corridor.adjust`).
    common to same_ties: of `Comparison`: `datum="stable"`, `polygons={"toe": corners}`; asked:
        these as a whole.

    Raises InputError, one sentence, where the two cannot be compared, AdjustmentFailed where one of
    them does not converge.
    """
    given = (before, after)
    blocks = tuple(one.start if isinstance(one, Adjustment) else read(one) for one in given)
    check_blocks(*blocks)
    # Laid together on what stands still, dates may have other coordinates.
    surveys = None if asked.datum == "stable" else Coordinates.of(*blocks)
    if surveys is not None:
        first, second = (np.median(block.poses[:, :3], axis=0) for block in blocks)
        surveys.check(asked.largest, second - first)
    mistaken = [] if surveys is None else surveys.mistaken
    surveyed = {} if surveys is None else surveys.displacements
    run = _Run(model or Model(), asked, threads, telling(progress), blocks, surveyed)
    run.without_control(mistaken)
    adjusted = tuple(
        run.without_gross_ties(one, run.model)
        if isinstance(one, Adjustment) and not mistaken
        else run.adjust(block, name)
        for one, block, name in zip(given, blocks, _DATES, strict=True)
    )
    for one in adjusted:
        if not one.converged:
            raise adjustment.not_converged(one)
    if asked.datum is None:
        run.asked = asked = replace(asked, datum=usual_datum(adjusted))
    check_datum(*adjusted, asked.datum)
    compared = run.apart(adjusted)
    gained, notes = None, list(slips(*blocks))
    notes += [] if surveys is None else surveys.notes()
    if asked.together:
        run.stable = _stable_names(compared, asked.stable)
        notes.append(_told(run.stable, asked.same_camera))
        apart, compared = compared, run.together()
        if apart.surface is not None:
            gained = float(np.median(apart.surface.sigma)), float(np.median(compared.surface.sigma))
    compared, remaining, explanation = run.explained(compared)
    objections = [] if surveys is None else list(surveys.objections())
    objections += _objections(remaining or compared, run.model)
    # In one adjustment what stands still is common to both dates.
    tied = compared.joint.common_control or (asked.together and run.stable)
    if not tied and asked.bias is None and asked.datum == "stated":
        anew = [] if asked.together else control_of_both(compared.joint.epochs)
        notes.append(_ANEW.format(", ".join(anew)) if anew else _NO_COMMON_CONTROL)
    epochs = (remaining or compared).joint.epochs
    notes += (
        strips_apart(epoch.overdispersion, date)
        for epoch, date in zip(epochs, _DATES if len(epochs) == 2 else _BOTH, strict=True)
        if epoch.overdispersion > SLACK
    )
    notes += (remaining or compared).apart
    names = tuple(block.name for block in blocks)
    return Change(
        names, run.asked, compared, remaining, explanation, gained, tuple(notes), tuple(objections)
    )


@options(asked=Comparison)
def detection(
    what: Block | Adjustment | Plan | str | os.PathLike,
    model: Model | None = None,
    *,
    asked: Comparison,
    seed: int = 0,
) -> SurfaceChange:
    """Levels of detection of two flights like this one; every distance is zero.

    what: a block, its adjustment, or a plan that nobody has flown yet (a `Plan`, a `.toml` file, or
        names of ready-made plans joined by +), which is then simulated from the seed.
    common to same_ties: of `Comparison`. Raises InputError for what is none of these.
    """
    one = what
    if not isinstance(what, Adjustment):
        one = adjustment.adjust(_flown(what, seed), model=model)
    joint = Joint(*clouds(one, one, asked.same_ties, asked.rays), asked.common, asked.bias)
    cores = _cores(joint, asked)
    return surface_change(joint, cores, **asked.chosen(joint, cores).surfaces)


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


def _objections(compared: Compared, model: Model) -> list[Objection]:
    """What of the epochs does not fit their own model."""
    out, adjusted = [], compared.adjustments
    believed = {effect.slug for effect in model.effects}
    who = (BOTH_FLIGHTS,) if compared.joint.together else FLIGHTS
    for one, name in zip(adjusted, who, strict=False):
        out += misfits(one, name)
        out += strange_effects(one, set(one.values) - believed, name)
    out += held_apart(compared.points, min(one.sigma0 for one in adjusted))
    return out


@dataclass
class _Run:
    """One comparison and how it is made. surveyed: displacements (3,) of ground points by
    two surveys, m. cores: those of the first surface. stable: ground points common to both dates,
    where these are adjusted together."""

    model: Model
    asked: Comparison
    threads: int
    say: Callable[..., None]
    blocks: tuple[Block, Block]
    surveyed: Mapping[str, np.ndarray]
    cores: Cores | None = None
    stable: list[str] | None = None

    def without_control(self, names: list[str]) -> None:
        """Take some ground points for check points, whatever their role."""
        if names:
            control = self.model.control
            self.model = replace(
                self.model,
                control=None if control is None else [n for n in control if n not in names],
                check=[*(self.model.check or ()), *names],
            )

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
        return self.without_gross_ties(self._adjusted(block, model), model)

    def without_gross_ties(self, found: Adjustment, model: Model) -> Adjustment:
        """See `corridor.tools.change.matching`."""
        return without_gross_ties(found, partial(self._adjusted, model=model))

    def _adjusted(self, block: Block, model: Model) -> Adjustment:
        return adjustment.adjust(
            block, model=model, threads=self.threads, reject_gnss=self.asked.reject_gnss
        )

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
            pair = pair[0], registered(*pair, asked.motion, asked.same_ties)
        joint = Joint(*pair, asked.common, asked.bias)
        self.say("covariances of the points")
        points = point_changes(joint, asked.level, asked.datum, asked.motion)
        if points is not None:
            check_names(points.names, points.shift, points.sigma, asked.largest)
        surface, volumes = None, {}
        if asked.surface:
            cores = _cores(joint, asked, self.cores)
            self.cores = self.cores or cores
            self.asked = asked = asked.chosen(joint, cores)
            check_meeting(pair[0].xyz, pair[1].xyz, cores)
            self.say(f"covariances of {len(cores)} core points")
            surface = surface_change(
                joint, cores, asked.level, datum=asked.datum, kind=asked.motion, **asked.surfaces
            )
            volumes = {
                name: volume(
                    joint, polygon, cores, registration=surface.registration, **asked.surfaces
                )
                for name, polygon in (asked.polygons or {}).items()
            }
        return Compared(adjusted, joint, points, surface, volumes)

    def explained(self, compared: Compared) -> tuple[Compared, Compared | None, Explanation | None]:
        """The change, the one with what the measurements show modelled, and what effects say."""
        level = self.asked.level
        compared, evidence = self._judged(compared)
        if evidence is None or not self.asked.camera:
            return compared, None, None
        first = explain(evidence, level, compared.moved, compared.doubted)
        if not any(first.shown):
            return compared, None, first
        shown, more = (), first.shown
        # With one effect modelled the measurements may show another.
        while more != shown:
            shown = more
            if self.stable is None:
                remaining = self.apart(compared.adjustments, shown)
            else:
                remaining = self.together(shown)
            remaining, again = self._judged(remaining)
            more = tuple(a | one.shown() for a, one in zip(shown, again.signatures, strict=True))
        told = explained_again(
            first, evidence, again, level, shown, remaining.moved, remaining.doubted
        )
        return compared, remaining, told

    def _judged(self, compared: Compared) -> tuple[Compared, Evidence | None]:
        """The comparison with what moved beside every effect, and what was tested for that; None
        where that is nothing."""
        points, surface, level = compared.points, compared.surface, self.asked.level
        if (points is None or points.held.all()) and surface is None:
            return compared, None
        signatures = ()
        if self.asked.camera:
            self.say("what the camera could do to the ground")
            signatures = tuple(Signatures(epoch) for epoch in compared.joint.epochs)
        evidence = gathered(compared.joint, points, surface, signatures)
        apart = []
        if points is not None and surface is not None:
            against = contradictions(points, surface, level)
            apart += (mark_apart(points, one) for one in against)
            wrong = np.isin(np.arange(len(points)), [one.point for one in against])
            evidence = evidence.besides(points=np.flatnonzero(wrong[points.free]))
            points = replace(points, apart=wrong, moved=points.moved & ~wrong)
        while True:
            patches, gone = [], []
            for one in evidence.patches(0.5 * level):
                rows, disc, weight = evidence.cores_of(one)
                patch = PatchChange.of(surface, rows, one.probability)
                # Where its mean does not show it, what it did against its surroundings has to.
                shown = two_sided(patch.change / patch.sigma) < level
                if weight is not None and not (shown and patch.change * one.z > 0.0):
                    patch = PatchChange.of(surface, rows, one.probability, weight)
                why, rows = _no_ground(compared.joint, surface, patch, **self.asked.surfaces)
                if why is None:
                    # What is said of a patch is the mean of its disc, which has to show it too.
                    if not patch.local:
                        patch = PatchChange.of(surface, disc, one.probability)
                    shown = two_sided(patch.change / patch.sigma) < level
                    patches += [patch.chosen(one.wider)] * bool(shown)
                    continue
                apart.append(patch_apart(patch, why))
                gone.append(np.unique(evidence.cells[:, rows].nonzero()[0]))
            if not sum(map(len, gone)):
                break
            # What else moved there is found beside it.
            evidence = evidence.besides(np.concatenate(gone))
        points = evidence.judged(points, level)
        if points is not None and points.undecided is not None:
            points = points.within(patches, surface, self.surveyed)
        return replace(
            compared, points=points, patches=tuple(patches), apart=tuple(apart)
        ), evidence


def _no_ground(
    joint: Joint, surface: SurfaceChange, patch: PatchChange, degree: int, sampled: bool
) -> tuple[str | None, np.ndarray]:
    """Why a patch is no ground, for a sentence, and which core points are not: the strips of one
    date show two surfaces, it is level as water is at both dates, or some of its points alone lie
    higher at one date."""
    cores, clouds = surface.cores.only(patch.rows), (joint.before, joint.after)
    away = cKDTree(cores.xyz[:, :2]).query(surface.cores.xyz[:, :2])[0]
    # A few cylinders hold too few points of either strip: what they share points with says more.
    around = surface.cores.only(np.flatnonzero(away < 2.0 * cores.radius))
    for cloud, date in zip(clouds, _DATES, strict=True):
        found = layers(cloud, cores, degree) or layers(cloud, around, degree)
        if found is not None:
            return patch_layers(found, date), patch.rows
    flat = level(joint, cores, degree, smoothest(clouds, surface.cores, patch.rows, degree))
    if flat is not None:
        return patch_level(flat), np.flatnonzero(flat.shown(clouds, surface.cores, degree))
    higher = int(patch.change > 0.0)
    rough = np.nanmean(surface.roughness[patch.rows] ** 2, axis=0)
    some = np.flatnonzero(patch.weight)
    each = typical(clouds, surface.cores.only(some), degree, sampled)
    if surface.registration is not None:
        each -= surface.registration.of_motion[some]
    moved = float(patch.weight[some] @ each)
    # Nearer to no motion than to that of the mean; a hole makes the lower date the rougher one.
    few = moved / patch.change < 0.5 and rough[higher] > rough[1 - higher]
    # What is lifted as one is another layer than what is not; less than that is a mixture.
    along = patch.change * cores.normal[:, 2].mean()
    few |= along**2 < APART**2 * scatter_added(clouds, cores, degree, higher)
    return (patch_some(moved, _DATES[higher], cores.radius) if few else None), patch.rows


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
