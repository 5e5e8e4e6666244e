"""Temperatures in other units, times that are none, thermometers that follow, lags not seen."""

from dataclasses import replace

import numpy as np
import pytest
from walls import mapped, warm_and_cool

from corridor.core.errors import InputError
from corridor.tools.thermal import fit, simple_model

MODEL = simple_model(1280, 960, scale=(13.7e-6,), radial=(0.002,))


@pytest.fixture(scope="module")
def maps():
    return mapped(warm_and_cool(14, lag_s=60.0), MODEL)


@pytest.mark.parametrize(("factor", "shift"), [(1.0, 273.15), (10.0, 0.0), (1.8, 50.0)])
def test_temperatures_that_no_camera_has_are_refused(maps, factor, shift):
    warm = factor * maps.temperature_c + shift
    with pytest.raises(InputError, match="kelvin, Fahrenheit or tenths"):
        fit(replace(maps, temperature_c=warm))


def test_one_time_for_all_pictures_is_refused(maps):
    with pytest.raises(InputError, match="all pictures have one time"):
        fit(replace(maps, time_s=0.0 * maps.time_s))


def test_a_lag_of_hours_is_one_of_milliseconds(maps):
    found = fit(replace(maps, time_s=1000.0 * maps.time_s))
    assert any("is time_s in milliseconds" in one for one in found.model.warnings)


def test_a_thermometer_that_follows_the_optics_is_told(maps):
    order = np.argsort(maps.time_s)
    warm = maps.temperature_c.copy()
    warm[order] = np.interp(maps.time_s[order] - 400.0, maps.time_s[order], warm[order])
    found = fit(replace(maps, temperature_c=warm))
    assert any("before the thermometer does" in one for one in found.model.warnings)
    assert not any("before the thermometer" in one for one in fit(maps).model.warnings)


def test_a_lag_that_cannot_be_seen_is_in_the_sigma(maps):
    """Of the half that only warms up, 60 s are worth a degree; what that moves is not known."""
    order = np.argsort(maps.time_s)
    half = maps.select(order[: len(order) // 2])
    found = fit(half).model
    assert found.lag_s is None
    assert found.misfit_px > 3 * fit(half, lag_s=60.0).model.misfit_px
