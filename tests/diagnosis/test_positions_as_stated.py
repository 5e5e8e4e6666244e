"""Antenna positions that are stated so much too well that cameras follow them."""

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.generator import null, single
from benchmarks.diagnosis.generator.generate import generate
from corridor.core.preparation import plausibility_warnings

SMALL = {"images": 36, "observations": 130}


def told(block):
    return [note for note in block.notes if "the cameras follow them" in note]


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "error"), [(0.001, 0.01), (0.002, 0.0)])
def test_their_errors_are_no_effect(stated, error):
    block = generate(null("clean", **SMALL), seed=11).block.copy()
    gnss = block.gnss
    gnss[["x", "y", "z"]] += np.random.default_rng(1).normal(0.0, error, (len(gnss), 3))
    gnss[["sx", "sy", "sz"]] = stated
    found = corridor.diagnose(block)
    assert found.verdict == "nothing" and len(told(found)) == 1
    assert found.check_sigmas < 3.0


@pytest.mark.slow
def test_a_shutter_is_found_beside_them():
    hidden = generate(single("rolling_shutter", 1.0, **SMALL), seed=5)
    hidden.block.gnss[["sx", "sy", "sz"]] = 0.001
    found = corridor.diagnose(hidden.block)
    (one,) = found.effects
    (readout,) = one["parameters"]
    truth = hidden.truth["effects"][0]["parameters"][0]["value"]
    assert one["slug"] == "rolling_shutter" and len(told(found)) == 1
    assert abs(readout["value"] - truth) < 3.0 * readout["sigma"]


@pytest.mark.slow
def test_positions_stated_as_they_are_stay_so():
    assert not told(corridor.diagnose(generate(null("clean", **SMALL), seed=11).block))


def two_flights(seed=9):
    """A block of two flights, and which antenna positions are of the second."""
    block = generate(null("clean", images=48, strips=4, observations=90), seed=seed).block.copy()
    names = block.images["image"].astype(str)
    block.images["flight"] = np.where(np.arange(len(names)) < 24, "F1", "F2")
    return block, block.gnss["image"].astype(str).isin(names[24:]).to_numpy()


@pytest.mark.slow
def test_another_base_of_the_second_flight_shows_in_its_lever_arm():
    block, second = two_flights()
    assert not [note for note in corridor.adjust(block).warnings if "lever arms of" in note]
    block.gnss.loc[second, "z"] += 0.5
    (note,) = [note for note in corridor.adjust(block).warnings if "lever arms of" in note]
    assert "flights F1 and F2 differ by" in note


@pytest.mark.slow
def test_a_flight_of_metres_does_not_hold_the_lever_arm_of_another():
    block, second = two_flights()
    rng = np.random.default_rng(3)
    block.gnss.loc[second, ["x", "y", "z"]] += rng.normal(0.0, 1.5, (second.sum(), 3))
    block.gnss.loc[second, ["sx", "sy", "sz"]] = 3.0
    assert corridor.diagnose(block).verdict == "nothing"


def test_a_flight_whose_positions_lie_elsewhere_is_told():
    block, second = two_flights()
    assert not [note for note in plausibility_warnings(block) if "gnss.csv lies" in note]
    block.gnss.loc[second, ["x", "y"]] += [80.0, -3.0]
    (note,) = [note for note in plausibility_warnings(block) if "gnss.csv lies" in note]
    assert "in flight F2" in note
