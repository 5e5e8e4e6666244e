"""Tests of many numbers, and the points that stand still."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from corridor.tools.change import significance
from corridor.tools.change.points import PointChanges
from corridor.tools.change.registration import motions_at, s_transformation, stable_weights
from corridor.tools.change.significance import congruency, discoveries, normal_scores, two_sided


def test_discoveries_of_the_paper():
    """Benjamini and Hochberg 1995, section 3.2: fifteen tests, four rejected at 0.05."""
    p = [0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262,
         0.5719, 0.6528, 0.7590, 1.0]  # fmt: skip
    assert discoveries(np.array(p), 0.05).sum() == 4


def test_what_is_not_known_is_never_significant():
    assert list(discoveries(np.array([np.nan, 1e-9]), 0.01)) == [False, True]


def test_the_global_test_errs_as_often_as_its_level_says():
    draw = np.random.default_rng(1)
    mixed = draw.normal(size=(6, 4))
    covariance = mixed @ mixed.T  # singular: four directions of six
    found = [congruency(mixed @ draw.normal(size=4), covariance) for _ in range(1000)]
    assert {one.freedom for one in found} == {4}
    errors = sum(one.probability < 0.05 for one in found)
    low, high = binom.ppf([0.0005, 0.9995], 1000, 0.05)
    assert low <= errors <= high


@pytest.mark.parametrize("kind", ["translation", "rigid", "similarity"])
def test_points_that_move_do_not_carry_the_datum(kind):
    """Twelve points float by a whole motion, three of them sink by 50 mm: these are told."""
    draw = np.random.default_rng(2)
    xyz = draw.uniform(-50, 50, (12, 3)) * [1.0, 1.0, 0.1]
    motions = motions_at(xyz, kind).reshape(36, -1)
    floating = motions @ draw.normal(0, 1e-3, motions.shape[1])
    change = floating + draw.normal(0, 0.002, 36)
    change[[2, 11, 23]] -= 0.05
    weight = stable_weights(change, motions, np.full(36, 0.002))
    left = change - motions @ (s_transformation(motions, weight) @ change)
    assert np.abs(np.delete(left, [2, 11, 23])).max() < 0.012
    np.testing.assert_allclose(left[[2, 11, 23]], -0.05, atol=0.012)


def test_an_s_transformation_takes_out_motions_and_nothing_else():
    xyz = np.random.default_rng(3).uniform(-10, 10, (8, 3))
    motions = motions_at(xyz, "similarity").reshape(24, 7)
    away = np.eye(24) - motions @ s_transformation(motions, np.ones(24))
    np.testing.assert_allclose(away @ motions, 0.0, atol=1e-10)
    np.testing.assert_allclose(away @ away, away, atol=1e-10)


def test_a_point_is_not_localised_while_nothing_as_a_whole_changes():
    """One displacement of 3.5 sigma by itself is significant at 1 %; without a change of all that
    was compared it is undecided, and so it is where effects leave nothing of it."""
    points = PointChanges(
        names=np.array(["A", "B"], dtype=object), xyz=np.zeros((2, 3)),
        shift=np.array([[0.0, 0.0, 0.035], [0.0, 0.0, 0.001]]), covariance=1e-4 * np.eye(6),
        held=np.zeros(2, bool), probability=np.array([0.006, 0.99]),
        moved=np.array([True, False]), overall=congruency(np.zeros(6), np.eye(6)),
        functions=None,
    )  # fmt: skip
    shift, covariance = points.shift.ravel(), points.covariance
    told = points.beside_effects(2.0 * shift, covariance, 0.01, changed=True)
    assert list(told.frame["verdict"]) == ["moved", "stable"]
    alone = points.beside_effects(2.0 * shift, covariance, 0.01, changed=False)
    assert list(alone.frame["verdict"]) == ["undecided", "stable"]
    explained = points.beside_effects(0.1 * shift, covariance, 0.01, changed=True)
    assert list(explained.frame["verdict"]) == ["undecided", "stable"]
    assert not explained.stable[0] and not explained.moved[0]


def test_the_point_that_leads_is_the_one_that_no_effect_could_have_moved():
    """B is 8 sigmas away, which an effect explains; A is 5 away, which none does."""
    points = PointChanges(
        names=np.array(["A", "B"], dtype=object), xyz=np.zeros((2, 3)),
        shift=np.array([[0.0, 0.0, 0.05], [0.08, 0.0, 0.0]]), covariance=1e-4 * np.eye(6),
        held=np.zeros(2, bool), probability=np.array([1e-5, 1e-9]), moved=np.ones(2, bool),
        overall=congruency(np.zeros(6), np.eye(6)), functions=None,
    )  # fmt: skip
    assert list(points.leading) == [1, 0]
    beside = replace(points, beside=np.array([1e-4, 0.3]))
    assert list(beside.leading) == [0, 1]


def test_student_counts_as_the_normal_number_that_is_as_unlikely():
    """Tables of Student's t: 12.706 with one degree of freedom and 1.96 both leave 5 %."""
    scores = normal_scores(np.array([12.7062, -1.959964]), np.array([1.0, np.inf]))
    np.testing.assert_allclose(scores, [1.959964, -1.959964], atol=1e-5)
    np.testing.assert_allclose(two_sided(np.array([2.0860]), 20.0), 0.05, atol=1e-5)


def test_a_scale_that_a_few_numbers_tell_proves_no_change_as_a_whole():
    """A hundred changes a third beyond their sigma: chi square says so once in a million, F with
    ten degrees of freedom below (tables: 2.6 at 5 %) does not."""
    value = 1.35 * np.tile([1.0, -1.0], 50)
    sure, known = np.full(100, np.inf), np.eye(100)
    assert significance.tested(value, known, 0.01, sure).significant
    few = np.full(100, 10.0)
    assert not significance.tested(value, known, 0.01, few, redundancy=10.0).significant
