"""All effects at once: the fused kernel against the forward model and against dense algebra."""

from dataclasses import replace

import numpy as np
import pytest

import corridor
from corridor.adjustment.normal import Loss, Normal, moved_state, shared_values
from corridor.adjustment.problem import make_problem
from corridor.effects import add, catalogue, predict
from corridor.effects.forward import gather
from corridor.simulation import add_noise, corridor_block
from corridor.simulation.strips import CAMLIGHT

EVERY = [effect.slug for effect in catalogue()]


def flown(images=10, observations=60, seed=8, **options):
    camera = replace(CAMLIGHT, readout_s=0.030, calibrated=True)
    return corridor_block(
        images=images, strips=2, flights=2, camera=camera, observations_per_image=observations,
        relief=6.0, interval_s=1.0, angular_rate_deg_s=3.0, seed=seed, **options,
    )  # fmt: skip


def at_scale(block, slugs):
    """Values (groups, parameters) of every effect, of the size it states, signs mixed."""
    rng = np.random.default_rng(1)
    stack, start = gather(block, {slug: {} for slug in slugs})
    return {
        slug: rng.uniform(0.5, 1.5, start[slug].shape)
        * rng.choice([-1, 1], start[slug].shape)
        * [parameter.scale for parameter in stack.members[slug].parameters]
        for slug in slugs
    }


def started(problem, values):
    """The problem's start state with effects switched on; images are in the problem's order."""
    state = problem.start
    for slug, given in values.items():
        own = problem.stack.members[slug].effect.group == "image"
        state.effects[slug][:] = given[problem.order] if own else given
    return state


@pytest.mark.parametrize("slugs", [[slug] for slug in EVERY] + [EVERY], ids="+".join)
def test_the_fused_kernel_models_what_the_forward_model_predicts(slugs):
    """To 1e-9 px and 1e-12 m, row for row; the kernel sorts, chunks and iterates on its own."""
    block = flown(start_error=(0.05, 0.001, 0.05))
    values = at_scale(block, slugs)
    problem = make_problem(block, camera="fixed", effects=slugs)
    state = started(problem, values)
    normal = Normal(problem, Loss())
    residual, behind = normal.look(state, passes=15)
    assert behind == 0
    modelled = predict(block, values)
    measured = np.concatenate([block.tie_points[["x", "y"]], block.marks[["x", "y"]]])
    expected = measured - np.concatenate([modelled.tie, modelled.mark])
    control = (block.ground["role"] == "control").to_numpy()
    assert len(problem.row) == len(measured)
    assert np.abs(residual - expected[problem.row]).max() < 1e-9
    images = normal.view(state).images
    antenna = normal.antenna(state, images)[0]
    assert np.abs(antenna - modelled.gnss).max() < 1e-12
    given = block.ground.loc[control, ["x", "y", "z"]].to_numpy()
    assert normal.view(state).control_residual == pytest.approx(given - modelled.control, abs=1e-12)


@pytest.mark.parametrize("slug", EVERY)
def test_effects_at_zero_leave_the_kernels_residuals_as_they_are_bit_for_bit(slug):
    block = add_noise(flown(), tie_px=0.3, seed=3)
    plain, _ = Normal(p := make_problem(block, camera="fixed"), Loss()).look(p.start)
    with_it, _ = Normal(p := make_problem(block, camera="fixed", effects=[slug]), Loss()).look(
        p.start
    )
    assert np.array_equal(plain, with_it)


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
        pose = np.r_[[1e-4] * 3, [1e-6] * 3, [1e-7] * (p.d - 6)]
        step = np.full(p.unknown_count, 1e-4)
        step[: self.first] = np.tile(pose, p.image_count)
        step[self.border] = 1e-3 * np.sqrt(np.diag(found.covariance.shared))
        jacobian = np.stack(
            [
                (self.residuals(h * axis) - self.residuals(-h * axis)) / (2 * h)
                for h, axis in zip(step, np.eye(p.unknown_count), strict=True)
            ],
            axis=1,
        )
        matrix = jacobian.T @ jacobian
        matrix[self.border, self.border] += np.diag(p.prior_weight)
        size = np.sqrt(np.diag(matrix))
        self.inverse = np.linalg.inv(matrix / size[:, None] / size) / size[:, None] / size
        self.sigma = np.sqrt(np.diag(self.inverse))
        self.gradient = jacobian.T @ self.residuals(np.zeros(p.unknown_count))
        self.gradient[self.border] += p.prior_weight * (
            shared_values(p, self.state) - p.prior_value
        )

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
        pixels, _ = self.normal.look(state, passes=15)
        view = self.normal.view(state)
        images, control = view.images, view.control_residual
        antenna = p.gnss_given - self.normal.antenna(state, images)[0]
        parts = (
            pixels * np.broadcast_to(p.weight, len(pixels))[:, None],
            antenna * np.sqrt(p.gnss_weight),
            control * np.sqrt(p.control_weight),
        )
        return np.concatenate([part.ravel() for part in parts])


@pytest.mark.parametrize("slugs", [[slug] for slug in EVERY] + [EVERY], ids="+".join)
def test_adjusted_values_and_sigmas_are_those_of_numeric_dense_least_squares(slugs):
    """The gradient vanishes at the solution, and every sigma is that of the dense inverse.

    The step that is left is below the adjustment's own tolerance; the sigmas agree to rounding
    of the numeric Jacobian, also where the row of a point depends on what moves it.
    """
    block = flown(images=6, observations=24, control=4, check=2)
    values = at_scale(block, slugs)
    block = add_noise(
        add(block, values), tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.01, seed=4
    )
    chosen = [effect for effect in catalogue() if effect.slug in slugs]
    # All of them at once are weak: held by what one expects of each.
    priors = {
        f"{effect.slug}.{parameter.name}": (0.0, 10 * parameter.scale)
        for effect in chosen
        for parameter in effect.parameters(block)
        if len(slugs) > 1 and effect.group != "image"
    }
    found = corridor.adjust(block, camera="fixed", effects=slugs, lever_arm="fixed", priors=priors)
    assert found.converged
    dense = Dense(found)
    step = dense.inverse @ dense.gradient
    assert np.abs(step / dense.sigma).max() < 1e-4
    ours = np.concatenate(
        [
            np.sqrt(np.einsum("nii->ni", found.covariance.each_pose)).ravel(),
            np.sqrt(np.diag(found.covariance.shared)),
            found.point_sigma.ravel() / found.sigma0,
        ]
    )
    assert np.abs(ours / dense.sigma - 1).max() < 1e-7
