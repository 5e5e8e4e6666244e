"""The rows of a system that many sets of measurements meet at once."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import Design, Sets
from corridor.core.simulation import add_noise


@pytest.fixture(scope="module")
def system():
    block = corridor_block(images=18, strips=3, observations_per_image=60, control=5, seed=1)
    block = add_noise(block, tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.005, seed=1)
    found = corridor.adjust(block, effects=["rolling_shutter"]).system
    # Away from the solution, where nothing is zero.
    change = 1e-5 * np.random.default_rng(2).standard_normal(len(found.columns))
    return found.at(found.following(change))


def own(system, design):
    """What the system itself measured, less what it models: a set."""
    left, weight = system.residuals(), np.repeat(design.weight, 2)
    return Sets([weight * left.pixels.ravel()], left.control.reshape(-1, 1))


def of_gnss(system, left):
    """What antenna positions say, of which (k, 3) is left."""
    gnss = system.gnss
    return gnss.jacobian.T @ (gnss.sigma.reshape(-1, 1) ** -2.0 * left.reshape(-1, 1))


def test_what_the_measurements_say_is_what_the_system_says_and_its_step_satisfies_them(system):
    design = Design(system)
    sets, gnss = own(system, design), system.residuals().gnss.reshape(-1, 1)
    right = design.right(sets) + of_gnss(system, gnss) + system.right_of_priors[:, None]
    wanted = system.right[:, None]
    scale = np.sqrt(system.reference)[:, None]
    assert np.abs(wanted / scale).max() > 0.1
    assert np.abs((right - wanted) / scale).max() < 1e-9
    step = system.solve(wanted)
    left, *_ = design.back(sets, step)
    weight = system.columns.prior_weight[:, None]
    after = design.right(left) + of_gnss(system, gnss - system.gnss.jacobian @ step)
    after += system.right_of_priors[:, None] - weight * step
    assert np.abs(after / scale).max() < 1e-9


@pytest.mark.parametrize("count", [1, 8, 11])
def test_each_of_many_sets_is_met_as_if_alone(system, count):
    """Sets are taken eight at a time, the last eight filled up."""
    rng = np.random.default_rng(count)
    design = Design(system, kept=True, followed=[3, 5])
    (image,), control, _ = own(system, design)
    image = image + rng.standard_normal((count, len(image)))
    control = control + 0.01 * rng.standard_normal((len(control), count))
    step = 1e-3 * rng.standard_normal((len(system.columns), count))
    each = [Sets(image[[n]], control[:, [n]]) for n in range(count)]
    changed = Sets(image.copy(), control)
    right, (left, moved, square) = design.right(changed), design.back(changed, step)
    np.testing.assert_allclose(square, ((image - left.image) ** 2).sum(axis=1), rtol=1e-12)
    for n, some in enumerate(each):
        alone, (back, following, _) = design.right(some), design.back(some, step[:, [n]])
        np.testing.assert_allclose(right[:, [n]], alone, rtol=0, atol=1e-9 * np.abs(alone).max())
        np.testing.assert_allclose(left.image[[n]], back.image, rtol=0, atol=1e-9)
        np.testing.assert_allclose(left.control[:, [n]], back.control, rtol=0, atol=1e-12)
        np.testing.assert_allclose(moved[..., [n]], following, rtol=0, atol=1e-12)
