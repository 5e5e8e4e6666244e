"""All effects at once: the fused kernel against the forward model and against dense algebra."""

from functools import cached_property

import numpy as np
import pytest
from strips import CAMLIGHT
from with_effects import EVERY, OF_RIGS, ONE, at_scale, flown, started

import corridor
from corridor.core.adjustment.measured_poses import residuals
from corridor.core.adjustment.normal import Loss, Normal, moved_state, shared_values
from corridor.core.adjustment.problem import make_problem
from corridor.core.adjustment.rigs import rig_rows
from corridor.core.adjustment.solving import SHARED_STEP
from corridor.core.effects import add, every_effect, predict
from corridor.core.geometry import vector_from_rotation
from corridor.core.simulation import add_noise

NAMED = [effect.slug for effect in every_effect() if not effect.generic and effect.slug in ONE]


def named(slugs):
    return slugs[0] if len(slugs) == 1 else f"{len(slugs)}_at_once"


@pytest.mark.parametrize("slugs", [[slug] for slug in EVERY] + [ONE], ids=named)
def test_the_fused_kernel_models_what_the_forward_model_predicts(slugs):
    """To 1e-9 px and 1e-12 m, row for row; the kernel sorts, chunks and iterates on its own."""
    block = flown(slugs, start_error=(0.05, 0.001, 0.05))
    values = at_scale(block, slugs)
    problem = make_problem(block, camera="fixed", effects=slugs)
    state = started(problem, values)
    normal = Normal(problem, Loss())
    residual, behind = normal.residuals(state)
    assert behind == 0
    modelled = predict(block, values)
    measured = np.concatenate([block.tie_points[["x", "y"]], block.marks[["x", "y"]]])
    expected = measured - np.concatenate([modelled.tie, modelled.mark])
    control = (block.ground["role"] == "control").to_numpy()
    assert len(problem.row) == len(measured)
    assert np.abs(residual - expected[problem.row]).max() < 1e-9
    images = normal.view(state).images
    antenna = residuals("gnss", problem, state, images)
    assert np.abs(antenna - (problem.gnss_given - modelled.gnss)).max() < 1e-12
    left = np.zeros((problem.image_count, 3))
    left[problem.attitude_image] = residuals("attitude", problem, state, images)
    measured = block.attitude_rotations @ modelled.attitude.transpose(0, 2, 1)
    turn = np.linalg.norm(vector_from_rotation(measured), axis=1)
    assert np.linalg.norm(left, axis=1) == pytest.approx(turn[problem.order], abs=1e-12)
    given = block.ground.loc[control, ["x", "y", "z"]].to_numpy()
    assert normal.view(state).control_residual == pytest.approx(given - modelled.control, abs=1e-12)


@pytest.mark.parametrize("slug", EVERY)
def test_effects_at_zero_leave_the_kernels_residuals_as_they_are(slug):
    """To the rounding of a picture coordinate: the kernel is compiled anew for what moves, and
    processors that multiply and add in one step round otherwise."""
    block = add_noise(flown([slug]), tie_px=0.3, seed=3)
    plain, _ = Normal(p := make_problem(block, camera="fixed"), Loss()).residuals(p.start)
    with_it, _ = Normal(p := make_problem(block, camera="fixed", effects=[slug]), Loss()).residuals(
        p.start
    )
    assert np.abs(with_it - plain).max() <= 2 * np.spacing(float(CAMLIGHT.width))


