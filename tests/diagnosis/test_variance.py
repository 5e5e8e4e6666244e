"""Alarms for noise that changes, on pseudo-residuals drawn for the purpose."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from corridor.core.adjustment import ImageRows
from corridor.diagnosis.anomalies.variance import variance_alarms

IMAGES, EACH, SIZE = 60, 120, (5120, 3840)


def drawn(seed, size=None, shake=0.0, nu=6.0):
    """Equations with residuals alone: 60 images of 120 points, five rays each.

    size: factor on the noise by time (0..1), row (-1..1) and radius; shake: amplitude in sigmas
    of a vibration of 55 Hz within 25 ms, a phase each image.
    """
    rng = np.random.default_rng(seed)
    image = np.tile(np.repeat(np.arange(IMAGES // 5), 5) * 5 + np.tile(np.arange(5), 12), EACH)
    n = len(image)
    xy = rng.uniform(0, 1, (n, 2)) * (np.array(SIZE) - 1)
    place = 2 * xy / (np.array(SIZE) - 1) - 1
    time = np.sort(rng.uniform(100, 400, IMAGES))
    # A good or a bad day of each image, and tails.
    noise = rng.standard_normal((n, 2)) * np.sqrt(0.8) / np.sqrt(rng.chisquare(nu, n) / nu)[:, None]
    noise *= rng.uniform(0.9, 1.1, IMAGES)[image][:, None]
    if size:
        factor = size((time[image] - 100) / 300, place[:, 1], np.linalg.norm(place, axis=1))
        noise *= factor[:, None]
    phase = rng.uniform(0, 2 * np.pi, IMAGES)[image]
    noise[:, 0] += shake * np.sin(2 * np.pi * 55 * 0.0125 * place[:, 1] + phase)
    images = SimpleNamespace(
        size=np.tile(SIZE, (IMAGES, 1)), time=time, names=[f"I{k}" for k in range(IMAGES)],
        flight=np.zeros(IMAGES, int), flight_names=["1"],
        row_of=np.tile([1.0, 2.0 / SIZE[1], -1.0], (IMAGES, 1)),
    )  # fmt: skip
    rows = ImageRows(image, np.arange(n) // 5, np.ones(n, bool), np.arange(n), xy, np.ones(n))
    system = SimpleNamespace(images=images, image_rows=rows)
    scales = SimpleNamespace(of_observation=np.ones(n))
    return SimpleNamespace(system=system, pixels=noise, scales=scales)


def test_alarms_are_as_rare_as_their_level():
    """300 blocks without a cause at the level 1 %: 3 expected, 9 and more once in 250 times."""
    assert sum(bool(variance_alarms(drawn(seed))) for seed in range(300)) <= 8


@pytest.mark.parametrize(
    ("quantity", "size", "key", "value"),
    [
        ("time", lambda t, row, radius: 1 + t, "time_s", 394),
        ("time", lambda t, row, radius: 2 - t, "time_s", 106),
        ("row", lambda t, row, radius: 1.5 + 0.5 * row, "row", "last"),
        ("row", lambda t, row, radius: 1.5 - 0.5 * row, "row", "first"),
        ("radius", lambda t, row, radius: 1 + 0.7 * radius, "image", [0.0, 0.0, 5119, 3839]),
    ],
    ids=["growing in time", "falling in time", "last rows", "first rows", "edges"],
)
def test_noise_that_changes_is_told_with_its_place(quantity, size, key, value):
    (alarm,) = variance_alarms(drawn(1, size))
    assert alarm["quantity"] == quantity and alarm["ratio"] > 1.25
    if quantity == "time":
        assert alarm["location"][key] == pytest.approx(value, abs=15)
    else:
        assert alarm["location"][key] == value


def test_a_vibration_is_told_from_noise_of_the_same_size():
    """0.4 sigma of 55 Hz, one sixth of the variance of one axis: no residual shows it alone."""
    (alarm,) = variance_alarms(drawn(2, shake=0.4))
    assert alarm["quantity"] == "vibration"
    assert alarm["location"]["row"] == "all"


def test_blocks_of_few_observations_raise_no_alarm():
    made = drawn(3, lambda t, row, radius: 1 + t)
    rows = made.system.image_rows
    made.system.image_rows = replace(rows, tie=np.arange(len(made.pixels)) < 150)
    assert variance_alarms(made) == []
