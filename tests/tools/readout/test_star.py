"""A Siemens star: the readout time that went in comes out."""

from functools import lru_cache

import cv2
import independent
import numpy as np
import pytest

from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.tools.readout import CannotMeasure, Photograph, measure_star, render

CAMERA = Camera.from_table(
    "test", {"width": 900, "height": 600, "f": 862.0, "cx": 454.0, "cy": 295.0, "k1": -0.08}
)


@lru_cache(maxsize=4)
def pair(direction="down", turns=2.5, readout=0.04, exposure=0.0004, tilt=14.0, sectors=16):
    """A star at rest and turning, seen by a camera that was moved by three pixels in between."""
    view = render.View(CAMERA, 1.2, tilt, 40.0, (480.0, 285.0))
    moved = render.View(CAMERA, 1.201, tilt, 40.1, (483.0, 283.5))
    shutter = render.Shutter(readout, exposure, direction)
    drawn = dict(sectors=sectors, radius=0.33, hub=0.02)
    still = render.star(view, shutter, 0.0, phase_deg=11.0, **drawn)
    turning = render.star(moved, shutter, turns, phase_deg=77.0, **drawn)
    finish = dict(noise=0.006, blur_px=0.8, vignette=0.3)
    return (
        Photograph("still", render.develop(still, seed=1, **finish)),
        Photograph("turning", render.develop(turning, seed=2, **finish)),
    )


class TestAnIndependentPhotograph:
    """Brute force over instants and sub-pixels; sizes of the errors."""

    @pytest.mark.parametrize(
        ("direction", "turns", "sense"),
        [
            ("down", 3.0, "cw"),
            pytest.param("left", -4.0, "ccw", marks=pytest.mark.slow),
        ],
    )
    def test_the_readout_time_is_found(self, direction, turns, sense):
        texture = independent.star_texture(16)
        common = dict(texture=texture, size=(560, 420), scale=180, tilt=(0.1, -0.15))
        still = independent.photograph(centre=(285.0, 202.0), phase_deg=7.0, **common)
        turning = independent.photograph(
            centre=(286.3, 201.2), phase_deg=50.0, turns_per_second=turns, readout=0.03,
            exposure=0.0006, instants=3, direction=direction, seed=1, **common,
        )  # fmt: skip
        found = measure_star(
            Photograph("a", still), Photograph("b", turning), abs(turns), sense=sense
        )
        degrees = abs(turns) * 360 * 0.03
        allowed = max(0.0015, 0.065 / degrees) * 30.0
        assert found.readout_ms == pytest.approx(30.0, abs=allowed)
        assert abs(found.readout_ms - 30.0) < 3.5 * found.sigma_ms
        assert (found.row_direction, found.extra["sectors"]) == (direction, 16)


@pytest.mark.slow
def test_many_sectors_of_a_tilted_star_read_out_to_the_left_are_followed():
    """30 degrees of tilt move edges by more than one of 48 sectors; 18 degrees of turn."""
    photos = pair("left", 18 / 360 / 0.04, tilt=30.0, sectors=48)
    found = measure_star(*photos, 18 / 360 / 0.04, row_direction="left")
    assert found.rotation_deg == pytest.approx(18.0, abs=0.065)
    assert (found.extra["sectors"], found.rotation_sense) == (48, "cw")


class TestEverySenseAndDirection:
    @pytest.mark.parametrize(
        ("direction", "turns"),
        [
            ("down", -2.5),
            pytest.param("right", 2.5, marks=pytest.mark.slow),
            pytest.param("up", -2.5, marks=pytest.mark.slow),
            pytest.param("left", 2.5, marks=pytest.mark.slow),
        ],
    )
    def test_with_a_calibrated_camera_a_tenth_of_a_per_cent(self, direction, turns):
        found = measure_star(*pair(direction, turns), 2.5, camera=CAMERA, row_direction=direction)
        # 0.1 % or 0.02 degrees of the 36 degrees during the readout.
        assert found.readout_ms == pytest.approx(40.0, rel=1e-3)
        assert found.rotation_sense == ("cw" if turns > 0 else "ccw")
        assert found.rows == (600 if direction in ("down", "up") else 900)
        assert found.angular_velocity_deg_s == pytest.approx(900.0)
        assert found.rotation_deg == pytest.approx(36.0, rel=2e-3)

    def test_without_sense_or_direction_the_two_look_alike(self):
        found = measure_star(*pair(), 2.5)
        assert (found.row_direction, found.rotation_sense, found.row_axis) == (None, None, "y")
        assert any("look alike" in text for text in found.warnings)

    @pytest.mark.slow
    def test_sense_and_direction_that_contradict_the_pictures_are_wrong_input(self):
        with pytest.raises(InputError, match="contradicts"):
            measure_star(*pair(), 2.5, sense="ccw", row_direction="down")
        with pytest.raises(InputError, match="contradicts"):
            measure_star(*pair(), 2.5, row_direction="left")


