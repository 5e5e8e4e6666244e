"""What a smooth shape cannot follow, and what is there only because a prior is tight."""

import pytest

from benchmarks.diagnosis.generator import null, single
from benchmarks.diagnosis.generator.generate import generate
from corridor.diagnosis import diagnose

SMALL = {"images": 30, "observations": 130}


@pytest.fixture(scope="module")
def pane():
    return generate(single("window", 1.5, **SMALL), seed=2)


# Quick: the pane of test_outliers.py.
@pytest.mark.slow
def test_a_pane_over_part_of_the_picture_is_outside_the_catalogue_and_found_at_its_rim(pane):
    found = diagnose(pane.block)
    assert found.verdict == "unknown"
    (one,) = found.unknown
    low, _, high, _ = one["location"]["image"]
    start, _, end, _ = pane.truth["effects"][0]["where"]["image"]
    rim = start if start > 0 else end
    assert low - 640 <= rim <= high + 640


@pytest.mark.slow
def test_large_terms_of_one_effect_do_not_call_a_second_one():
    """Quadratic terms of the unflatness were once left to the principal point."""
    block = generate(
        single("sensor_unflatness", 1.0, geometry="oblique", **(SMALL | {"images": 40})), seed=3
    ).block
    found = diagnose(block)
    assert [one["slug"] for one in found.effects] == ["sensor_unflatness"]


@pytest.mark.slow
def test_a_gyroscope_in_a_block_that_lacks_nothing_names_nothing():
    """Its candidate starts an adjustment from a shutter of 30 ms; a diagnosis begins from none."""
    block = generate(null("clean", gyro="rates", **SMALL), seed=4).block
    assert len(block.rates)
    found = diagnose(block)
    assert found.verdict == "nothing"
    assert found.course.last.log["sigma_px"] < 0.4


@pytest.mark.slow
def test_check_points_tell_a_knock_of_the_camera_from_an_error_of_the_gnss():
    """Between two strips flown to and fro a principal point that moves is a shift of all antennas.

    To the fit they are one; check points are the only data that see the difference.
    """
    hidden = generate(single("camera_step", 2.0, images=40, observations=150), seed=1_104_013)
    found = diagnose(hidden.block)
    assert found.verdict == "unknown"
    (one,) = found.unknown
    assert one["group"] == "camera_step" and "gnss_bias" in one["cannot_be_told_apart_from"]
    moment = hidden.truth["effects"][0]["where"]["time_s"]
    assert one["location"]["time_s"] == pytest.approx(moment, abs=10)
    assert found.gap["check_m"]["after"] < 0.5 * found.gap["check_m"]["before"]


@pytest.mark.slow
def test_where_the_gnss_is_off_no_knock_of_the_camera_takes_its_place():
    hidden = generate(
        single("gnss_bias", 1.0, geometry="nadir", arms="fixed", images=40, observations=150),
        seed=3,
    )
    found = diagnose(hidden.block)
    assert {one["slug"] for one in found.effects} <= {"gnss_bias", "control_datum"}
    assert found.effects and found.unknown == []


@pytest.mark.slow
def test_another_camera_from_a_strip_on_is_no_lens_that_follows_the_temperature():
    """The last third of the pictures with f, cx, cy and k1 of another camera, in one flight."""
    block = generate(null("clean", strips=3, images=36, observations=120), seed=62).block.copy()
    (camera,) = block.cameras.values()
    half = camera.width / 2
    middle = [half, camera.height / 2]
    last = set(block.images["image"].astype(str)[24:])
    for name in ("tie_points", "marks"):
        table = getattr(block, name).copy()
        mine = table["image"].astype(str).isin(last).to_numpy()
        away = table.loc[mine, ["x", "y"]].to_numpy(float) - middle
        square = (away**2).sum(axis=1, keepdims=True) / half**2
        table.loc[mine, ["x", "y"]] = away * (1.01 + 0.004 * square) + middle + [12.0, -9.0]
        setattr(block, name, table)
    found = diagnose(block)
    assert not found.effects
    assert [one["group"] for one in found.unknown] == ["camera_step"]
