"""Errors of single control points: how often they are found, and how often without any."""

import numpy as np
import pytest
from scipy.stats import binom

from corridor.core.effects import find
from corridor.diagnosis.evidence.blunders import HEIGHT, blunders, explains_all, price
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Reduced
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification.all_ground import AllGround, asked

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
            np.ones(3), [(f"P{k}", axis, "m") for axis in "xyz"], single=f"P{k}",
        )
        for k in range(points)
    ]  # fmt: skip
    return Evidence(Reduced(W, W @ r.ravel(), groups))


def found(shifts, seed):
    return blunders(seen(shifts, np.random.default_rng(seed))).found


def test_a_block_without_any_is_hardly_ever_accused():
    """At a level of 0.2 % a side, three of 120 blocks would be one in two thousand."""
    accused = sum(found({}, seed) is not None for seed in range(120))
    assert accused <= binom.isf(0.001, 120, 3 * SETTINGS.control_level)


def test_a_handful_of_wrong_points_is_as_unlikely_as_so_many_accidents():
    """One point in fifty is wrong: four are 12.8 log units less likely than the test's two."""
    groups = seen({}, np.random.default_rng(0)).groups
    assert price(groups, []) == price(groups, [0, 1]) == 0.0
    assert price(groups, [0, 1, 2, 3]) == pytest.approx(4 * (np.log(1 / 49) + 0.7))


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


@pytest.mark.parametrize("metres", [2.0, 20.0, 500.0])
def test_of_a_point_that_is_far_off_no_other_is_accused(metres):
    """Beyond 38 sigmas chance is no number any more, nor is that of points which it draws."""
    for seed in range(5):
        wrong = found({4: (metres, -metres, 0)}, seed)
        assert wrong.of_point == {4: ("x", "y")}
    two = found({1: (0, 0, metres), 5: (0, 0, 0.5 * metres)}, 0)
    assert two.of_point == {1: ("z",), 5: ("z",)}


def test_one_of_three_is_as_good_as_the_other_two():
    """Two given too low say what a third says that is given too high."""
    low = {0: (0, 0, -0.3), 1: (0, 0, -0.3)}
    told = blunders(seen(low, np.random.default_rng(3), points=3))
    sets = [set(one.points) for one in (told.found, *told.alike)]
    assert {0, 1} in sets and {2} in sets
    assert all(part == HEIGHT for one in (told.found, *told.alike) for part in one.parts)


def test_of_many_check_points_some_are_asked_and_all_control():
    points = np.array([f"P{k}" for k in range(1465)])
    roles = np.where(np.arange(1465) % 150 == 7, "control", "check")
    roles[3] = "unused"
    names = asked(points, roles)
    assert set(points[roles == "control"]) <= set(names) and "P3" not in names
    assert len(names) == (roles == "control").sum() + SETTINGS.most_asked_points == len(set(names))
    assert sorted(asked(points[:9], roles[:9])) == sorted(set(points[:9]) - {"P3"})


class TestWithCheckPointsAsked:
    """Points 0 and 1 are control, the others check points: what the fit alone could not tell."""

    low = {0: (0, 0, -0.14), 1: (0, 0, -0.14)}

    def test_two_that_agree_with_each_other_are_found(self):
        """In 95 of 100 blocks with four check points."""
        right = 0
        for seed in range(40):
            evidence = seen(self.low, np.random.default_rng(seed))
            told = AllGround(evidence, blunders(evidence))
            found = told.estimates({"P0", "P1"})
            right += {one.where["point"] for one in found} == {"P0", "P1"}
        assert right >= binom.ppf(0.001, 40, 0.95)

    def test_their_values_are_right(self):
        errors = []
        for seed in range(40):
            evidence = seen(self.low, np.random.default_rng(seed))
            for one in AllGround(evidence, blunders(evidence)).estimates({"P0", "P1"}):
                (z,) = one.parameters
                errors.append((z["value"] + 0.14) / z["sigma"])
        # Two of one block share the datum.
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=3 / np.sqrt(80))

    def test_with_one_check_point_it_may_be_the_wrong_one(self):
        evidence = seen(self.low, np.random.default_rng(1), points=3)
        found = AllGround(evidence, blunders(evidence)).estimates({"P0", "P1"})
        assert {one.kind for one in found} == {"ambiguous"}
        assert all(one.instead == "P2 in height" for one in found)

    def test_a_wrong_check_point_is_no_error_of_control(self):
        evidence = seen({4: (0, 0, 0.14)}, np.random.default_rng(1))
        told = AllGround(evidence, blunders(evidence))
        assert told.wrong.found is not None and told.estimates({"P0", "P1"}) == []

    def test_a_ground_that_is_bent_is_no_blunder(self):
        """Heights along a parabola, the noise as stated: no one or two points explain it."""
        bent = {k: (0, 0, 0.4 * (k / 7 - 0.5) ** 2 * 4) for k in range(8)}
        explained = 0
        for seed in range(40):
            evidence = seen(bent, np.random.default_rng(seed), points=8)
            wrong = blunders(evidence).found
            explained += wrong is not None and explains_all(evidence, wrong)
        assert explained == 0

    def test_true_blunders_explain_all(self):
        """But for the level."""
        kept = 0
        for seed in range(40):
            evidence = seen(self.low, np.random.default_rng(seed))
            kept += explains_all(evidence, blunders(evidence).found)
        assert kept >= binom.ppf(0.001, 40, 1 - 5 * SETTINGS.control_level)
