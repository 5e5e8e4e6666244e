"""The likelihood of the noise of the GNSS against its definition, and weights that are possible."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import find
from corridor.core.simulation import add_noise
from corridor.diagnosis.evidence.beside_noise import NoiseModel
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.noise.gnss import GnssNoise, Likelihood
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import equations

BOUNDS = ((1e-3, 1e3), (1e-3, 1e3), (1.0, 1e3))
# Of two flights: factors of the white part, of the slow one, and time constants, s.
X = np.log([1.3, 0.8, 1.1, 0.9, 1.2, 0.7, 0.5, 1.5, 0.4, 0.9, 0.6, 1.1, 20.0, 45.0])


@pytest.fixture(scope="module")
def seen():
    """Two flights whose epochs are listed across each other; a shift and a drift have gone."""
    rng = np.random.default_rng(4)
    flight, time = np.repeat([0, 1], 15)[(order := rng.permutation(30))], 2.0 * np.arange(30)[order]
    stated = rng.uniform(0.01, 0.03, 90)
    noise = GnssNoise(
        flight, time, stated, np.ones((2, 3)), np.zeros((2, 3)), np.full((2, 3), 30.0)
    )
    weight = np.diag(stated**-2.0)
    gone = np.kron(np.column_stack([np.ones(30), time]), np.eye(3))
    inside = np.linalg.inv(gone.T @ weight @ gone)
    P = weight - weight @ gone @ inside @ gone.T @ weight
    return noise, P, P @ (1.5 * stated * rng.standard_normal(90))


def defined(noise, P, rho):
    """-2 log L and D (I + P D)^-1 rho, as the formula has them."""
    D = -np.diag(noise.stated**2)
    for rows, f, axis in noise.blocks():
        D[np.ix_(rows, rows)] += sum(noise.parts(rows, f, axis))
    inner = np.eye(len(P)) + P @ D
    moved = D @ np.linalg.solve(inner, rho)
    return np.linalg.slogdet(inner)[1] - rho @ moved, moved


def test_it_is_what_it_is_defined_as_and_so_is_its_slope(seen):
    noise, P, rho = seen
    one = Likelihood(noise, P, rho, list(noise.blocks()), bounds=BOUNDS)
    value, slope = one(X)
    wanted, moved = defined(one.noise_at(X, noise), P, rho)
    # P has no inverse: what it does not know weighs a ten millionth of what is stated.
    assert value == pytest.approx(one.value(X), abs=1e-8)
    assert value == pytest.approx(wanted, abs=1e-3)
    solved = one.solved(one.noise_at(X, noise), rho[:, None])[:, 0]
    assert np.abs(solved - moved).max() < 1e-4 * np.abs(moved).max()
    step = 1e-5
    numbers = [
        (one.value(X + step * e) - one.value(X - step * e)) / (2 * step) for e in np.eye(len(X))
    ]
    assert np.abs(slope - numbers).max() < 1e-4 * np.abs(slope).max()


def test_what_an_approximation_took_too_much_of_is_nothing(seen):
    noise, P, rho = seen
    scale = noise.stated[:, None] * noise.stated
    value, vector = np.linalg.eigh(P * scale)
    beyond, nothing = value.copy(), value.copy()
    beyond[-1], nothing[-1] = -16.0, 0.0
    blocks = list(noise.blocks())
    wrong, clipped = (
        Likelihood(noise, (vector * v) @ vector.T / scale, rho, blocks, bounds=BOUNDS)
        for v in (beyond, nothing)
    )
    assert wrong.value(X) == pytest.approx(clipped.value(X), abs=1e-3)


def test_values_of_single_images_leave_the_antenna_no_weight_below_zero():
    """A shutter is felt by the antenna alone where each image bends its rows as it likes."""
    block = corridor_block(images=24, strips=3, observations_per_image=80, control=4, seed=3)
    block = add_noise(block, tie_px=0.4, mark_px=0.4, gnss_m=0.02, control_m=0.005, seed=3)
    e = equations(corridor.adjust(block), [find("rolling_shutter"), find("row_polynomial")], {})
    stated = Elimination(e, None)
    noises = NoiseModel(e.system, stated.antennas(), Evidence(stated.reduced()))
    _, P, _ = noises._left(dict.fromkeys(range(len(e.groups)), 10.0))
    sigma = noises.stated.stated
    assert np.linalg.eigvalsh(P.toarray() * sigma * sigma[:, None])[0] > -1e-6
