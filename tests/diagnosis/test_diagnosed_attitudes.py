"""What the diagnosis says of attitudes: causes named with their look-alikes, none invented."""

from dataclasses import replace
from pathlib import Path

import pytest

import corridor
from corridor.core.simulation import ORDINARY_NOISE

DOCS = Path(__file__).parents[2] / "docs"
PLAN = DOCS / "effect_flight.toml"
NOISE = replace(ORDINARY_NOISE, attitude_deg=(0.05, 0.05, 0.1))


def diagnosed(plan=PLAN, **effects):
    return corridor.diagnose(corridor.simulate(plan, noise=NOISE, seed=3, effects=effects))


def found(diagnosis):
    """Slug -> what it cannot be told apart from."""
    return {one["slug"]: set(one["cannot_be_told_apart_from"]) for one in diagnosis.effects}


def test_nothing_is_found_where_nothing_is_missing():
    """The boresight of each flight, which comes with attitudes, is believed and not found."""
    assert diagnosed().verdict == "nothing"


@pytest.mark.parametrize(
    ("slug", "values", "like"),
    [
        # A lag for each axis does the same, with two parameters more: it is no other cause.
        ("attitude_clock_offset", {"offset": 0.1}, "attitude_clock_offset"),
        ("boresight_drift", {"x": 9e-5}, "boresight_by_temperature"),
    ],
)
def test_a_cause_is_found_and_its_look_alike_said(slug, values, like):
    """100 ms; 0.3 degrees a minute while the camera warms up. 20 sigmas each."""
    told = found(diagnosed(**{slug: values}))
    assert slug in told or like in told
    assert set(told) | set().union(*told.values()) <= {slug, like}


def test_a_mounting_that_is_stated_exactly_and_wrong_is_found():
    """A tenth of a degree about the axis along the flight: nothing within the pictures does it."""
    told = found(diagnosed(DOCS / "effect_rig.toml", mounting={"turn_y": 0.002}))
    assert "mounting" in told
