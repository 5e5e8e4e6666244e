"""Coordinates in another unit are told by where the same points are seen, and nothing else is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corridor.core.preparation import apart, apart_in_shape, other_unit

UNITS = {"millimetres": 1e-3, "centimetres": 1e-2, "decimetres": 0.1, "feet": 0.3048}
AXES = {"{} is": "xyz", "Heights of {} are": "z", "x of {} is": "x", "x and y of {} are": "xy"}


def seen(seed, rise=3.0, count=12, noise=0.02):
    """Places of a flight, m, and the same with noise of 2 cm."""
    rng = np.random.default_rng(seed)
    true = rng.uniform([0, 0, 0], [120, 60, rise], (count, 3)) + [20.0, -40.0, 210.0]
    return true, true + rng.normal(0, noise, true.shape)


def scaled(true, axes, metres):
    return true / [metres if axis in axes else 1.0 for axis in "xyz"]


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("axes", AXES)
def test_each_unit_of_each_axis_is_told(axes, unit):
    for seed in range(5):
        true, there = seen(seed)
        told = other_unit("FILE", scaled(true, AXES[axes], UNITS[unit]), there, 0.1)
        assert told == f"{axes.format('FILE')} in {unit}"


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("axis", ["z", "x", "y"])
def test_a_frame_of_any_place_turn_and_scale_tells_one_axis_too(axis, unit):
    for seed in range(5):
        true, there = seen(seed)
        own = 0.07 * there @ Rotation.random(random_state=seed).as_matrix() + [5.0, 3.0, 1.0]
        told = other_unit("FILE", scaled(true, axis, UNITS[unit]), own, 0.1, apart_in_shape)
        whose = "Heights of FILE are" if axis == "z" else f"{axis} of FILE is"
        assert told == f"{whose} in {unit}"


@pytest.mark.parametrize("left", [apart, apart_in_shape])
@pytest.mark.parametrize(
    "wrong",
    [
        lambda xyz: xyz,
        lambda xyz: xyz + [0.0, 0.0, 47.9],
        lambda xyz: xyz + np.linspace(0, 40, len(xyz))[:, None] * [0, 0, 1],
        lambda xyz: xyz * [1, 1, 0],
        lambda xyz: xyz + np.random.default_rng(0).normal(0, 8.0, xyz.shape) * [0, 0, 1],
        lambda xyz: np.random.default_rng(1).permutation(xyz),
        lambda xyz: xyz + 9e4 * (np.arange(len(xyz)) == 3)[:, None] * [0, 0, 1],
    ],
    ids=["right", "geoid", "drift", "level", "barometer", "order", "wild"],
)
def test_what_is_wrong_otherwise_is_no_unit(wrong, left):
    for seed in range(20):
        for rise in (0.5, 3.0, 30.0):
            true, there = seen(seed, rise)
            assert other_unit("FILE", wrong(true), there, 0.1, left) == ""
