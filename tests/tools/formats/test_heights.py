"""The unit of heights is told by the shape of a flight that rises; a level one tells nothing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corridor.tools.formats.heights import unit_that_fits


def flown(rise, seed, count=40):
    """Places east, north, up, m, noise of 0.5 m, and the same in a frame of their own."""
    rng = np.random.default_rng(seed)
    true = rng.uniform([0, 0, 0], [300, 40, rise], (count, 3)) + [0, 0, 180.0]
    turn = Rotation.random(random_state=seed).as_matrix()
    return true + rng.normal(0, 0.5, true.shape), 0.07 * true @ turn + [5.0, 3.0, 1.0]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("unit", "metres"),
    [("feet", 0.3048), ("centimetres", 0.01), ("millimetres", 0.001), ("", 1.0)],
)
def test_heights_of_a_flight_that_rises_tell_their_unit(unit, metres, seed):
    true, own = flown(30.0, seed)
    told = unit_that_fits("photographs", own, true / [1, 1, metres])
    assert told == (f"Heights of photographs are in {unit}" if unit else "")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("metres", [0.3048, 1.0])
def test_heights_of_a_level_flight_tell_nothing(metres, seed):
    true, own = flown(0.5, seed)
    assert unit_that_fits("photographs", own, true / [1, 1, metres]) == ""


@pytest.mark.parametrize("seed", range(5))
def test_heights_that_are_wrong_otherwise_are_no_unit(seed):
    """A drift, and the height of the take-off for all."""
    true, own = flown(30.0, seed)
    drift = np.linspace(0, 40, len(true))
    assert unit_that_fits("photographs", own, true + drift[:, None] * [0, 0, 1]) == ""
    assert unit_that_fits("photographs", own, true * [1, 1, 0] + [0, 0, 160]) == ""