class Dense:
    """The same least squares at a solution, without a single analytic derivative.

    The Jacobian of all weighted residuals is by central differences through the forward pass,
    with the modelled rows at rest; the normal equations are inverted whole.
    """

    def __init__(self, found):
        self.problem, self.state = found.problem, found.state
        self.normal = Normal(self.problem, Loss())
        p = self.problem
        self.first = p.image_count * p.d
        self.border = slice(self.first, self.first + p.shared_count)
        members = p.stack.members
        of_images = [1e-3 * members[slug].parameters[n].scale for slug, n in p.per_image_unknowns]
        pose = np.r_[[1e-4] * 3, [1e-6] * 3, of_images]
        step = np.full(p.unknown_count, 1e-4)
        step[: self.first] = np.tile(pose, p.image_count)
        step[self.border] = 1e-3 * np.sqrt(np.diag(found.covariance.shared))
        jacobian = np.zeros((len(self.residuals(0 * step)), p.unknown_count))
        for k in range(self.border.stop):
            jacobian[:, k] = self.by(step[k] * np.eye(p.unknown_count)[k]) / step[k]
        # A residual knows one point at most: all points move at once.
        for axis in range(3):
            moved = self.border.stop + np.arange(axis, 3 * len(p.ptr[1:]), 3)
            change = self.by(1e-4 * np.isin(np.arange(p.unknown_count), moved)) / 1e-4
            rows = np.flatnonzero(self.owner >= 0)
            jacobian[rows, moved[self.owner[rows]]] = change[rows]
        # These weigh so much that rounding of differences would show (tested in test_rigs).
        hung = rig_rows(p, self.state)
        rows = len(jacobian) - 6 * len(p.rig_image) + np.arange(6 * len(p.rig_image)).reshape(-1, 6)
        for image, by in ((p.rig_image[:, 0], hung.first), (p.rig_image[:, 1], hung.second)):
            at = p.d * image[:, None] + np.arange(6)
            jacobian[rows[:, :, None], at[:, None]] = -np.sqrt(hung.weight)[:, None] * by
        weight, away = np.zeros((2, p.unknown_count))
        weight[self.border] = p.prior_weight
        away[self.border] = shared_values(p, self.state) - p.prior_value
        priors = zip(p.per_image_unknowns, p.per_image_prior[0].T, strict=True)
        own = [self.state.effects[slug][:, number] - value for (slug, number), value in priors]
        for given, values in ((weight, p.per_image_prior[1]), (away, np.array(own).T)):
            given[: self.first].reshape(p.image_count, p.d)[:, 6:] = values if own else 0.0
        matrix = jacobian.T @ jacobian + np.diag(weight)
        size = np.sqrt(np.diag(matrix))
        self.inverse = np.linalg.inv(matrix / size[:, None] / size) / size[:, None] / size
        self.sigma = np.sqrt(np.diag(self.inverse))
        self.gradient = jacobian.T @ self.residuals(np.zeros(p.unknown_count)) + weight * away

    @cached_property
    def owner(self):
        """The point that each weighted residual belongs to, -1 where none."""
        p = self.problem
        rays = np.repeat(np.arange(len(p.ptr) - 1), np.diff(p.ptr))
        control = np.empty(len(p.control_rows), dtype=int)
        control[p.control[p.control >= 0]] = np.flatnonzero(p.control >= 0)
        antenna = np.full(3 * len(p.gnss_image), -1)
        poses = np.full(3 * len(p.attitude_image) + 6 * len(p.rig_image), -1)
        return np.concatenate([rays.repeat(2), antenna, control.repeat(3), poses])

    def by(self, step):
        """Half the difference of the residuals after a step and after its opposite."""
        return (self.residuals(step) - self.residuals(-step)) / 2

    def residuals(self, x):
        """Weighted residuals after the step x: images, border, points."""
        p = self.problem
        state = moved_state(
            p,
            self.state,
            x[: self.first].reshape(p.image_count, p.d),
            x[self.border],
            self.state.points + x[self.border.stop :].reshape(-1, 3),
        )
        pixels, _ = self.normal.residuals(state)
        view = self.normal.view(state)
        images, control = view.images, view.control_residual
        parts = (
            pixels * np.broadcast_to(p.weight, len(pixels))[:, None],
            residuals("gnss", p, state, images) * np.sqrt(p.gnss_weight),
            control * np.sqrt(p.control_weight),
            residuals("attitude", p, state, images) * np.sqrt(p.attitude_weight),
            rig_rows(p, state).residual * np.sqrt(rig_rows(p, state).weight),
        )
        return np.concatenate([part.ravel() for part in parts])


# Kernels of their own, which compile for seconds, or a hundred columns; and the same effect in
# other groups.
LONG = {
    "motion_per_image", "water_refraction", "focal_per_image", "image_deformation",
    "image_deformation_over_time", "image_steps", "gnss_spline",
} | {effect.slug for effect in every_effect() if effect.refines}  # fmt: skip


def each():
    for slugs in [[slug] for slug in EVERY] + [NAMED]:
        long = len(slugs) > 1 or slugs[0] in LONG
        yield pytest.param(slugs, id=named(slugs), marks=[pytest.mark.slow] * long)


@pytest.mark.parametrize("slugs", list(each()))
def test_adjusted_values_and_sigmas_are_those_of_numeric_dense_least_squares(slugs):
    """The gradient vanishes at the solution, and every sigma is that of the dense inverse.

    The step that is left is below what the solver promises (`SHARED_STEP`); sigmas agree to
    rounding of the numeric Jacobian, also where the row of a point depends on what moves it. How
    effects on the image change across the picture is known by steps of a pixel, a thousandth of it.
    That given heights which lean depend on where the point is, by that slope, is left out.
    That a shift in the camera's frame, here of centimetres at 60 m, turns with the image is left
    out. Members of a rig hang together exactly, and to a micrometre in the dense equations: beside
    sigmas of a millimetre half a millionth.
    """
    block = flown(slugs, images=6, observations=24, control=4, check=2)
    values = at_scale(block, slugs)
    block = add_noise(
        add(block, values),
        tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.01, attitude_deg=0.02, seed=4,
    )  # fmt: skip
    chosen = [effect for effect in every_effect() if effect.slug in slugs]
    # Six images are too few for many: held by what one expects of each.
    priors = {
        f"{effect.slug}.{parameter.name}": (0.0, 10 * parameter.scale)
        for effect in chosen
        for parameter in effect.parameters(block)
    }
    found = corridor.adjust(block, camera="fixed", effects=slugs, lever_arm="fixed", priors=priors)
    assert found.converged
    dense = Dense(found)
    step = dense.inverse @ dense.gradient
    sloping = any(effect.place == "image" for effect in chosen)
    shifted = any(effect.believed(block) for effect in chosen) and slugs[0] in OF_RIGS
    assert np.abs(step / dense.sigma).max() < (2 if shifted else 1) * SHARED_STEP
    ours = np.concatenate(
        [
            np.sqrt(np.einsum("nii->ni", found.covariance.each_pose)).ravel(),
            np.sqrt(np.diag(found.covariance.shared)),
            found.point_sigma.ravel() / found.sigma0,
        ]
    )
    leaning = any(effect.slug == "control_tilt" for effect in chosen)
    hanging = len(found.problem.rig_image)
    limit = 1e-3 if shifted or leaning else 1e-5 if sloping else 2e-6 if hanging else 1e-7
    assert np.abs(ours / dense.sigma - 1).max() < limit
