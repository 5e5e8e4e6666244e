"""The smoother against Gaussian conditioning written down without filter or state."""

import numpy as np
import pytest
from scipy.integrate import quad

from corridor.core.gnss.interpolation.regimes import Axis, Epochs, Model, kept, split, staircase
from corridor.core.gnss.interpolation.smoother import smooth

GUST, JERK, CORRELATION = 0.03, 0.5, 20.0


def prior(s, t):
    """Covariance of the position at times s and t: wide start, gusts, jerk, from time 0."""
    gusts, _ = quad(lambda u: (s - u) * (t - u), 0, min(s, t))
    jerk, _ = quad(lambda u: (s - u) ** 2 * (t - u) ** 2 / 4, 0, min(s, t))
    start = 100.0**2 + 50.0**2 * s * t + 10.0**2 * s**2 * t**2 / 4
    return start + GUST * gusts + JERK * jerk


def matrix(first, second, of):
    return np.array([[of(s, t) for t in second] for s in first])


def conditioned(time, z, sigma, share, at):
    """Mean and sigma of the position at times `at`, given noisy z (n,)."""

    def noise(k, m):
        slow = share * sigma**2 * np.exp(-abs(time[k] - time[m]) / CORRELATION)
        return slow + (1 - share) * sigma**2 * (k == m)

    index = range(len(time))
    observed = matrix(time, time, prior) + matrix(index, index, noise)
    across = matrix(at, time, prior)
    gain = np.linalg.solve(observed, across.T).T
    return gain @ z, np.sqrt(np.diag(matrix(at, at, prior) - gain @ across.T))


def made(time, z, sigma, share, velocity=None, velocity_sigma=None):
    n = len(time)
    axis = Axis(GUST, share, 1.0, velocity_sigma)
    epochs = Epochs(
        time,
        np.repeat(z[:, None], 3, axis=1),
        np.full((n, 3), sigma),
        np.full((n, 3), sigma),
        np.zeros((n, 3)),
        True,
        velocity,
        None,
    )
    return epochs, Model((axis,) * 3, np.full((n, 3), GUST), np.full((n, 3), JERK), CORRELATION)


@pytest.fixture
def scene():
    rng = np.random.default_rng(5)
    time = np.array([0.0, 1.0, 2.0, 2.2, 4.5, 5.0, 6.0, 7.1])
    return time, np.cumsum(rng.normal(size=len(time))) - 1.0


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_position_and_sigma_are_those_of_the_conditioned_process(scene, share):
    time, z = scene
    z = z - z[0]
    at = np.array([0.0, 0.4, 1.0, 1.5, 2.1, 3.3, 4.9, 7.05, 7.1])
    position, sigma, *_ = smooth(*(lambda e, m: (e, at, m))(*made(time, z, 0.05, share)))
    mean, spread = conditioned(time, z, 0.05, share, at)
    # The dense matrices hold numbers from 1e-3 to 1e6: ten digits are left of sixteen.
    assert position == pytest.approx(np.repeat(mean[:, None], 3, axis=1), abs=2e-5)
    assert sigma == pytest.approx(np.repeat(spread[:, None], 3, axis=1), rel=2e-3)


def test_the_velocity_is_the_derivative_of_the_position(scene):
    time, z = scene
    epochs, model = made(time, z - z[0], 0.05, 0.3)
    at, h = np.array([0.5, 1.7, 3.0, 5.5]), 1e-4
    after, *_ = smooth(epochs, at + h, model)
    before, *_ = smooth(epochs, at - h, model)
    _, _, velocity, _ = smooth(epochs, at, model)
    assert velocity == pytest.approx((after - before) / (2 * h), abs=1e-5)


def test_the_sigma_is_smallest_at_epochs_and_largest_between(scene):
    time, z = scene
    epochs, model = made(time, z, 0.01, 0.0)
    at = np.linspace(2.2, 4.5, 21)
    _, sigma, *_ = smooth(epochs, at, model)
    assert np.argmax(sigma[:, 0]) in (9, 10, 11)
    assert sigma[0, 0] < 0.01 and sigma[10, 0] > 5 * sigma[0, 0]


def test_a_velocity_observed_narrows_the_gap(scene):
    time, z = scene
    epochs, model = made(time, z, 0.01, 0.0)
    velocity = np.repeat(np.gradient(z, time)[:, None], 3, axis=1)
    told, with_velocity = made(time, z, 0.01, 0.0, velocity, 0.02)
    at = np.array([3.3])
    one, other = smooth(told, at, with_velocity)[1], smooth(epochs, at, model)[1]
    assert (one < 0.8 * other).all()


def test_an_unknown_velocity_is_none(scene):
    time, z = scene
    velocity = np.full((len(time), 3), np.nan)
    told, with_velocity = made(time, z, 0.01, 0.0, velocity, 0.02)
    epochs, model = made(time, z, 0.01, 0.0)
    at = np.array([0.3, 3.3])
    for one, other in zip(smooth(told, at, with_velocity), smooth(epochs, at, model), strict=True):
        assert np.array_equal(one, other)


class TestTheSlowError:
    def test_a_standing_antenna_is_known_no_better_than_it_allows(self):
        """Two minutes, correlated over twenty seconds: some six independent errors, not 600."""
        time = np.arange(0, 120, 0.2)
        n = len(time)
        epochs, model = made(time, np.zeros(n), 0.01, 0.98)
        model = model._replace(gusts=np.zeros((n, 3)), jerks=np.full((n, 3), 1e-12))
        _, sigma, *_ = smooth(epochs, np.array([60.0]), model)
        # Mean of a Gauss-Markov process over T = 6 correlation times:
        # variance 2/6 - 2/36 (1 - exp(-6)) = 0.278; the fitted curve knows less than the mean.
        assert sigma[0, 0] > np.sqrt(0.278 * 0.98) * 0.01

    def test_a_printed_digit_of_the_sigmas_does_not_tell_of_it(self):
        sigma = np.tile([0.005], (200, 3))
        sigma[50:] = 0.006
        sigma[::7] = 0.006
        time = 0.2 * np.arange(200)
        assert (np.ptp(staircase(sigma, time), axis=0) == 0).all()

    def test_it_starts_anew_in_part_where_fixed_becomes_float(self):
        sigma = np.full((300, 3), 0.01)
        sigma[100:200] = 0.2
        slow = staircase(sigma, np.arange(300.0))[:, 0]
        assert set(slow) == {0.01, 0.2}
        left = kept(slow)
        assert left[[100, 200]] == pytest.approx([0.05, 0.05])
        assert (np.delete(left, [100, 200]) == 1).all()

    def test_what_float_has_on_top_of_fixed_is_told_apart(self):
        sigma = np.full((300, 3), 0.01)
        sigma[100:150] = 0.2
        usual, excess = split(sigma, np.arange(300.0))
        assert (usual == 0.01).all()
        assert excess[[99, 100, 149, 150], 0] == pytest.approx([0, 0.19975, 0.19975, 0], abs=1e-5)
