"""What a smooth shape cannot follow, and what is there only because a prior is tight."""

import pytest

from corridor.diagnosis import diagnose
from tests.hidden import null, single
from tests.hidden.generate import generate

SMALL = {"images": 30, "observations": 130}


@pytest.fixture(scope="module")
def pane():
    return generate(single("window", 1.5, **SMALL), seed=2)


def test_a_pane_over_part_of_the_picture_is_outside_the_catalogue_and_found_at_its_rim(pane):
    found = diagnose(pane.block)
    assert found.verdict == "unknown"
    (one,) = found.unknown
    low, _, high, _ = one["location"]["image"]
    start, _, end, _ = pane.truth["effects"][0]["where"]["image"]
    rim = start if start > 0 else end
    assert low - 640 <= rim <= high + 640


def test_large_terms_of_one_effect_do_not_call_a_second_one():
    """Quadratic terms of the unflatness were once left to the principal point."""
    block = generate(
        single("sensor_unflatness", 1.0, geometry="oblique", **(SMALL | {"images": 40})), seed=3
    ).block
    found = diagnose(block)
    assert [one["slug"] for one in found.effects] == ["sensor_unflatness"]


def test_a_gyroscope_in_a_block_that_lacks_nothing_names_nothing():
    """Its candidate starts an adjustment from a shutter of 30 ms; a diagnosis begins from none."""
    block = generate(null("clean", gyro="rates", **SMALL), seed=4).block
    assert len(block.rates)
    found = diagnose(block)
    assert found.verdict == "nothing"
    assert found.course.last.log["sigma_px"] < 0.4
