"""The likelihood of the noise of the GNSS against its definition, at every size."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import find
from corridor.core.simulation import add_noise
from corridor.diagnosis.noise.gnss import stated_noise
from corridor.diagnosis.noise.likelihood import Arguments, derivatives, estimate, value_of
from corridor.diagnosis.system.elimination import Elimination, Static, rows_of
from corridor.diagnosis.system.equations import equations

SLUGS = ["gnss_bias", "rolling_shutter", "row_polynomial", "rolling_shutter_rotation"]


@pytest.fixture(scope="module")
def seen():
    """Two flights; a bias, and values for each image, in the model."""
    block = corridor_block(
        images=24, strips=4, flights=2, observations_per_image=60, control=4, seed=3
    )
    block = add_noise(block, tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.005, seed=3)
    e = equations(corridor.adjust(block), [find(slug) for slug in SLUGS], {})
    groups = {group.key: group for group in e.groups}
    rows = rows_of(
        [(groups["gnss_bias"], 1.0), (groups["row_polynomial"], 0.5),
         (groups["rolling_shutter_rotation"], 0.3)]
    )  # fmt: skip
    arguments = Arguments(stated_noise(e.system))
    draw = np.random.default_rng(0).standard_normal(len(arguments.centre))
    return e, rows, arguments, arguments.centre + 0.1 * draw


def defined(e, made):
    """log p(data) by one dense matrix, the covariance of the antenna positions as it is defined."""
    covariance = np.zeros((len(e.stated),) * 2)
    for rows, f, axis in made.noise.blocks():
        covariance[np.ix_(rows, rows)] += sum(made.noise.parts(rows, f, axis))
    weight, J = np.linalg.inv(covariance), made.jacobian.toarray()
    lower = Static.of(e, [group for group, _ in made.rows]).matrix.toarray()
    priors = np.concatenate([np.zeros(len(e.first)), made.sizes**-2.0])
    N = lower + np.tril(lower, -1).T + np.diag(priors) + J.T @ weight @ J
    t, r = made._right + J.T @ weight @ made._residual, made._residual
    unit = 1.0 / np.sqrt(np.diag(N))
    logdet = np.linalg.slogdet(N * unit * unit[:, None])[1] - 2.0 * np.log(unit).sum()
    fit = 0.5 * (unit * t) @ np.linalg.solve(N * unit * unit[:, None], unit * t)
    prior = np.log(made.sizes).sum()
    noise = r @ weight @ r + np.linalg.slogdet(covariance)[1]
    return fit - 0.5 * logdet - prior - 0.5 * noise


def test_it_is_what_it_is_defined_as_and_so_is_its_slope(seen):
    e, rows, arguments, x = seen
    made = Elimination(e, arguments.noise_at(x), rows)
    assert made.log_probability == pytest.approx(defined(e, made), abs=1e-6)
    slope, curve = derivatives(made, arguments, x)
    step = 1e-4 * np.eye(len(x))

    def value(x):
        return value_of(Elimination(e, arguments.noise_at(x), rows), arguments, x)

    numbers = [(value(x + d) - value(x - d)) / 2e-4 for d in step]
    assert slope == pytest.approx(numbers, abs=1e-4 * np.abs(slope).max())
    assert np.linalg.eigvalsh(curve)[0] > 0.0


def test_the_most_likely_noise_is_so_near_by_too(seen):
    e, rows, arguments, x = seen
    found = estimate(e, rows, arguments)
    for near in np.random.default_rng(1).uniform(-0.3, 0.3, (6, len(x))):
        there = np.clip(found.x + near, arguments.low, arguments.high)
        made = Elimination(e, arguments.noise_at(there), rows)
        assert value_of(made, arguments, there) > found.value - 0.05
    again = estimate(e, rows, arguments, x)
    assert again.value == pytest.approx(found.value, abs=0.2)


def test_values_of_single_images_leave_the_antenna_no_weight_below_zero(seen):
    """A shutter is felt by the antenna alone where each image bends its rows as it likes."""
    e, *_ = seen
    made = Elimination(e, None, rows_of((group, 10.0) for group in e.groups))
    P = made.weight(np.eye(len(e.stated)))
    assert np.linalg.eigvalsh(P * e.stated * e.stated[:, None])[0] > -1e-6
