"""How often a gain in predictions is taken for one: rates on gains of strips that hang together."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from benchmarks.diagnosis.generator import single
from benchmarks.diagnosis.generator.generate import generate
from corridor.core.adjustment import Model, without_ties
from corridor.core.effects import find
from corridor.core.preparation import prepare
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification.held_out import Prediction, folds_of, hold_out, tie_gap


@pytest.mark.parametrize("strips", [4, 5, 8, 12])
@pytest.mark.parametrize("unlike", [1.0, 10.0], ids=["alike", "one ten times as noisy"])
def test_no_gain_is_taken_for_one_in_a_twentieth_of_flights(strips, unlike):
    rng = np.random.default_rng(strips)
    spread = np.r_[unlike, np.ones(strips - 1)]
    proved = sum(Prediction(spread * rng.standard_normal(strips)).proved for _ in range(2000))
    assert proved <= binom.isf(0.001, 2000, SETTINGS.doubt_level)


def test_a_gain_of_three_of_its_spreads_in_every_strip_is_seen_in_95_of_100_flights():
    rng = np.random.default_rng(1)
    proved = sum(Prediction(3.0 + rng.standard_normal(4)).proved for _ in range(400))
    assert proved >= binom.ppf(0.001, 400, 0.95)


def test_what_one_strip_alone_gains_proves_nothing():
    """However much it is."""
    for most in (1.0, 10.0, 1000.0):
        assert not Prediction(np.array([most, 0.0, 0.1, -0.1])).proved


def test_without_two_strips_nothing_can_be_proved():
    assert not Prediction(np.array([100.0])).proved
    assert not Prediction(np.zeros(0)).proved


def test_every_place_of_a_picture_is_left_out_once():
    columns, rows = SETTINGS.places
    middle = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    xy = np.tile(100.0 * middle + 49.5, (3, 1))
    image, size = np.repeat(np.arange(3), len(middle)), np.array([100.0 * columns, 100.0 * rows])
    fold = folds_of(image, xy, size, np.random.default_rng(0))
    for n in range(3):
        count = np.bincount(fold[image == n], minlength=SETTINGS.folds)
        assert count.sum() == columns * rows and np.ptp(count) <= 1


def test_turns_of_single_images_are_predicted_from_one_place_to_another_where_they_are():
    """Three times the usual ones during 25 ms, and the same flight without."""
    turning = find("rolling_shutter_rotation")
    case = single("rolling_shutter_rotation", 3.0, images=40, observations=150)
    made = generate(case, 3)
    for block, there in ((made.block, True), (made.twin, False)):
        believed = ReferenceModel.of(prepare(block).block, Model())
        bare, with_it = believed.adjust(), believed.adjust([turning])
        nothing = pd.MultiIndex.from_arrays([[], []])
        assert Prediction.of_folds(bare, with_it, nothing).proved == there
        assert not Prediction.of_folds(bare, bare, nothing).gain.any()


def test_what_a_flight_does_not_know_stays_near_zero_and_what_it_knows_where_it_is():
    """z of a lever arm has 0.9 m in a nadir strip, x 15 mm; half a metre does not happen."""
    arm = find("lever_arm")
    scale = np.full(3, 0.05)
    group = Group(
        "lever_arm", arm, None, np.arange(3), scale, [("block", k, "m") for k in "xyz"],
        most=np.full(3, 0.5),
    )  # fmt: skip
    sigma, value = np.array([0.015, 0.015, 0.9]), np.array([0.2, -0.1, 1.5])
    M = np.diag((scale / sigma) ** 2)
    found = scale * np.linalg.solve(M + np.diag(group.free**-2.0), M @ (value / scale))
    assert found[:2] == pytest.approx(value[:2], rel=0.005)
    assert abs(found[2]) < 0.5 / 2


def test_fits_that_leave_out_different_points_are_compared_by_what_both_have():
    """A refit may draw a point of nearly parallel rays into a camera, and leave it out."""
    block = generate(single("rolling_shutter", 1.0, images=16, observations=80), 1).twin
    believed = ReferenceModel.of(prepare(block).block, Model())
    believed.adjust()
    held_block, held = hold_out(believed.block, np.random.default_rng(0))
    whole = believed.adjust(block=held_block)
    first = set(held_block.tie_points["point"].astype(str).unique()[:5])
    fewer = believed.adjust(block=without_ties(held_block, first))
    gap = tie_gap(whole, fewer, held)
    assert gap["after"] == pytest.approx(gap["before"], rel=0.02)
    assert np.isfinite(Prediction.of_folds(whole, fewer, held).gain).all()
