"""Chapter 5 of Zhou 2019 planned: what table 5.3 rests on (issue 8, must show 1 to 4)."""

import time
from dataclasses import replace

import numpy as np
import pytest
from small_plans import quickest

from corridor.core.simulation import TiePoints, read_plan
from corridor.tools.planning import GnssNoise, Planner

BOTH = "thesis_s2_n50+thesis_s2_o50"
ALL = "thesis_s2_n50+thesis_s2_o50+thesis_s2_n3070"
ONE = "thesis_s1_n50"
SEVEN = GnssNoise(bias_m=(0.0, 0.0, 0.07))


def plan_of(name):
    # 300 observations an image, as the thesis has after its tie points are thinned.
    return replace(read_plan(name), tie_points=TiePoints(300))


@pytest.fixture(scope="module")
def planners():
    Planner(plan_of(ONE))  # compiles, or loads what was compiled
    return {name: Planner(plan_of(name)) for name in (BOTH, ALL, ONE)}


def nadir(planner, control):
    table = planner.expect(control).correlations
    return table[table["view"] == "nadir"].iloc[0]


@pytest.mark.parametrize(
    "name",
    [BOTH, pytest.param(ALL, marks=pytest.mark.slow), pytest.param(ONE, marks=pytest.mark.slow)],
)
def test_without_control_height_and_lever_arm_are_one(planners, name):
    """Table 5.3: 0.99 in every row."""
    assert nadir(planners[name], 0).height_arm >= 0.97


@pytest.mark.parametrize("name", [BOTH, ALL])
def test_one_control_point_parts_them_where_oblique_images_are(planners, name):
    """Table 5.3: 0.80 and 0.62."""
    planner = planners[name]
    assert nadir(planner, 1).height_arm <= nadir(planner, 0).height_arm - 0.05


def test_one_control_point_does_not_part_them_in_a_nadir_flight(planners):
    """Table 5.3: 0.98."""
    assert nadir(planners[ONE], 1).height_arm >= 0.95


@pytest.mark.parametrize(("name", "most"), [(BOTH, 0.5), (ALL, 0.3)])
def test_oblique_images_part_lever_arm_and_focal_length(planners, name, most):
    """Table 5.3: 0.18 and 0.07."""
    assert nadir(planners[name], 0).arm_f <= most


def test_a_nadir_flight_does_not_part_lever_arm_and_focal_length(planners):
    """Our networks and the prototype's; the 0.28 of table 5.3 is not reproducible."""
    assert nadir(planners[ONE], 0).arm_f >= 0.8


def test_a_control_point_ties_lever_arm_and_focal_length_together(planners):
    """Table 5.3: 0.18 without, 0.84 with one: what is known of the height is shared."""
    assert nadir(planners[BOTH], 1).arm_f > nadir(planners[BOTH], 0).arm_f


@pytest.mark.parametrize("name", [BOTH, ALL, ONE])
def test_one_control_point_gives_a_centimetre_in_height_even_with_a_bias_of_seven(planners, name):
    """Table 5.3: 0.6, 0.8 and 0.9 cm."""
    planner = planners[name]
    assert planner.expect(1).z <= 0.010
    planner.noise = SEVEN
    biased = planner.expect(1).z, planner.expect(0).z
    planner.noise = GnssNoise()
    assert biased[0] <= 0.010
    # 8.3 and 5.9 cm in s2, 15.0 in s1.
    assert 0.06 <= biased[1] <= (0.16 if name == ONE else 0.10)


def test_a_pre_calibrated_flight_with_the_same_bias_needs_no_control_for_its_height(planners):
    """Table 5.3: 2.1 cm for s1-n50 with camera and arm of segment 2; at most 1.5 is asked."""
    planners[ALL].noise = SEVEN
    carried = planners[ALL].expect(13).carried({"s1-n50": "s2-n50"}, held=True)
    planners[ALL].noise = GnssNoise()
    s1 = Planner(plan_of(ONE), carried=carried, noise=SEVEN)
    assert s1.expect(0).z <= 0.015
    assert planners[ONE].expect(0).z > s1.expect(0).z


@pytest.mark.parametrize("name", [BOTH, ALL, ONE])
def test_a_bias_is_on_the_ground_as_it_is_without_control_and_not_in_height_with(planners, name):
    assert planners[name].expect(0).transfer == pytest.approx(np.ones(3), abs=0.02)
    assert abs(planners[name].expect(1).transfer[2]) <= 0.10


@pytest.mark.parametrize("name", [BOTH, ONE])
def test_a_fixed_lever_arm_leaves_the_bias_on_the_ground(name):
    """A calibrated camera; a free one takes some of it, in a nadir flight most."""
    planner = Planner(plan_of(name), camera="fixed", lever_arm="fixed")
    assert planner.expect(0).transfer[2] == pytest.approx(1.0, abs=0.02)
    assert planner.expect(1).transfer[2] == pytest.approx(1.0, abs=0.05)


def test_the_whole_segment_is_set_up_in_five_seconds_and_a_control_set_takes_no_time(planners):
    """838 images, 300 observations each: 5 s of one core, 5 ms a control set."""
    assert len(planners[ALL].block.images) == 838
    began = time.process_time()
    planner = Planner(plan_of(ALL))
    planner.expect(0).summary()
    assert time.process_time() - began < 5.0
    assert quickest(lambda: planner.expect(3)) < 0.005


def test_a_bias_with_a_prior_is_worth_more_than_another_flight(planners):
    """Bias 3, 1, 7 cm, half the noise correlated, one control point."""
    bad = GnssNoise(correlated=0.5, bias_m=(0.03, 0.01, 0.07))
    planners[ALL].noise = bad
    another = planners[ALL].expect(1).d3
    planners[ALL].noise = GnssNoise()
    priors = {f"gnss_bias.{axis}": 0.05 for axis in "xyz"}
    prior = Planner(plan_of(BOTH), effects=["gnss_bias"], priors=priors, noise=bad)
    assert prior.expect(1).d3 < 0.5 * another
