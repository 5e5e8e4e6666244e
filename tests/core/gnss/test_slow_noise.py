"""The Gauss-Markov process against its own covariance."""

import numpy as np
import pytest

from corridor.core.gnss import SlowNoise


def test_draws_have_the_covariance_that_is_stated():
    """20,000 draws at uneven times: correlations to 1/sqrt(20,000), four times."""
    time = np.array([0.0, 5.0, 7.0, 30.0])
    noise = SlowNoise(20.0)
    drawn = noise.draw(time, np.random.default_rng(1), axes=20_000)
    assert drawn @ drawn.T / 20_000 == pytest.approx(noise.correlation(time), abs=0.03)


def test_each_flight_begins_anew_in_whatever_order_its_epochs_come():
    """Two flights at the same times: each correlates with itself as stated, and not at all."""
    time, flight = np.array([10.0, 0.0, 0.0, 10.0]), np.array([0, 1, 0, 1])
    noise = SlowNoise(10.0)
    drawn = noise.draw(time, np.random.default_rng(2), axes=20_000, flight=flight)
    expected = noise.correlation(time) * (flight[:, None] == flight)
    assert drawn @ drawn.T / 20_000 == pytest.approx(expected, abs=0.03)
