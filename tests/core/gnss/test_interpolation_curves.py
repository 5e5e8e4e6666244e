"""The curves that other programs draw, against arithmetic."""

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from corridor.core.gnss import interpolate
from corridor.core.gnss.interpolation import polynomials

TIME = np.array([0.0, 1.0, 2.5, 3.0, 4.2, 5.0, 6.0, 7.0, 8.5, 9.0])
AT = np.array([0.0, 0.3, 0.5, 1.7, 2.5, 4.9, 8.9, 9.0])


def values(of):
    return np.column_stack([of(TIME), -of(TIME), 0 * TIME])


@pytest.mark.parametrize("method", polynomials.CURVES)
def test_every_curve_goes_through_the_epochs_and_along_a_line(method):
    got, slope = polynomials.CURVES[method](TIME, values(lambda t: 3 * t - 2), AT)
    assert got[:, 0] == pytest.approx(3 * AT - 2)
    assert slope[:, 1] == pytest.approx(-3.0)
    scattered = np.random.default_rng(1).normal(size=(len(TIME), 3))
    through, _ = polynomials.CURVES[method](TIME, scattered, TIME)
    assert through == pytest.approx(scattered)


def test_linear_between_the_two_epochs_around():
    got, _ = polynomials.linear(TIME, values(np.square), np.array([1.75]))
    assert got[0, 0] == pytest.approx((1 + 2.5**2) / 2)


def test_the_parabola_is_exact_on_a_parabola():
    got, slope = polynomials.parabola(TIME, values(lambda t: t * t - t), AT)
    assert got[:, 0] == pytest.approx(AT**2 - AT)
    assert slope[:, 0] == pytest.approx(2 * AT - 1)


def test_the_parabola_takes_the_three_nearest_epochs_as_micmac_does():
    """Centre: the nearest epoch. At 1.6 it is 1.0 (0.6 off, 2.5 is 0.9 off), at 1.9 it is 2.5."""
    z = values(lambda t: np.sin(3 * t))
    for at, rows in ((1.6, [0, 1, 2]), (1.9, [1, 2, 3]), (0.1, [0, 1, 2]), (8.9, [7, 8, 9])):
        fitted = np.polyval(np.polyfit(TIME[rows], z[rows, 0], 2), at)
        got, _ = polynomials.parabola(TIME, z, np.array([at]))
        assert got[0, 0] == pytest.approx(fitted)


@pytest.mark.parametrize(
    ("method", "scipy"), [("spline", CubicSpline), ("pchip", PchipInterpolator)]
)
def test_the_cubics_are_those_of_scipy(method, scipy):
    z = values(np.sin)
    assert polynomials.CURVES[method](TIME, z, AT)[0] == pytest.approx(scipy(TIME, z)(AT))


class TestPropagatedSigma:
    sigma = np.full((len(TIME), 3), 0.01)

    def at(self, method, time):
        return polynomials.propagated(method, TIME, values(np.sin), self.sigma, np.array([time]))[
            0, 0
        ]

    @pytest.mark.parametrize("method", polynomials.CURVES)
    def test_at_an_epoch_it_is_that_of_the_epoch(self, method):
        assert self.at(method, 3.0) == pytest.approx(0.01, rel=1e-6)

    def test_linear_in_the_middle_is_less_by_root_two(self):
        assert self.at("linear", 1.75) == pytest.approx(0.01 / np.sqrt(2))

    def test_the_parabola_s_is_from_lagrange_s_weights(self):
        t, (a, b, c) = 5.4, (4.2, 5.0, 6.0)
        weights = [
            (t - b) * (t - c) / ((a - b) * (a - c)),
            (t - a) * (t - c) / ((b - a) * (b - c)),
            (t - a) * (t - b) / ((c - a) * (c - b)),
        ]
        assert self.at("parabola", t) == pytest.approx(0.01 * np.linalg.norm(weights))

    def test_the_spline_s_is_from_all_its_weights(self):
        time = np.arange(30.0)
        weights = CubicSpline(time, np.eye(30))(14.3)
        got = polynomials.propagated(
            "spline", time, np.zeros((30, 3)), np.full((30, 3), 0.01), np.array([14.3])
        )
        # What lies more than six epochs away weighs less than 0.27 to the power of six, 4e-4.
        assert got[0, 0] == pytest.approx(0.01 * np.linalg.norm(weights), rel=4e-4)


def test_without_sigmas_a_curve_states_none_and_refuses_nothing():
    track = pd.DataFrame({"time_s": TIME, "x": TIME, "y": 0.0, "z": 0.0})
    table = interpolate(track, AT, "parabola").table
    assert table["sx"].isna().all() and (table["why"] == "").all()
    assert table["x"].to_numpy() == pytest.approx(AT)


@pytest.mark.parametrize("epochs", [2, 3, 4])
@pytest.mark.parametrize("method", ["smoother", *polynomials.CURVES])
def test_a_handful_of_epochs_is_enough_to_interpolate(method, epochs):
    time = np.arange(float(epochs))
    track = pd.DataFrame({"time_s": time, "x": 2 * time, "y": 0.0, "z": 0.0})
    track[["sx", "sy", "sz"]] = 0.01
    table = interpolate(track, np.array([0.5]), method, max_sigma=10.0).table
    assert table["x"][0] == pytest.approx(1.0, abs=0.05)
    assert table["sx"][0] > 0.005
