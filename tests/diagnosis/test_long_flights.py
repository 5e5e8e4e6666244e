"""Flights of many hundred images: what grows faster than they do is taken in pieces of them."""

import numpy as np
import pytest

from corridor.core.gnss import SlowNoise
from corridor.diagnosis.evidence.evidence import Spectrum
from corridor.diagnosis.noise.gnss import GnssNoise, estimate
from corridor.diagnosis.settings import changed
from corridor.diagnosis.system.elimination import Pieces

WHITE, SLOW, CONSTANT = 0.7, 0.03, 25.0


def positions(count, seed):
    """Positions of one flight that the images know exactly: stated noise, P and rho."""
    draw = np.random.default_rng(seed)
    time = 2.0 * draw.permutation(count)
    stated = np.full(3 * count, 0.02)
    slow = SlowNoise(CONSTANT).draw(time, draw, axes=3)
    error = WHITE * 0.02 * draw.standard_normal((count, 3)) + SLOW * slow
    noise = GnssNoise(
        np.zeros(count, dtype=int), time, stated,
        np.ones((1, 3)), np.zeros((1, 3)), np.full((1, 3), 60.0),
    )  # fmt: skip
    weight = stated**-2.0
    return noise, np.diag(weight), weight * error.ravel()


def test_noise_of_a_long_flight_is_the_same_in_pieces_as_in_one():
    """Pieces of 120 of 360 positions, 10 time constants each, axis by axis."""
    noise, P, rho = positions(360, 1)
    with changed(most_at_a_time=120):
        pieces, _ = estimate(noise, P, rho)
    with changed(most_at_a_time=10_000):
        whole, _ = estimate(noise, P, rho)
    assert pieces.white == pytest.approx(whole.white, rel=0.02)
    assert pieces.coloured == pytest.approx(whole.coloured, rel=0.04)
    assert pieces.tau == pytest.approx(whole.tau, rel=0.1)


def test_a_spectrum_in_pieces_says_what_the_whole_one_says_where_images_share_little():
    """Of 40 images with 5 values each, neighbours correlated as 0.3 to 1, ten images a piece."""
    draw = np.random.default_rng(4)
    near = 0.3 ** np.abs(np.subtract.outer(np.arange(40), np.arange(40)))
    M = np.kron(near, np.diag([30.0, 10.0, 3.0, 1.0, 0.3]))
    g = np.linalg.cholesky(M) @ draw.standard_normal(200)
    whole, pieces = (
        Spectrum.of(Pieces([M[at : at + most, at : at + most] for at in range(0, 200, most)]))
        for most in (200, 50)
    )
    gains = [one.log_bayes(one.vector.T @ g) for one in (whole, pieces)]
    assert sorted(pieces.value) != pytest.approx(sorted(whole.value), rel=1e-3)
    assert gains[1] == pytest.approx(gains[0], rel=0.03, abs=0.5)
