"""The adjustment of a block: from start values to a result that can be read."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from corridor.core.adjustment.blunders import positions_otherwise, without_exchanged
from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.datum import (
    explain,
    free_network,
    helmert_onto,
    open_motions,
    scaled_by_distances,
)
from corridor.core.adjustment.false_matches import suspects, with_true_matches, without_ties
from corridor.core.adjustment.false_positions import without_false_fixes
from corridor.core.adjustment.gross_errors import begun_with_sound_positions, without_gross_errors
from corridor.core.adjustment.gross_ground import NO_SAY
from corridor.core.adjustment.ground_variances import with_ground_doubts, with_marks_as_they_are
from corridor.core.adjustment.left_out import (
    adjustable_part,
    adjustable_part_as_seen,
    moved_from_start,
)
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.matrix import Singular
from corridor.core.adjustment.model import Loss, Model, listed_effects
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.problem import Problem, State, make_problem
from corridor.core.adjustment.readjusting import (
    unseen_arms,
    weighted_by_scatter,
    with_common_offset,
    with_gnss_as_it_is,
    with_held_focal_asked,
    with_motion_as_seen,
    without_unseen_arms,
)
from corridor.core.adjustment.result import Adjustment, from_where_it_ended, where_it_leads
from corridor.core.adjustment.solving import solve
from corridor.core.adjustment.turns import with_turns_as_seen
from corridor.core.adjustment.variance_components import CONTRADICTING_FACTOR, general
from corridor.core.adjustment.warnings import MISFIT, implausible
from corridor.core.block import POSE, Block, places, read, values_of, with_rigid_poses
from corridor.core.effects import Effect, check_needs
from corridor.core.engine.scene import SQUARES
from corridor.core.errors import AdjustmentFailed, InputError, StartFailed, some
from corridor.core.geometry import OUTLIER
from corridor.core.options import options
from corridor.core.output import Progress, counted, telling
from corridor.core.preparation import (
    Prepared,
    plausibility_warnings,
    prepare,
    without_impossible_points,
    without_starts,
)

# Real flights take 15 to 30; a robust loss creeps along weak directions for up to 70.
ITERATIONS = 100
# What a lens that is not calibrated may bend, as a start: with this standard deviation.
START_LENS = {"k1": 0.1, "k2": 0.1}
# Start values beyond the pictures: of more points than this share, something else is wrong.
_WILD = 0.1
# Of the images so many at most may be left out because nothing determines their poses.
_SPARE = 0.05
# Points that two images need to be oriented to each other (Nistér 2004).
_FOR_A_PAIR = 5
# Sigma naught of what has been adjusted to something that cannot be.
_WRECKED = 20.0
# Sigma naught that errors of measurements alone, or an effect that is missing, hardly reach.
_MISFIT = 3.0
# Share of marks far off beyond which it is not they that are wrong.
_MANY = 0.2
_WEIGHTS = ("estimated", "marks", "stated")
# Of so few images, or the share above, start poses that show nothing are found anew; of more, a
# convention is another one.
_FEW_POSES = 2
# Positions that rise by so many times more than they lie apart are worth a question.
_STEEP = 2.0
# A point that ends this near to a camera, of where it began, has fallen into it.
_FALLEN = 0.1
# Start poses that are off by more are worth a question: those of gimbals and courses are not.
_FAR_DEG = 15.0


@dataclass(frozen=True)
class Run:
    """How the equations are solved.

    threads: 1 or 2. progress: called with a `Progress`; after each iteration its result has
    iteration, cost, damping, step and accepted. max_iterations: None: as many as is usual. strict:
    refuse cells that cannot be true, points that one image alone shows or that fall into a camera,
    and images with fewer than three points, which are left out and named in `warnings` otherwise.
    """

    threads: int = 1
    progress: Callable[[Progress], None] | None = None
    max_iterations: int | None = None
    strict: bool = False

    def __post_init__(self):
        if self.threads < 1:
            raise InputError(f"{self.threads} threads cannot adjust anything: use 1 or 2")

    @property
    def say(self) -> Callable[..., None]:
        """Tells the progress."""
        return telling(self.progress)


@options(model=Model, run=Run)
def adjust(
    block: Block | str | os.PathLike,
    model: Model,
    *,
    run: Run,
    reject_gnss: bool = False,
    weights: str = "estimated",
) -> Adjustment:
    """Least-squares adjustment of tie points, marks, ground control and GNSS.

    block: as read, or its folder.
    camera: free interior parameters, `fixed`, `fraser8`, `fraser10`, `f,cx,cy,k1` or a list of
        names; a mapping gives each camera its own. Default: eight, or none where the camera is
        calibrated.
    effects: slugs of effects to estimate with the rest; `slug@flight` for one set a flight.
    control, check: ground points with that role, in place of the roles in ground.csv.
    loss: `squares`, `huber:2` or `cauchy:2`, on the length of an image residual in sigmas.
    priors: value and standard deviation by name: `{"camera.P1.f": (8190.0, 5.0)}`.
    lever_arm: `free` or `fixed`; default: free unless block.toml fixes it or the antenna positions
        do not show it: such an arm is held at 0, or as stated.
    model: a `Model` in place of camera, effects, control, check, loss, priors and lever_arm.
    threads: 1 or 2. max_iterations: 100 if none is given.
    progress: called with a `Progress`; after each iteration its result has iteration, cost,
        damping, step and accepted.
    strict: refuse cells that cannot be true, points that one image alone shows, and images with
        fewer than three points, which are left out and named in `warnings` otherwise; and set no
        match, mark, ground point or image aside that contradicts the rest.
    run: a `Run` in place of threads, max_iterations, progress and strict.
    reject_gnss: leave out antenna positions whose residual is beyond five sigmas (false fixes,
        which no smoother of the track can see), a block of them too, and adjust again, until none
        is left.
    weights: `estimated`: where antenna positions contradict their stated standard deviations, they
        are weighted as they are, a block of false ones apart from the rest, and coarse ones with
        the offset they share; a sentence says so (`Adjustment.variance_components`), and where
        marks or ground control contradict theirs; single control points that all other
        observations contradict are set aside. `marks`: these are weighted as they are, in
        place of the positions. `stated`: as stated.

    What the block can know by itself is filled in first (`corridor.prepare`), as in `diagnose`.
    A focal length that block.toml says is stated (`f_stated`, by photographs) is a prior of a
    camera that is free. Antenna positions too coarse to see a lever arm are assumed to be so rather
    than known: where they scatter otherwise, that is used and said.
    Where it fails, or sigma naught is beyond three, false matches and images of which all is wrong
    are looked for; left out and told where the rest fits (sigma naught below two), or they lie
    beyond 15 times what remains beside it; never if strict.
    Missing start values are made (`corridor.adjustment.initial`). A block with neither control
    nor GNSS is adjusted as a free network, laid on its start poses as a whole.
    Raises InputError where the block cannot be adjusted as asked, AdjustmentFailed where the
    iterations get nowhere.
    """
    if weights not in _WEIGHTS:
        raise InputError(f"weights {weights!r} are unknown: use {some(_WEIGHTS, 3)}")
    prepared = prepare(read(block), velocities=bool(model.effects))
    block = prepared.block
    check_needs(block, listed_effects(model.effects))

    def again(
        part: Block, model: Model = model, begun: bool = False, steps: int | None = None
    ) -> Adjustment:
        few = run if steps is None else replace(run, max_iterations=steps)
        try:
            return _once(part, model, few, begun=begun)
        except AdjustmentFailed:
            if not model.effects:
                raise
            # Effects look at poses: where those are far off, they lead further away.
            found = _once(_once(part, model.without_effects(), run).block, model, run)
            found.begun_from(part)
            return found

    def sound(part: Block) -> Adjustment:
        return _without_gross_errors(part, model, again, weights, run.strict)

    def settled(found: Adjustment, part: Block) -> Adjustment:
        if reject_gnss:
            found = without_false_fixes(found, again, part.gnss_sigma())
        found = weighted_by_scatter(found, again)
        if weights == "estimated":
            found = with_common_offset(found, again, part.gnss_sigma())
            found = with_gnss_as_it_is(found, again)
        found = without_unseen_arms(found, again, model.lever_arm is not None)
        found = with_motion_as_seen(found, again)
        found = with_held_focal_asked(found, again)
        return with_ground_doubts(found) if weights == "estimated" else found

    def from_start(block: Block) -> Adjustment:
        _refuse_steep(block)
        block, turned = with_turns_as_seen(block, again)
        block, other = without_impossible_points(block, run.strict)
        block, left_out = adjustable_part_as_seen(block, model, again, run.strict)
        doubtful = [*turned, *other, *plausibility_warnings(block, without=True)]
        try:
            result, exchanged = _with_ground_as_seen(
                block, model, sound, settled, again, run.strict
            )
        except (InputError, AdjustmentFailed) as error:
            if not doubtful:
                raise
            # What looks wrong at first sight is the likelier cause.
            raise type(error)(f"{doubtful[0]} So: {error}") from None
        result.doubts = doubtful
        used = _used(prepared, listed_effects(model.effects))
        result.add_note(*doubtful, *left_out, *exchanged, *reversed(used))
        return result

    def robust(part: Block) -> Adjustment:
        return again(part, replace(model, loss=NO_SAY))

    return _from_a_better_start(block, from_start, robust, run)


def _from_a_better_start(
    block: Block,
    adjusted: Callable[[Block], Adjustment],
    robust: Callable[[Block], Adjustment],
    run: Run,
) -> Adjustment:
    """Adjusted from the start values. Where that fails, or moves far from them and does not fit, or
    only without some of the measurements, from start values that are made of the measurements
    alone, where that fits, and with more of them.

    robust: one robust adjustment, which shows whether these may fit: `adjusted` asks many questions
    and takes long where nothing does.
    """
    result, told = None, ""
    try:
        result = adjusted(block)
        fits, lost = _fits(result), _left_out(block, result)
        if (fits and not lost) or not _far_from_start(result, block):
            return result
        told = f"{lost:,} measurements are left out" if fits else "the adjustment does not fit"
    except StartFailed as error:
        failure, told = error, str(error).rstrip(".")
    bare, better = _without_any_start(block), None
    if bare is not None:
        # Once, whatever the adjustment asks of it.
        with suppress(InputError):
            begun = complete(bare, run.progress)
            if _fits_more(robust, begun, result):
                better = where_it_leads(adjusted, begun)
    if better is not None and _fits(better) and not implausible(better):
        if result is None or not fits or _left_out(block, better) < lost:
            better.add_note(
                "The start poses of images.csv are not used: without them everything fits, with "
                f"poses computed from the tie points. With them: {told}."
            )
            return better
    if result is None:
        raise failure
    return result


def _fits_more(
    robust: Callable[[Block], Adjustment], begun: Block, result: Adjustment | None
) -> bool:
    """Whether a robust adjustment fits most rays of tie points, and more than the result does."""
    try:
        found = robust(begun)
    except AdjustmentFailed:
        return False
    except InputError:
        # The whole adjustment may leave out what this one cannot adjust.
        return True
    fit = _rays_that_fit(found)
    return fit > max(0.5 * len(begun.tie_points), 0 if result is None else _rays_that_fit(result))


def _rays_that_fit(found: Adjustment) -> int:
    ties = found.residuals["tie"]
    return int((np.hypot(ties["vx"], ties["vy"]) < OUTLIER * ties["sigma"]).sum())


def _fits(result: Adjustment) -> bool:
    return result.converged and _size(result) < _MISFIT


def _left_out(block: Block, result: Adjustment) -> int:
    """How many rays of tie points and positions of a block an adjustment makes no use of."""
    p, rays = result.problem, np.bincount(block.tie_points["point"].cat.codes)
    ties = np.count_nonzero(p.row < p.tie_count)
    return int(rays[rays > 1].sum() - ties + len(block.gnss) - len(p.gnss_image))


def _far_from_start(result: Adjustment, block: Block) -> bool:
    """Whether any image is elsewhere, by half of the way to its neighbour, or looks elsewhere."""
    pose = result.pose
    start = block.poses[places(result.start.images["image"], block.images["image"])]
    away, turn = moved_from_start(pose, start)
    apart = np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1)
    near = np.median(apart) if len(apart) else np.inf
    return bool(((away > 0.5 * near) | (turn > _FAR_DEG)).any())


def refit(
    block: Block, model: Model, run: Run, near: bool = False, motion: bool = True
) -> Adjustment:
    """One adjustment of a block that is ready, for comparison with others of the same.

    Every observation counts as it is stated: nothing is derived, weighted anew or left out, but for
    tie points that fall into a camera, and the size of errors of velocities that are unknowns,
    where the model does not state it.
    near: the start is near the result: a robust loss counts at once. motion: False: that size is as
    usual.
    Raises InputError and AdjustmentFailed as `adjust` does.
    """
    run = replace(run, strict=True)

    def once(part: Block, model: Model, near: bool = True) -> Adjustment:
        return _once(part, model, run, near=near, refitted=True)

    found = once(block, model, near)
    return with_motion_as_seen(found, once) if motion and not model.motion else found


def _with_ground_as_seen(
    block: Block,
    model: Model,
    sound: Callable[[Block], Adjustment],
    settled: Callable[[Adjustment, Block], Adjustment],
    again: Callable,
    strict: bool,
) -> tuple[Adjustment, list[str]]:
    """The block adjusted; where that fails, or no camera is so, without false matches or exchanged
    ground points.

    sound: adjusts without gross errors in marks and positions. settled: then weighs all as it is.
    """
    result: Adjustment | None = None
    failure: InputError | AdjustmentFailed
    left: list[str] = []

    def whole(part: Block) -> Adjustment:
        return settled(sound(part), part)

    try:
        result = sound(block)
        # Where squares get nowhere, weights are asked for when false matches are not the cause.
        if strict or result.converged:
            result = settled(result, block)
    except (InputError, AdjustmentFailed) as error:
        failure, result = error, None
    wrecked = result is None or not result.converged or result.sigma0 > _WRECKED
    if not strict and (result is None or _misfits(result)):
        # Where wrong marks bend all, they hide which matches are false.
        found, starts = None, [block]
        if result and len(result.start.marks) < len(block.marks):
            starts.insert(int(result.sigma0 > _MISFIT), result.start)
        for start in starts:
            found = where_it_leads(with_true_matches, start, model, again, whole, _begun)
            if found:
                if result and start is not block:
                    found.keep_notes(result)
                break
        better = (
            found
            and found.converged
            and (
                result is None
                or wrecked
                or _size(found) < _size(result) / CONTRADICTING_FACTOR
                or found.sigma0 < MISFIT < result.sigma0
            )
        )
        if found and better:
            if found.sigma0 < CONTRADICTING_FACTOR:
                return found, []
            # What the model lacks, or ground points, may still be wrong beside them.
            result, block, left = found, found.start, found.notes
            wrecked = result.sigma0 > _WRECKED
    if not strict and result and not result.converged:
        try:
            result = settled(result, block)
        except (InputError, AdjustmentFailed) as error:
            failure, result = error, None
    # A robust loss takes marks of points that lie elsewhere for wrong ones.
    if result is None or wrecked or _many_wrong_marks(result) or implausible(result):
        right, notes = without_exchanged(block, model, again)
        if notes:
            try:
                return whole(right), [*left, *notes]
            except (InputError, AdjustmentFailed) as error:
                raise type(error)(f"{notes[0]} So: {error}") from None
    if result is None:
        raise failure
    return result, []


def _misfits(result: Adjustment) -> bool:
    """Whether single matches may be what does: what a model lacks is in all about them too."""
    if result.sigma0 < MISFIT and _size(result) < _WRECKED:
        return False
    if not result.converged:
        return True
    ties = result.residuals["tie"]
    # What all bends to hides which rays and images are wrong.
    if result.sigma0 > _WRECKED:
        return bool(ties["gross"].any())
    if result.sigma0 < _MISFIT and _size(result) < _WRECKED:
        # A robust loss gets over a few that are gross; a model that lacks something leaves more.
        robust = Loss.parse(result.problem.model.loss).kind != SQUARES
        if robust or general(result) > MISFIT:
            return False
    rays, images = suspects(ties)
    return bool(rays.any() or images)


def _size(result: Adjustment) -> float:
    """Sigma naught of tie points as squares have it: a robust loss hides gross ones in its own."""
    ties = result.residuals["tie"]
    scaled = values_of(ties, "vx", "vy") / values_of(ties, "sigma")
    return max(result.sigma0, float(np.sqrt(np.mean(scaled**2))) if len(ties) else 0.0)


def _many_wrong_marks(result: Adjustment) -> bool:
    gross = result.residuals["mark"]["gross"]
    return len(gross) > 0 and gross.mean() > _MANY


def _without_gross_errors(
    block: Block, model: Model, again: Callable, weights: str, strict: bool
) -> Adjustment:
    """The block adjusted, without what squares do not get over.

    A robust loss limits image points, and not positions: it is for squares to tell what is gross,
    and, if asked, how good marks are.
    """

    def by_squares(model: Model) -> Adjustment:
        first = begun_with_sound_positions(block, model, again, strict, weights == "estimated")
        found = without_gross_errors(first, again, strict)
        return with_marks_as_they_are(found, again) if weights == "marks" else found

    if Loss.parse(model.loss).kind == SQUARES:
        return by_squares(model)
    try:
        found = by_squares(replace(model, loss="squares"))
    except (InputError, AdjustmentFailed):
        return again(block)
    return from_where_it_ended(found, found.start, model, again)


def _used(prepared: Prepared, effects: list[Effect]) -> list[str]:
    """Sentences on derived columns that this adjustment made use of, and on what failed."""
    used = {"gnss", "images.flight"}
    used |= {column for effect in effects for column in (*effect.needs, *effect.takes)}
    told = [one.sentence for one in prepared.derived if one.column in used]
    return list(dict.fromkeys([*told, *prepared.notes]))


def _once(
    block: Block,
    model: Model,
    run: Run,
    spare: int | None = None,
    near: bool = False,
    begun: bool = False,
    refitted: bool = False,
) -> Adjustment:
    """One adjustment.

    near: whether the start is near the result. begun: whether another of the same has ended, so
    that no pose is undetermined. refitted: for comparison, with points left out that spoil it all.
    spare: how many images may be left out because nothing determines their pose; None: a few.
    """
    began = time.perf_counter()
    start, notes = block, []
    spare = int(_SPARE * len(block.images)) if spare is None else spare
    block = with_rigid_poses(block)
    if _incomplete(block):
        block = complete(block, run.progress)
    problem, loss = make_problem(block, model), Loss.parse(model.loss)
    threads = min(run.threads, 2)
    residual, behind = Normal(problem, loss, threads).residuals(problem.start)
    lost = _wild_starts(problem, residual)
    if behind:
        few = 0 if run.strict and not refitted else max(_SPARE * len(block.images), _FEW_POSES)
        block, more = _in_front(block, problem, residual, lost, few)
        notes += more
    elif lost:
        block = _without_starts(block, lost)
    if behind or lost:
        problem = make_problem(block, model)
    del residual  # as large as the observations

    problem = scaled_by_distances(problem)

    def at(state: State) -> LinearSystem:
        return LinearSystem(problem, state, loss, threads=threads)

    loose = None if run.strict or begun or not spare else _undetermined(at(problem.start))
    if loose is not None:
        return _without_image(start, block, *loose, model, run, spare)
    solution, iterations = None, run.max_iterations or ITERATIONS
    try:
        datum = free_network(at(problem.start))
    except InputError:
        if not problem.arms_free or model.lever_arm is not None:
            raise
        held = _once(start, replace(model, lever_arm="fixed"), run, spare, near, begun, refitted)
        why = "beside a free one only ground control points would say where the block lies"
        held.add_note(unseen_arms(held, why))
        return held
    try:
        normal = Normal(problem, loss, threads=threads)
        if datum is not None:
            normal.held = datum.held
        solution = solve(normal, iterations, say=run.say, near=near, equations=datum is None)
        if not (solution.converged or run.strict) and iterations >= ITERATIONS:
            fallen = _fallen(problem, solution.state)
            if fallen:
                return _without_fallen(start, block, fallen, model, run)
        if datum is None:
            system = LinearSystem.in_place(normal, solution.state, threads, solution.factor)
            solution.factor = None  # the system may let go of it
        del normal  # as large as the equations
        if datum is not None:
            system = at(solution.state)
            if datum.null_space.shape[1] >= open_motions(problem).sum():
                system = at(helmert_onto(problem, solution.state, problem.start))
            datum = free_network(system)
        if datum is not None:
            system = replace(system, held=datum.held)
        covariance = Covariance(system, None if datum is None else datum.null_space)
    except Singular as singular:
        keep = run.strict and not refitted
        fallen = _fallen(problem, solution.state) if solution and not keep else set()
        if fallen:
            return _without_fallen(start, block, fallen, model, run, near, refitted)
        own = singular.shared is None and (singular.own is None or singular.own < 6)
        alone = None if singular.image is None else problem.images.names[singular.image]
        error = explain(at(problem.start), singular)
        if run.strict or not own or alone is None or str(alone) not in str(error) or not spare:
            raise error from None
        return _without_image(start, block, str(alone), error, model, run, spare)
    solution.state = system.state
    return Adjustment(
        start, solution, covariance, time.perf_counter() - began, [*problem.notes, *notes]
    )


def _undetermined(system: LinearSystem) -> tuple[str, InputError] | None:
    """The image with few points whose pose nothing determines, and the error that says so.

    It would keep the iterations from their end. Whether one with more points is undetermined is
    known only there.
    """
    p = system.problem
    if np.bincount(p.img, minlength=p.image_count).min() >= _FOR_A_PAIR:
        return None
    if free_network(system) is not None:
        return None
    try:
        _ = system.factor
    except Singular as singular:
        if singular.shared is None and singular.image is not None and (singular.own or 0) < 6:
            few = np.count_nonzero(p.img == singular.image) < _FOR_A_PAIR
            name, error = str(p.images.names[singular.image]), explain(system, singular)
            return (name, error) if few and name in str(error) else None
    return None


def _without_image(
    start: Block, block: Block, name: str, error: InputError, model: Model, run: Run, spare: int
) -> Adjustment:
    """The adjustment without an image whose pose nothing determines; else the error."""
    others = block.images.loc[block.images["image"] != name, "image"]
    try:
        part, notes = adjustable_part(block.select(images=others), model)
        found = _once(part, model, run, spare - 1)
    except InputError:
        raise error from None
    found.add_note(*notes)
    found.add_note(
        f"Image {name} is left out: its pose cannot be determined, because its points lie on a "
        "line or link it to the other images by too few points."
    )
    return found


def _begun(block: Block) -> Block:
    """The block with what has no start value filled in."""
    return complete(block) if _incomplete(block) else block


def complete(block: Block, progress: Callable[[Progress], None] | None = None) -> Block:
    """The block with every pose and every point filled in; what is given is kept as it is.

    See `corridor.adjustment.initial`. progress: called with a `Progress`.
    Raises InputError naming the images that cannot be oriented, and the remedy.
    """
    posed = np.isfinite(block.poses).all(axis=1)
    if len(block.points) and not posed.any() and (len(block.gnss) or len(block.ground) > 2):
        # Rough points would hold poses that are made from nothing; they are start values after.
        bare = block.copy()
        bare.points = bare.points.iloc[:0]
        try:
            made = _completed(bare, progress)
        except InputError:
            return _completed(block, progress)
        given = made.points["point"].isin(block.points.dropna()["point"])
        made.points = pd.concat([block.points, made.points[~given]], ignore_index=True)
        return made
    return _completed(block, progress)


def _completed(block: Block, progress: Callable[[Progress], None] | None) -> Block:
    """As `complete`. Where start poses are too rough to orient another image beside them, it is
    oriented beside what an adjustment makes of them, or all images are without them."""
    from corridor.core.adjustment import initial  # loads OpenCV: 25 MB

    try:
        return initial.complete(block, _interim, progress)
    except InputError as failure:
        error = failure
    pose, posed = block.poses, np.isfinite(block.poses).all(axis=1)
    for near, kept in (
        (_with_adjusted_starts(block), posed),
        (_without_any_start(block), np.zeros(len(posed), dtype=bool)),
    ):
        if near is not None:
            with suppress(InputError):
                found = initial.complete(near, _interim, progress).poses
                found[kept] = pose[kept]
                out = block.copy()
                out.put("images", POSE, found)
                return initial.complete(out, _interim, progress)
    raise error


def _refuse_steep(block: Block) -> None:
    """Raises InputError where positions rise by more than they lie apart, and the images show
    without them that it is their unit: start poses that were made of them are in the same."""
    given = block.numbers("gnss", *"xyz")
    known = given[np.isfinite(given).all(axis=1)]
    if not len(known) or not np.ptp(known[:, 2]) > _STEEP * np.ptp(known[:, :2], axis=0).max():
        return
    bare = without_starts(block, np.ones(len(block.images), dtype=bool))
    for table in ("points", "gnss", "ground", "marks"):
        setattr(bare, table, getattr(bare, table).iloc[:0])
    try:
        made = complete(bare).poses
    except (InputError, AdjustmentFailed):
        return
    # Level heights would do as well as those that are read in a unit; these are not level.
    at = made[block.image_rows("gnss"), :3]
    if told := positions_otherwise(given, at, of_nothing=1.0):
        raise InputError(f"{told}, as the images show by themselves: write metres.")


def _without_any_start(block: Block) -> Block | None:
    """The block without poses and points; None where nothing else says where it lies."""
    given = np.isfinite(block.poses).any()
    if not given or (not len(block.gnss) and len(block.ground) < 3):
        return None
    bare = without_starts(block, np.ones(len(block.images), dtype=bool))
    bare.points = bare.points.iloc[:0]
    return bare


def _with_adjusted_starts(block: Block) -> Block | None:
    """The block with poses, points and cameras as an adjustment of the images that have a pose
    makes them; None where it cannot."""
    pose = block.poses
    posed = np.isfinite(pose).all(axis=1)
    if posed.all() or posed.sum() < 2:
        return None
    part = block.select(images=list(block.images["image"][posed]))
    try:
        found = _interim(adjustable_part(part, Model())[0])
    except InputError:
        return None
    if found is None or len(found.images) < posed.sum():
        return None
    pose[posed] = found.poses
    out = replace(block.copy(), cameras={**block.cameras, **found.cameras}, points=found.points)
    out.put("images", POSE, pose)
    return out


def _interim(part: Block) -> Block | None:
    """The oriented part adjusted, with k1 and k2 of lenses that are not calibrated."""
    own = {name: camera for name, camera in part.cameras.items() if not camera.calibrated}
    priors = {
        f"camera.{name}.{term}": (camera[term], sigma)
        for name, camera in own.items()
        for term, sigma in START_LENS.items()
    }
    try:
        free = dict.fromkeys(own, ",".join(START_LENS))
        model = Model(camera=free, loss="huber:3", priors=priors)
        return _once(part, model, Run(max_iterations=10)).block
    except (InputError, AdjustmentFailed):
        return None


def _incomplete(block: Block) -> bool:
    """Whether a pose or a point has no start value."""
    if not np.isfinite(block.poses).all():
        return True
    for table in ("tie_points", "marks"):
        known = np.isfinite(block.positions(table)).all(axis=1)
        if not (known.all() or known[getattr(block, table)["point"].array.codes].all()):
            return True
    return False


def _wild_starts(problem: Problem, residual: np.ndarray) -> set[str]:
    """Names of the few points whose start lies beyond the picture of an image that sees others.

    Start values do not shape a result; one that is wild leads every image astray on the way.
    residual (n, 2): px, of the start.
    """
    size = problem.images.size
    # Nearly always none: what follows is as large as the observations, several times.
    highest, lowest = (by.reduce(residual, axis=None, initial=0.0) for by in (np.fmax, np.fmin))
    if max(highest, -lowest) <= size.min():
        return set()
    far = (np.abs(residual) > size[problem.img]).any(axis=1)
    seen, lost = (
        np.bincount(images, minlength=problem.image_count)
        for images in (problem.img, problem.img[far])
    )
    names = _names_of(problem, far & (2 * lost < seen)[problem.img])
    return names if len(names) <= _WILD * (len(problem.ptr) - 1) else set()


def _without_starts(block: Block, names: set[str]) -> Block:
    """The block with tie points of these names intersected anew."""
    block = block.copy()
    lost = block.points["point"].isin(names)
    block.points.loc[lost, ["x", "y", "z"]] = np.nan
    return complete(block)


def _in_front(
    block: Block, problem: Problem, residual: np.ndarray, wild: set[str], few: float
) -> tuple[Block, list[str]]:
    """The block with points that start behind a camera, or wild, intersected anew or left out, and
    so few poses that put all points there found anew."""
    behind = np.isnan(residual[:, 0])
    count = np.bincount(problem.img, minlength=problem.image_count)
    hidden = np.bincount(problem.img[behind], minlength=problem.image_count)
    blind = np.flatnonzero((hidden == count) & (count > 0))
    if len(blind) > few:
        row = problem.order[blind].min()
        more = f" ({len(blind) - 1} more images too)" if len(blind) > 1 else ""
        raise InputError(
            f"{block.where('images', row)}: all points of image "
            f"{block.images['image'].iloc[row]} lie behind it{more}: check its quaternion (world "
            "to camera, qw first) and its position"
        )
    notes = []
    if len(blind):
        block, rows = block.copy(), problem.order[blind]
        pose = block.poses
        pose[rows] = np.nan
        block.put("images", POSE, pose)
        names = block.images["image"].iloc[rows]
        notes.append(
            f"{counted(len(rows), 'start pose')} of images.csv put all points behind the image "
            f"({some(sorted(names), 5)}): found anew from the points."
        )
    block = _without_starts(block, _names_of(problem, behind) | wild)
    again = make_problem(block)
    residual, still = Normal(again, Loss()).residuals(again.start)
    if not still:
        return block, notes
    hopeless = _names_of(again, np.isnan(residual[:, 0]))
    return without_ties(block, hopeless), [
        *notes,
        f"{len(hopeless)} tie points lie behind a camera that measured them and are left out "
        f"({some(sorted(hopeless), 5)}): their matches are wrong.",
    ]


def _fallen(problem: Problem, state: State) -> set[str]:
    """Names of tie points that the iterations drew into a camera.

    Where two images stand nearly at one place, or a match is wrong, the angle between two rays is
    that of their errors: what they fit best is a point in the camera itself, from which nothing is
    determined any more.
    """
    point = problem.point_of_ray
    before, after = (
        np.linalg.norm(at.points[point] - at.centre[problem.img], axis=1)
        for at in (problem.start, state)
    )
    return _names_of(problem, after < _FALLEN * before) & set(problem.block.tie_points["point"])


def _without_fallen(
    start: Block,
    block: Block,
    names: set[str],
    model: Model,
    run: Run,
    near: bool = False,
    refitted: bool = False,
) -> Adjustment:
    """The adjustment, from its start again, without tie points that fell into a camera."""
    found = _once(without_ties(block, names), model, run, near=near, refitted=refitted)
    found.begun_from(start)
    found.add_note(
        f"{counted(len(names), 'tie point')} that the adjustment drew into a camera left out "
        f"({some(sorted(names), 5)}): their rays are nearly parallel, or their matches are wrong."
    )
    return found


def _names_of(problem: Problem, rays: np.ndarray) -> set[str]:
    """Names of the points of some rays (n,), given as a mask."""
    return set(problem.point_names[np.unique(problem.point_of_ray[rays])])
