"""Temperatures that are not those of their pictures bend no model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from walls import mapped, warm_and_cool

from corridor.tools.thermal import fit, simple_model
from corridor.tools.thermal.sums import Sums
from corridor.tools.thermal.temperature import _monotone


@pytest.fixture(scope="module")
def maps():
    return mapped(warm_and_cool(12), simple_model(1280, 960, scale=(13.7e-6,), radial=(0.002,)))


def left_out(fitted):
    """Rows of pictures with maps that the fit did not use."""
    used = fitted.pictures["used"].to_numpy()
    return set(np.flatnonzero(~used).tolist()) - {0}


def test_right_temperatures_are_all_used(maps):
    assert not left_out(fit(maps))


def test_a_temperature_that_is_wrong_by_12_degrees_is_left_out(maps):
    warm = maps.temperature_c.copy()
    warm[6] += 12.0
    found = fit(replace(maps, temperature_c=warm))
    assert left_out(found) == {6}
    assert any(str(maps.picture[6]) in one for one in found.model.warnings)


def test_two_temperatures_that_were_exchanged_are_left_out_and_called_so(maps):
    warm = maps.temperature_c.copy()
    warm[[4, 10]] = warm[[10, 4]]
    found = fit(replace(maps, temperature_c=warm))
    assert left_out(found) == {4, 10}
    assert any("exchanged" in one for one in found.model.warnings)


@pytest.mark.parametrize("use", [None, np.arange(11) != 4])
def test_many_lags_at_once_leave_what_each_leaves_alone(maps, use):
    sums, lags = Sums(maps, None), [0.0, 3.0, 40.0]
    together = sums.left_of_pictures("decentring", 2, lags, use)
    for lag, left in zip(lags, together, strict=True):
        alone = sums.solve("decentring", 2, lag, (), use)
        apart = alone.of_picture - sums.weight * np.sum(alone.offset**2, axis=1)
        # Sums of squares of some 1e4 lose nine digits of sixteen where little is left.
        np.testing.assert_allclose(left, apart, rtol=1e-6)


@pytest.mark.parametrize("digits", [0, 6])
def test_the_curve_that_does_not_overshoot_is_scipys(digits):
    """With plateaus and corners, and without."""
    rng = np.random.default_rng(0)
    for count in range(3, 12):
        when, warm = np.cumsum(rng.uniform(0.5, 3, count)), rng.normal(0, 2, count).round(digits)
        steps = (np.arange(8) / 8)[None] * np.diff(when)[:, None]
        fine = np.append((when[:-1, None] + steps).ravel(), when[-1])
        wanted = PchipInterpolator(when, warm)(fine)
        assert _monotone(when, warm, fine) == pytest.approx(wanted, abs=1e-12)
