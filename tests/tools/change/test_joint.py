"""Covariances of what is linear in the points of both dates."""

import numpy as np
import pytest
from made import adjusted, flown, joint

import corridor
from corridor.core.adjustment import point_regression
from corridor.core.errors import InputError
from corridor.tools.change import displacements, point_changes
from corridor.tools.change.joint import Joint


def dense(adjustment):
    """Covariance (3n, 3n) of all points from the whole matrix, inverted as such."""
    system = adjustment.stated_system
    inverse = np.linalg.inv(system.matrix.toarray())
    regression = point_regression(system, np.arange(len(system.points.names)))
    out = np.asarray(regression.gain.T @ inverse @ regression.gain)
    for k, own in enumerate(regression.own):
        out[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += own
    return adjustment.sigma0**2 * out


def test_the_variance_of_a_point_is_that_of_the_adjustment(pair, points):
    first, second = (c.epoch for c in (pair.before, pair.after))
    alone = Joint(pair.before, pair.after, common=())
    plain = point_changes(alone, 0.01, "stated", "rigid").sigma
    expected = np.hypot(
        *(
            e.adjustment.point_sigma[[cloud.named[name] for name in points.names]]
            for e, cloud in ((first, pair.before), (second, pair.after))
        )
    )
    np.testing.assert_allclose(plain, expected, rtol=1e-8)


def test_the_variance_of_a_distance_is_that_of_the_whole_matrix(pair, surface):
    expected = sum(
        np.einsum("ri,ij,rj->r", rows.toarray(), dense(cloud.epoch.adjustment), rows.toarray())
        for cloud, rows in zip(
            (pair.before, pair.after), pair.sides(surface.functions), strict=True
        )
    )
    np.testing.assert_allclose(surface.sigma**2, expected, rtol=1e-7)


def test_one_by_one_and_as_a_matrix_are_the_same(pair, surface):
    some = surface.functions[np.arange(12)]
    np.testing.assert_allclose(np.diag(pair.covariance(some)), pair.variance(some), rtol=1e-9)


def test_a_change_of_nothing_but_common_control_has_no_variance():
    """The same control, perfectly measured from perfect GNSS-free poses, errs alike both times."""
    one = adjusted(10)
    same = joint(one, one)
    apart = Joint(same.before, same.after, common=())
    names = [name for name in same.before.named if name.startswith("G")]
    functions = displacements(same.before, same.after, names)
    assert np.all(same.variance(functions) < apart.variance(functions))


def test_what_common_control_does_follows_from_moving_it():
    """The response to a control point is what the adjustment does when that point is moved."""
    block = flown(10)
    name = block.ground.loc[block.ground["role"] == "control", "point"].iloc[1]
    moved = block.copy()
    at = moved.ground["point"] == name
    moved.ground.loc[at, "z"] += 0.001
    here, there = corridor.adjust(block), corridor.adjust(moved)
    pair = joint(here, here)
    (common,) = pair.errors
    names = list(pair.before.named)
    functions = displacements(pair.before, pair.after, names)
    response = common.sides[1].response(pair.parts(functions)[1])
    control = list(here.system.control.names)
    column = 3 * control.index(name) + 2
    points = [pair.after.named[n] for n in names]
    step = (there.state.points - here.state.points)[points].ravel() / 0.001
    np.testing.assert_allclose(response[:, column], step, atol=2e-4)


def test_unknown_kind_of_common_error_is_refused():
    one = adjusted(10)
    with pytest.raises(InputError, match="'weather' is not an error that epochs can share"):
        _ = joint(one, one, common=("weather",)).errors
