"""A blinking LED: the readout time that went in comes out."""

import json

import cv2
import independent
import numpy as np
import pytest

from corridor.core.camera import Camera
from corridor.core.errors import InputError
from corridor.tools.readout import (
    CannotMeasure,
    Photograph,
    measure_led,
    readout_from_led,
    render,
)

CAMERA = Camera.from_table("led", {"width": 640, "height": 900, "f": 900.0})
Y, X = np.mgrid[:900, :640]
LAMP = np.exp(-((X - 250) ** 2 + (Y - 500) ** 2) / (2 * 330.0**2))


def photo(frequency, readout=0.03, exposure=0.0003, direction="down", duty=0.5, light=0.8, **more):
    shutter = render.Shutter(readout, exposure, direction)
    ambient = 0.02 + 0.05 * X / 640
    picture = render.led(
        CAMERA, shutter, frequency, duty=duty, light=light * LAMP, ambient=ambient, phase=0.3
    )
    return Photograph("led", render.develop(picture, **{"noise": 0.02, "seed": 5, **more}))


def by_hand(frequency, readout):
    """Stripes without the renderer: 1 where the phase at the row's time is in its first half."""
    random = np.random.default_rng(1)
    phase = (frequency * readout * np.arange(900) / 899 * np.ones((640, 1))).T
    light = np.where(phase % 1 < 0.5, 180.0, 20.0) + random.normal(0, 6, (900, 640))
    return Photograph("hand", np.clip(light, 0, 255).astype(np.uint8))


def test_stripes_drawn_by_hand():
    """Within 0.05 %, as for ten stripes or more."""
    found = measure_led(by_hand(700.0, 0.03), 700.0)
    assert found.readout_ms == pytest.approx(30.0, rel=5e-4)


@pytest.mark.parametrize("direction", ["down", "right"])
@pytest.mark.parametrize(
    ("frequency", "duty", "light"), [(400.0, 0.5, 0.8), (900.0, 0.2, 0.5), (1500.0, 0.7, 3.0)]
)
def test_other_duty_cycles_and_saturation_are_within_five_hundredths_of_a_per_cent(
    direction, frequency, duty, light
):
    found = measure_led(photo(frequency, direction=direction, duty=duty, light=light), frequency)
    assert found.readout_ms == pytest.approx(30.0, rel=5e-4)
    assert abs(found.readout_ms - 30.0) < 4 * found.sigma_ms
    assert found.row_axis == ("y" if direction == "down" else "x")
    assert found.row_direction is None


def test_a_damaged_file_is_told_by_stripes_that_break():
    """A JPEG goes on beside its place after a lost byte: the lower rows are other ones."""
    whole = photo(900.0)
    broken = Photograph("broken", np.vstack([whole.grey[:300], whole.grey[313:]]))
    half = round(900 / 27 / 2)
    narrow = photo(900.0, duty=0.25).grey
    torn = Photograph("torn", np.hstack([narrow[half:, :320], narrow[:-half, 320:]]))
    told = [
        [word for word in measure_led(one, 900.0).warnings if "file damaged" in word]
        for one in (whole, broken, torn)
    ]
    assert not told[0] and "follow each other evenly" in told[1][0]
    assert "do not go straight across" in told[2][0]


def test_stripes_are_counted_over_all_rows():
    """900 Hz x 30 ms = 27 periods between the first and the last of 900 rows."""
    found = measure_led(photo(900.0), 900.0)
    assert found.extra["stripes"] == pytest.approx(27 * 900 / 899, rel=1e-3)


def test_faint_stripes_in_a_lamp_that_falls_off_within_the_picture():
    """Contrast 0.2, portrait, 12.6 stripes: a stiff background leaves five times their error.

    Within 0.02 %: rows of noise 0.005 / sqrt(480) allow a tenth of it, the rest is the lamp's.
    """
    errors = []
    for phase, duty in ((0.1, 0.5), (0.35, 0.3), (0.6, 0.5), (0.85, 0.3)):
        time = 12.6 * np.arange(640) / 639 + phase
        late = 0.3 * (np.arange(400) / 400 - 0.5)
        lit = ((time[:, None] + late) % 1 < duty).mean(axis=1)[:, None]
        y, x = np.mgrid[:640, :480]
        lamp = np.exp(-((x - 216) ** 2 + (y - 352) ** 2) / (2 * 120.0**2))
        light = 0.5 * (0.8 + 0.4 * lit) * lamp + 0.02
        noise = 0.005 * np.random.default_rng(1).standard_normal(light.shape)
        found = measure_led(Photograph("faint", independent.encoded(light + noise)), 420.0)
        errors.append(abs(found.readout_ms / 30 - 1))
        assert abs(found.readout_ms - 30) < 4 * found.sigma_ms
        assert found.sigma_ms < 30 * 2e-4
    assert max(errors) < 2e-4


def test_the_real_led_is_within_a_tenth_of_a_per_cent(real_data):
    """gyroflow/rollingshutter: 15.730 ms over 50 frames; 15.715 from the first to the last row."""
    known = json.loads((real_data / "wheel_bar" / "expected.json").read_text(encoding="utf-8"))
    known = known["led"]
    found = readout_from_led(real_data / "wheel_bar" / known["image"], known["frequency_hz"])
    published = known["published_readout_all_rows_ms"]
    assert found.readout_ms == pytest.approx(published, rel=1e-3)
    assert found.readout_ms == pytest.approx(published * 1079 / 1080, rel=1.2e-3)
    assert found.row_axis == "y"


class TestWhatCannotBeMeasured:
    def test_an_exposure_of_one_period_lets_the_stripes_vanish(self):
        blurred = photo(500.0, exposure=1 / 500)
        with pytest.raises(CannotMeasure, match="no stripes"):
            measure_led(blurred, 500.0)
        known = Photograph("led", blurred.grey, exposure_s=1 / 500)
        with pytest.raises(CannotMeasure, match="1 periods"):
            measure_led(known, 500.0)

    def test_an_overexposed_led(self):
        with pytest.raises(CannotMeasure, match="overexposed"):
            measure_led(Photograph("white", np.full((400, 600), 255, np.uint8)), 500.0)
        with pytest.raises(CannotMeasure, match="overexposed"):
            measure_led(photo(500.0, exposure=0.0015, light=500.0), 500.0)

    @pytest.mark.parametrize("seed", range(4))
    def test_a_picture_of_something_else(self, seed):
        random = np.random.default_rng(seed)
        coarse = random.integers(30, 220, (9, 12)).astype(np.uint8)
        grey = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC)
        grey = np.clip(grey + random.normal(0, 4, grey.shape), 0, 255).astype(np.uint8)
        with pytest.raises(CannotMeasure):
            measure_led(Photograph("scene", grey), 500.0)

    def test_a_row_direction_across_the_stripes_is_wrong_input(self):
        with pytest.raises(InputError, match="stripes"):
            measure_led(photo(900.0), 900.0, row_direction="left")


@pytest.mark.parametrize(("typed", "word"), [(1.0, "longer"), (1e6, "shorter")])
def test_a_frequency_in_kilohertz_or_millihertz_is_refused(typed, word):
    with pytest.raises(InputError, match=f"{word} than that of any camera; give .* in Hz"):
        measure_led(photo(1000.0), typed)
