"""Antenna positions that are stated so much too well that cameras follow them."""

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.generator import null, single
from benchmarks.diagnosis.generator.generate import generate

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
