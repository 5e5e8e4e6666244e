"""Temperatures that are not those of their pictures bend no model."""

from dataclasses import replace

import numpy as np
import pytest
from walls import mapped, warm_and_cool

from corridor.tools.thermal import fit, simple_model


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
