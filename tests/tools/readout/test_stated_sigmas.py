"""Intervals of 95 per cent contain the truth as often as they say.

Photographs of the tests' own renderer (`independent`): lens, tilt, background, exposure, noise, row
order and sense at random; the camera moves between the two photographs.
"""

import cv2
import independent
import numpy as np
import pytest
import scipy.stats

from corridor.core.camera import Camera
from corridor.tools.readout import Photograph, measure_led, measure_star, measure_wheel

WIDTH, HEIGHT = 640, 480
pytestmark = pytest.mark.slow


def pair(random, texture, degrees, scale, most_smear_deg):
    """A function that takes two photographs of a target; turns a second, readout (s), camera."""
    focal, k1 = random.uniform(0.75, 1.3) * WIDTH, random.uniform(-0.12, 0.05)
    camera = focal, WIDTH / 2 + random.uniform(-6, 6), HEIGHT / 2 + random.uniform(-6, 6), k1
    readout = random.uniform(0.01, 0.07)
    turns = degrees / 360 / readout * random.choice([-1, 1])
    slope, towards = np.tan(np.radians(random.uniform(0, 18))), random.uniform(0, 2 * np.pi)
    centre = np.array([WIDTH / 2, HEIGHT / 2]) + random.uniform(-20, 20, 2)
    coarse = random.uniform(0.1, 0.4, (5, 7)).astype(np.float32)
    common = dict(
        texture=texture,
        size=(WIDTH, HEIGHT),
        camera=camera,
        tilt=(slope * np.cos(towards), slope * np.sin(towards)),
        noise=random.uniform(0.002, 0.01),
        blur=random.uniform(0.5, 1.0),
        background=cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC),
    )
    still = dict(centre=centre, phase_deg=random.uniform(0, 360), scale=scale, seed=1, **common)
    turning = dict(
        centre=centre + random.normal(0, 1.5, 2),
        phase_deg=random.uniform(0, 360),
        scale=scale * (1 + random.normal(0, 0.001)),
        turns_per_second=turns,
        readout=readout,
        exposure=random.uniform(0, most_smear_deg) / 360 / abs(turns),
        instants=5,
        direction=str(random.choice(["down", "up", "left", "right"])),
        seed=2,
        **common,
    )
    calibrated = Camera.from_table(
        "c",
        {"width": WIDTH, "height": HEIGHT, "f": focal, "cx": camera[1], "cy": camera[2], "k1": k1},
    )

    def take():
        return [
            Photograph(name, independent.photograph(**scene))
            for name, scene in (("still", still), ("turning", turning))
        ]

    return take, turns, readout, calibrated


def judged(cases, measure):
    """Sizes of the errors (n, 3): in per cent, in degrees turned during the readout, in sigmas.

    Of all without a calibrated camera, and of every third with it.
    """
    without, calibrated = [], []
    for number, (take, turns, readout, camera) in enumerate(cases):
        photos = take()
        for known, into in ((None, without), (camera, calibrated)):
            if known is None or not number % 3:
                found = measure(*photos, abs(turns), camera=known)
                error = found.readout_ms - 1e3 * readout
                into.append(
                    [error / (10 * readout), error / 1e3 * 360 * turns, error / found.sigma_ms]
                )
    return np.abs(without).T, np.abs(calibrated).T


def contain(inside):
    """Whether intervals of 95 per cent hold the truth no less often than so many of them would by
    chance (binomial distribution, one such test in a thousand fails)."""
    return inside.sum() >= scipy.stats.binom.ppf(0.001, len(inside), 0.95)


def stars():
    random = np.random.default_rng(20)
    for sectors in (8, 12, 16, 24, 32):
        texture = independent.star_texture(sectors)
        for _ in range(2):
            yield pair(random, texture, random.uniform(5, 45), random.uniform(150, 205), 3.0)


def wheels():
    random = np.random.default_rng(21)
    for spokes, crosses in ((20, 2), (24, 2), (28, 1), (32, 3), (36, 3)):
        texture = independent.wheel_texture(spokes, crosses)
        for _ in range(3):
            yield pair(random, texture, random.uniform(15, 50), random.uniform(170, 205), 2.0)


def test_ten_stars_without_and_some_with_a_calibrated_camera():
    """Each within 0.15 % or 0.065 degrees of the truth, with a calibrated camera within 0.1 % or
    0.02 degrees: the larger of the two."""
    found = judged(stars(), measure_star)
    for (percent, degrees, sigmas), limits in zip(found, ((0.15, 0.065), (0.1, 0.02)), strict=True):
        assert ((percent < limits[0]) | (degrees < limits[1])).all()
        assert contain(sigmas < 1.96)


def test_eight_wheels_without_and_some_with_a_calibrated_camera():
    """The fifth is seen so nearly from the front that its focal length is hardly told."""
    for percent, _, sigmas in judged(list(wheels())[::2], measure_wheel):
        assert contain(sigmas < 1.96)
        assert np.median(percent) < 0.3
        assert percent.max() < 1.2


def test_forty_leds():
    random = np.random.default_rng(22)
    inside = 0
    for case in range(40):
        readout = random.uniform(0.005, 0.06)
        stripes = random.uniform(10, 80)
        frequency = stripes / readout
        picture = independent.stripes(
            (640, 900) if case % 2 else (900, 640),
            frequency,
            readout,
            exposure=random.uniform(0.05, 0.8) / frequency,
            direction=str(random.choice(["down", "up", "left", "right"])),
            duty=random.uniform(0.15, 0.85),
            phase=random.random(),
            light=np.exp(random.uniform(np.log(0.2), np.log(3))),
            noise=random.uniform(0.002, 0.02),
            seed=case,
        )
        found = measure_led(Photograph("led", picture), frequency)
        assert found.readout_ms == pytest.approx(1e3 * readout, rel=5e-4)
        inside += abs(found.readout_ms - 1e3 * readout) < 1.96 * found.sigma_ms
    assert inside >= 36
