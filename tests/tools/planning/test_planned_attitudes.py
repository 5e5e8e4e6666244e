"""What stated attitudes buy on the ground without control, as planned before the flight."""

from dataclasses import replace

import numpy as np
import pytest
from small_plans import NADIR, plan_of

import corridor
from corridor.tools.planning import GnssNoise, Planner

STATED = (0.02, 0.02, 0.05)


def planner(attitude_deg=None):
    """Two nadir strips in the air, with attitudes of a stated quality or none."""
    plan = plan_of(NADIR)
    if attitude_deg is not None:
        plan = replace(plan, attitudes=True, noise=replace(plan.noise, attitude_deg=attitude_deg))
    return Planner(plan, camera="fixed", noise=GnssNoise())


@pytest.fixture(scope="module")
def with_attitudes():
    return planner(STATED)


def sigmas(planner):
    """Expected sigmas (n, 3) of the check points without control, m."""
    expected = planner.expect(0)
    survey = expected.network.block.sigma["control_m"] ** 2
    return np.sqrt(expected._stated.reshape(-1, 3) - survey)


def test_they_are_those_of_the_adjustment(with_attitudes):
    """The perfect block adjusted: its covariances for unit weight, boresight among the unknowns."""
    expected = with_attitudes.expect(0)
    adjusted = corridor.adjust(with_attitudes.block, control=[], camera="fixed")
    names = list(adjusted.problem.point_names)
    rows = [names.index(name) for name in expected.check_points["point"]]
    direct = np.sqrt(adjusted.covariance.each_point[rows][:, [0, 2, 5]])
    assert sigmas(with_attitudes) == pytest.approx(direct, rel=1e-3)
    labels = with_attitudes.network.labels
    assert sum(label.startswith("boresight.") for label in labels) == 3


def test_good_attitudes_buy_accuracy_and_none_cost_any(with_attitudes):
    without, coarse, fine = sigmas(planner()), sigmas(planner(5.0)), sigmas(planner(0.002))
    stated = sigmas(with_attitudes)
    assert np.all(coarse <= without * (1 + 1e-6))
    assert np.all(stated <= coarse * (1 + 1e-6)) and np.all(fine <= stated * (1 + 1e-6))
    assert fine.mean() < 0.9 * without.mean()
