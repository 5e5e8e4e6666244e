"""Levenberg-Marquardt: damping that vanishes, convergence judged on the step.

The step is measured in standard deviations (sqrt of x' N x), so that one tolerance serves metres,
radians and pixels alike. A damped step that raises the cost is tried again with the points at rest
where it leads; one without damping, where large residuals bend the cost more than the equations
know, as far as the parabola through cost and slope has its lowest point.
Source: Marquardt 1963; Jeong et al. 2010 (embedded point iterations); Nocedal and Wright 2006,
section 3.5 (quadratic interpolation).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from corridor.core.adjustment.matrix import Bordered, Singular
from corridor.core.adjustment.normal import NEAR, Loss, Normal, moved_state
from corridor.core.adjustment.problem import State
from corridor.core.adjustment.rigs import hung
from corridor.core.brief import brief
from corridor.core.engine.scene import SQUARES
from corridor.core.engine.threads import one_thread
from corridor.core.errors import StartFailed

FIRST_DAMPING = 1e-6
# Damping is divided by this after a good step; after a bad one it is raised ever faster and
# released with caution, or it would swing between too much and too little.
DAMPING_DIVISOR = 100.0
CAREFUL_DIVISOR = 3.0
LEAST_DAMPING = 1e-10
# Step at which the squares are good enough for a robust loss to start from.
STEP_BEFORE_LOSS = 1.0
NO_DAMPING = 1e-12
# Reweighting makes steps that shrink by a third to a half: so many times the tolerance of squares.
ROBUST = 10.0
SHARED_STEP = 1e-3
SMALL_STEP = 5e-5
# After so short a step, in standard deviations, covariances change by less than 1e-6 of themselves:
# measured are 0.001 to 0.7 times the step.
NEGLIGIBLE_STEP = 1e-6
# How much more slowly steps may shrink from now on than they did last.
SHRINKING_MARGIN = 10.0
# After a longer step it is cheaper to look first where the points now lie than to assemble twice.
LONG_STEP = 0.1
# Where a step lowered the cost by this share of what the equations promised, damping ends.
GOOD_GAIN_RATIO = 0.9
# So short a step, in standard deviations, and of this share of the one before, leaves the matrix as
# it is for the next one. A robust loss changes its weights by as little, and creeps with the matrix
# of the new ones no faster: with ratios of 0.8 to 0.97 on real flights.
REUSE_SQUARES, REUSE_ROBUST = (0.01, 0.03), (0.05, 1.0)


@brief
@dataclass
class Solution:
    """Where the iterations ended.

    factor: that of the equations there, in their place, where it was there to be had.
    """

    state: State
    converged: bool
    iterations: int
    cost: float
    history: list[dict] = field(default_factory=list)
    factor: Bordered | None = None


def solve(
    normal: Normal,
    max_iterations: int = 50,
    tolerance: float = 5e-5,
    say: Callable[..., None] | None = None,
    near: bool = False,
    equations: bool = False,
) -> Solution:
    """Minimise from the problem's start.

    tolerance: RMS of the step over all unknowns (of a robust loss: all but points), in standard
    deviations of unit weight; besides, none that images share may have further to go than
    `SHARED_STEP` of its own standard deviation.
    A robust loss starts from the least squares solution: far from it every residual is an outlier;
    near: the start is near the solution, and the loss counts at once.
    equations: leave those of the result in `normal`, undamped, for whoever goes on with them, or
        their factor, which `Solution` has then.
    Raises AdjustmentFailed where no step lowers the cost and the step is not small.
    """
    start = hung(normal.problem, normal.problem.start)
    with one_thread():
        if normal.loss.kind == SQUARES:
            if normal.has_image_effects or len(normal.problem.rig_image):
                # One step of Newton finds what they look at, but for a little of the last step.
                # The shift of a mounting turns with its exposure, which the equations leave out.
                tolerance /= 10
            return _solve(normal, start, max_iterations, tolerance, say, [], equations)
        if near:
            return _solve(normal, start, max_iterations, ROBUST * tolerance, say, [], equations)
        loss, normal.loss = normal.loss, Loss()
        first = _solve(normal, start, max_iterations, STEP_BEFORE_LOSS, say, [])
        normal.loss = loss
        return _solve(
            normal, first.state, max_iterations, ROBUST * tolerance, say, first.history, equations
        )


def _solve(normal, state, max_iterations, tolerance, say, history, equations=False) -> Solution:
    p = normal.problem
    damping, release = FIRST_DAMPING, DAMPING_DIVISOR
    normal.assemble(state, damping)
    cost, near = normal.cost, normal.modelled
    # Of the step before: its length, and the factor, which is taken again without a new matrix.
    last, matrix = np.inf, True
    system: Any = None
    factor: Any = None
    for iteration in range(len(history) + 1, max_iterations + 1):
        raising = 4.0
        while True:
            try:
                system, fresh = normal.factor() if matrix else system, matrix
                step, shared, down, square = _step(system, normal)
            except Singular:
                if damping >= 1e4:
                    raise
                damping = max(damping * 100.0, LEAST_DAMPING)
                normal.assemble(state, damping, near)
                matrix = True
                continue
            points, down_points, square_points = normal.substitute(state, damping, step, shared)
            # x' N x without damping: the step in standard deviations, squared.
            of_images = max(down - damping * square, 0.0)
            down, square = down + down_points, square + square_points
            length = np.sqrt(max(down - damping * square, 0.0) / p.unknown_count)
            # A point whose rays contradict each other slides along a valley of a robust cost, with
            # steps that hardly shrink, and nothing else depends on where it stands.
            judged = length
            if normal.loss.kind != SQUARES:
                judged = np.sqrt(of_images / (p.image_count * p.d + p.shared_count))
            trial = moved_state(p, state, step, shared, points)
            relaxed = damping / release if damping / release > NO_DAMPING else 0.0
            trial_near = near
            short, share = REUSE_SQUARES if normal.loss.kind == SQUARES else REUSE_ROBUST
            matrix = damping > 0.0 or length > min(short, share * last)
            if normal.has_image_effects and length > LONG_STEP:
                trial_near = normal.modelled_at(trial, near, NEAR)
            # A damped step is short along what is badly determined: it proves nothing. Steps that
            # shrink fast leave little of what the last one moved: it is the rest that counts.
            rest = min(SHRINKING_MARGIN * length / last, 1.0) if 0.0 < last < np.inf else 1.0
            newton = fresh and not (damping or normal.loss.kind or normal.has_image_effects)
            done = (rest if newton else 1.0) * judged < tolerance and (
                tolerance >= STEP_BEFORE_LOSS
                or (damping == 0.0 and _at_rest(system, rest * shared, SHARED_STEP))
            )
            # Rounding of the cost may hide the gain of a last, tiny step. Effects look one step
            # behind: the cost knew less of them before than it does now, which hides more.
            hidden = (1e-8 if normal.has_image_effects else 1e-12) * cost
            tiny = length < max(tolerance, SMALL_STEP)
            # After a step that is hardly one the matrix is the one that made it, but for effects
            # that look one step behind.
            hardly = fresh and length < NEGLIGIBLE_STEP and not normal.has_image_effects
            if done and (hardly or not equations):
                factor = system if equations else None
                normal.assembled = None  # of the state before, with all its points
                reached, behind = normal.cost_at(trial, near)
            elif done:
                normal.assemble(trial, 0.0, near)
                reached, behind = normal.cost, normal.behind
            else:
                # The equations of the next step give the cost of this one.
                normal.assemble(trial, relaxed, trial_near, matrix)
                if not (tiny or normal.behind) and cost < normal.cost - hidden < np.inf:
                    matrix = True
                    if damping:
                        trial = _points_at_rest(normal, trial, relaxed)
                    else:
                        part = 0.5 * down / (normal.cost - cost + down)
                        points = state.points + part * (points - state.points)
                        trial = moved_state(p, state, part * step, part * shared, points)
                        # Too long a step without damping: the next is held back, or all creep.
                        relaxed = LEAST_DAMPING
                        normal.assemble(trial, relaxed, near)
                reached, behind = normal.cost, normal.behind
            better = cost - reached >= -hidden or tiny
            accepted = bool(behind == 0 and np.isfinite(reached) and better)
            entry = {
                "iteration": iteration,
                "cost": float(reached if accepted else cost),
                "damping": damping,
                "step": float(length),
                "accepted": accepted,
            }
            history.append(entry)
            if say:
                say("adjusting: iteration", iteration, result=entry)
            if accepted:
                # Where a step has been refused, the next that keeps its promise proves nothing.
                kept = cost - reached > GOOD_GAIN_RATIO * 0.5 * (down + damping * square)
                end = kept and all(one["accepted"] for one in history)
                release = np.inf if end else min(release * CAREFUL_DIVISOR, DAMPING_DIVISOR)
                break
            damping = max(damping * raising, LEAST_DAMPING)
            raising, release = 2.0 * raising, CAREFUL_DIVISOR
            if damping > 1e8:
                raise StartFailed(
                    "no step lowers the residuals: the start values are too far off, check poses, "
                    "camera and the unit of the coordinates"
                )
            normal.assemble(state, damping, near)
            matrix = True
        state, cost, damping, near, last = trial, reached, relaxed, normal.modelled, length
        if done:
            return Solution(state, True, iteration, cost, history, factor)
    if equations:
        normal.assemble(state, 0.0, near)
    return Solution(state, False, max_iterations, cost, history)


def _points_at_rest(normal: Normal, state: State, damping: float) -> State:
    """The state just assembled with its points intersected anew, and assembled again.

    Where heights and focal length trade along a long bent valley, the points leave it first: one
    step of theirs alone brings them back to its floor.
    """
    p = normal.problem
    points, *_ = normal.substitute(
        state, 0.0, np.zeros((p.image_count, p.d)), np.zeros(p.shared_count)
    )
    state = replace(state, points=points)
    normal.assemble(state, damping, normal.modelled)
    return state


def _at_rest(system: Bordered, shared: np.ndarray, tolerance: float) -> bool:
    """Whether no shared unknown moved by more than this share of its standard deviation."""
    sigma = np.sqrt(np.diag(system.shared_inverse()))
    return bool(np.all(np.abs(shared) <= tolerance * sigma))


def _step(system: Bordered, normal: Normal):
    count = normal.problem.exposure_count
    right, reference = (one[:count].ravel() for one in (normal.gradient, normal.reference))
    step, shared = system.solve(right[:, None], normal.shared_gradient[:, None])
    step, shared = step[:, 0], shared[:, 0]
    down = float(step @ right + shared @ normal.shared_gradient)
    square = float(step**2 @ reference + shared**2 @ normal.shared_reference)
    return normal.step_of_images(step), shared, down, square
