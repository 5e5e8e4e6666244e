"""What block.toml and ground.csv state and the images contradict: survey, camera, readout."""

from dataclasses import replace

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.generator.cases import Case
from benchmarks.diagnosis.generator.generate import generate
from benchmarks.ladder import made
from corridor.core.camera import INTERIOR
from corridor.core.preparation import AGREES, CONTRADICTS, Witness, record_derived


def surveyed(sigma, error, points=6, seed=1):
    """A block of six control points of which some are off by normal errors, m; sigma as stated."""
    case = Case({}, images=36, strips=3, observations=120, control=6, check=6)
    block = generate(case, seed).block.copy()
    control = block.ground.index[block.ground["role"] == "control"]
    off = np.random.default_rng(seed + 50).normal(0.0, error, (6, 3))[:points]
    block.ground.loc[control, ["sx", "sy", "sz"]] = sigma
    block.ground.loc[control[:points], ["x", "y", "z"]] += off
    return block, off, list(block.ground.loc[control, "point"])


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.0, 0.001])
def test_a_survey_worse_than_stated_is_no_error_of_single_points(sigma):
    block, off, _ = surveyed(sigma, 0.03)
    found = corridor.diagnose(block)
    assert found.verdict == "unknown" and not found.effects
    assert [one["group"] for one in found.unknown] == ["control_scatter"]
    assert found.gap["check_m"]["after"] < found.gap["check_m"]["before"]
    assert any("control_m" in step for step in found.actions)
    rms = np.sqrt((off**2).sum(axis=1).mean())
    told = float(found.unknown[0]["where"].split(", ")[-1].split(" mm")[0])
    assert told == pytest.approx(1000 * rms, rel=0.3)


@pytest.mark.slow
def test_one_wrong_point_among_exact_ones_is_named():
    block, off, names = surveyed(0.0, 0.08, points=1, seed=3)
    found = corridor.diagnose(block)
    (one,) = found.effects
    assert found.verdict == "named" and one["point"] == names[0]
    true = dict(zip("xyz", off[0], strict=True))
    for told in one["parameters"]:
        assert abs(told["value"] - true[told["name"]]) < 3.5 * told["sigma"]


@pytest.mark.slow
def test_exact_control_that_is_right_is_not_accused():
    block, *_ = surveyed(0.0, 0.0)
    assert corridor.diagnose(block).verdict == "nothing"


@pytest.mark.slow
def test_the_adjustment_tells_that_marks_miss_exact_control():
    told = [note for note in corridor.adjust(surveyed(0.0, 0.03)[0]).warnings if "exactly" in note]
    assert len(told) == 1 and "control_m" in told[0]
    right = corridor.adjust(surveyed(0.0, 0.0)[0]).warnings
    assert not [note for note in right if "exactly" in note]


@pytest.mark.slow
def test_a_survey_worse_than_stated_accuses_no_single_point_in_the_adjustment():
    found = corridor.adjust(surveyed(0.001, 0.03)[0])
    assert found.control_factor > 10.0
    assert any("too many points" in note for note in found.warnings)
    assert not [note for note in found.warnings if "Ground control is wrong" in note]


@pytest.mark.slow
def test_check_points_of_a_free_network_accuse_no_point():
    block, *_ = surveyed(0.005, 0.0)
    block.ground["role"], block.gnss = "check", block.gnss[:0]
    found = corridor.diagnose(block)
    assert found.check_sigmas is None and "check point" not in found.sentence


@pytest.mark.slow
def test_a_stated_readout_that_the_images_do_not_show_is_told():
    block, *_ = surveyed(0.005, 0.0)
    assert not [note for note in corridor.diagnose(block).notes if "block.toml states" in note]
    block.cameras = {n: replace(c, readout_s=0.033) for n, c in block.cameras.items()}
    (told,) = [note for note in corridor.diagnose(block).notes if "block.toml states" in note]
    assert "readout 33 ms" in told


@pytest.mark.slow
def test_a_wrong_calibration_is_not_called_another_height_system():
    block, *_ = surveyed(0.005, 0.0)
    ((name, camera),) = block.cameras.items()
    interior = camera.interior.copy()
    interior[list(INTERIOR).index("k1")] += 0.1
    block.cameras = {name: replace(camera, interior=interior, calibrated=True)}
    found = corridor.diagnose(block)
    assert "radial_distortion" in [one["slug"] for one in found.effects]


def test_what_is_derived_and_contradicted_is_said():
    block = made(12, 0).block
    agrees = Witness("the course over ground", AGREES, "the same to 3 degrees")
    against = Witness("the mapped centres", CONTRADICTS, "2.9 s late")
    record_derived(block, "moments", "EXIF", None, "Times are EXIF's.", witnesses=[agrees])
    record_derived(block, "gnss.sx", "EXIF", None, "Positions are EXIF's.", witnesses=[against])
    said = "Positions are EXIF's. Contradicted by the mapped centres: 2.9 s late."
    notes = corridor.diagnose(block).notes
    assert said in notes
    assert not any("Times are EXIF's" in note for note in notes)
