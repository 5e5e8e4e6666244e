"""Errors of single control points: how often they are found, and how often without any."""

import numpy as np
import pytest
from scipy.stats import binom

from corridor.diagnosis.candidates import Group
from corridor.diagnosis.control import HEIGHT, blunders
from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.reduced import Reduced
from corridor.diagnosis.settings import SETTINGS
from corridor.effects import find

# Standard deviation of a given coordinate; of the block's own datum, which all points share.
SIGMA, DATUM = 0.02, 0.05


def seen(shifts, rng, points=6):
    """Evidence of a block whose control is wrong by shifts, {point: (x, y, z)} m, and noisy."""
    covariance = SIGMA**2 * np.eye(points) + DATUM**2
    W = np.kron(np.linalg.inv(covariance), np.eye(3))
    wrong = np.zeros((points, 3))
    for point, shift in shifts.items():
        wrong[point] = shift
    half = np.linalg.cholesky(covariance)
    r = wrong + half @ rng.standard_normal((points, 3))
    groups = [
        Group(
            f"control_blunder.P{k}", find("control_blunder"), None, 3 * k + np.arange(3),
            np.ones(3), [(f"P{k}", axis, "m") for axis in "xyz"], point=f"P{k}",
        )
        for k in range(points)
    ]  # fmt: skip
    return Evidence(Reduced(W, W @ r.ravel(), [], [], [], {}, groups))


def found(shifts, seed):
    return blunders(seen(shifts, np.random.default_rng(seed))).found


def test_a_block_without_any_is_hardly_ever_accused():
    """At a level of 0.2 % a side, three of 120 blocks would be one in two thousand."""
    accused = sum(found({}, seed) is not None for seed in range(120))
    assert accused <= binom.isf(0.001, 120, 3 * SETTINGS.control_level)


@pytest.mark.parametrize(
    "shifts",
    [{2: (0, 0, 0.14)}, {4: (0.13, -0.1, 0)}, {1: (0, 0, -0.14), 5: (0, 0, -0.14)}],
    ids=["height", "plan", "two heights that hide each other"],
)
def test_blunders_of_seven_sigmas_are_found(shifts):
    """In 95 of 100 blocks: of 40, at least what that rate has in 999 of 1,000 cases."""
    right = 0
    for seed in range(40):
        one = found(shifts, 1000 + seed)
        right += one is not None and set(one.points) == set(shifts)
    assert right >= binom.ppf(0.001, 40, 0.95)


def test_one_of_three_is_as_good_as_the_other_two():
    """Two given too low say what a third says that is given too high."""
    low = {0: (0, 0, -0.3), 1: (0, 0, -0.3)}
    told = blunders(seen(low, np.random.default_rng(3), points=3))
    sets = [set(one.points) for one in (told.found, *told.alike)]
    assert {0, 1} in sets and {2} in sets
    assert all(part == HEIGHT for one in (told.found, *told.alike) for part in one.parts)
