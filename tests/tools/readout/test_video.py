"""The speed of a wheel from a film of it."""

import cv2
import numpy as np
import pytest

from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.tools.readout import CannotMeasure, render, speed_from_video, video

CAMERA = Camera.from_table("film", {"width": 400, "height": 300, "f": 400.0})


def film(path, turns, frames=60, fps=30.0, valve=True):
    """A wheel that loses a hundredth of its speed in a second; its speed in the middle."""
    view = render.View(CAMERA, 1.3, 10.0, 30.0, (206.0, 147.0))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (400, 300))
    for k in range(frames):
        time = k / fps
        speed = turns * (1 - 0.01 * time)
        angle = 360 * turns * (time - 0.005 * time**2)
        light = render.wheel(
            view, render.Shutter(0.015, 0.003), speed, spokes=28, phase_deg=angle, valve=valve
        )
        grey = render.develop(light, noise=0.01, seed=k)
        writer.write(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
    writer.release()
    return abs(turns) * (1 - 0.01 * (frames - 1) / fps / 2)


@pytest.mark.parametrize("turns", [pytest.param(1.9, marks=pytest.mark.slow), -1.0])
def test_speed_and_sense_within_a_tenth_of_a_per_cent(tmp_path, turns):
    """Spokes turn by more than their spacing from frame to frame: the valve tells how far."""
    truth = film(tmp_path / "film.avi", turns)
    found = speed_from_video(tmp_path / "film.avi")
    assert found.turns_per_second == pytest.approx(truth, rel=1e-3)
    assert found.sense == ("cw" if turns > 0 else "ccw")


@pytest.mark.parametrize("turns", [1.4, pytest.param(-1.0, marks=pytest.mark.slow)])
@pytest.mark.slow
def test_a_film_of_few_turns_gives_a_speed_and_says_how_well(tmp_path, turns):
    """Errors that repeat with every turn are hardly told from the speed: they widen its sigma."""
    truth = film(tmp_path / "film.avi", turns, frames=30)
    found = speed_from_video(tmp_path / "film.avi")
    assert abs(found.turns_per_second - truth) < 3 * found.sigma
    assert found.sigma < 0.003 * truth
    assert any("film two turns or more" in text for text in found.warnings)


@pytest.mark.slow
def test_a_film_that_states_its_rate_wrongly(tmp_path):
    truth = film(tmp_path / "film.avi", 1.9)
    found = speed_from_video(tmp_path / "film.avi", fps=120.0)
    assert found.turns_per_second == pytest.approx(4 * truth, rel=1e-3)


def test_a_time_outside_the_film_is_wrong_input(tmp_path):
    film(tmp_path / "film.avi", 1.9, frames=12)
    with pytest.raises(InputError, match="outside"):
        speed_from_video(tmp_path / "film.avi", photo_time=5.0)


def test_nothing_turns(tmp_path):
    writer = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (400, 300)
    )
    random = np.random.default_rng(0)
    for _ in range(20):
        frame = np.clip(100 + random.normal(0, 3, (300, 400)), 0, 255).astype(np.uint8)
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    with pytest.raises(CannotMeasure):
        speed_from_video(tmp_path / "film.avi")


def test_what_is_no_film_is_told(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_text("no film", encoding="utf-8")
    with pytest.raises(InputError, match="no film that can be read"):
        video._read(path, None)