@pytest.mark.slow
def test_an_error_of_the_speed_goes_into_the_readout_one_to_one():
    photos = pair()
    right = measure_star(*photos, 2.5)
    wrong = measure_star(*photos, 2.525, speed_sigma_percent=1.0)
    assert wrong.readout_ms == pytest.approx(right.readout_ms / 1.01, rel=1e-9)
    assert wrong.sigma_ms == pytest.approx(np.hypot(right.sigma_ms, 0.4), rel=0.02)


@pytest.mark.slow
def test_a_long_exposure_does_not_move_the_result():
    """Steps are measured at their centroid: the middle of the exposure (2 ms: 1.8 degrees)."""
    found = measure_star(*pair(exposure=0.002), 2.5, camera=CAMERA)
    assert found.readout_ms == pytest.approx(40.0, rel=1e-3)


@pytest.mark.slow
def test_edges_that_the_blur_of_the_rim_moves_are_left_out():
    """A tilted star's circles leave it on two sides; inside it, no edge is half a pixel off."""
    found = measure_star(*pair(tilt=20.0), 2.5, camera=CAMERA)
    assert np.abs(found.drawing.residuals).max() < 0.5


class TestWhatCannotBeMeasured:
    def test_no_star(self):
        grey = np.random.default_rng(0).integers(90, 110, (400, 600)).astype(np.uint8)
        with pytest.raises(CannotMeasure, match="no star"):
            measure_star(Photograph("a", grey), Photograph("b", grey), 1.0)

    def test_a_cross_of_four_sectors(self):
        with pytest.raises(CannotMeasure, match="has 4 sectors"):
            measure_star(*pair(sectors=4), 2.5)

    def test_a_star_that_does_not_turn(self):
        still, _ = pair()
        with pytest.raises(CannotMeasure, match="does not turn"):
            measure_star(still, still, 1.0)

    @pytest.mark.slow
    def test_two_photographs_of_a_turning_star(self):
        _, turning = pair(turns=1.0)
        with pytest.raises(CannotMeasure, match="not at rest|no star"):
            measure_star(turning, turning, 1.0)

    @pytest.mark.slow
    def test_a_still_that_also_shows_the_star_turning_is_told(self):
        still, turning = pair()
        assert not measure_star(still, turning, 2.5, sense="cw").warnings
        twice = (0.6 * still.grey + 0.4 * turning.grey).astype(np.uint8)
        found = measure_star(Photograph("twice.png", twice), turning, 2.5, sense="cw")
        assert "counted in twice.png explain" in found.warnings[0]

    def test_another_target_in_the_second_photograph(self):
        still, _ = pair()
        grey = cv2.GaussianBlur(
            np.random.default_rng(0).integers(0, 255, still.grey.shape).astype(np.uint8), (0, 0), 4
        )
        with pytest.raises(CannotMeasure):
            measure_star(still, Photograph("b", grey), 1.0)

    def test_two_sizes(self):
        still, turning = pair()
        with pytest.raises(InputError, match="one camera and size"):
            measure_star(still, Photograph("b", turning.grey[:-2]), 1.0)

    def test_a_calibration_of_another_size(self):
        other = Camera.from_table("other", {"width": 901, "height": 600, "f": 1000.0})
        with pytest.raises(InputError, match="other"):
            measure_star(*pair(), 2.5, camera=other)


def test_exchanged_photographs_are_told():
    still, turning = pair()
    with pytest.raises(InputError, match="exchange the two"):
        measure_star(turning, still, 2.5)


def test_a_wrong_number_of_sectors_is_told():
    with pytest.raises(InputError, match="--sectors 12: the star in still has 16"):
        measure_star(*pair(), 2.5, sectors=12)


def test_a_readout_longer_than_that_of_any_camera_is_no_result():
    """2.5 turns a minute in place of a second."""
    with pytest.raises(CannotMeasure, match="longer than that of any camera"):
        measure_star(*pair(), 2.5 / 60)
