"""A free network laid on its control: a block that was moved as a whole comes back."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_up import corridor
from strips import corridor_block

from corridor.core.adjustment import adjust, lay_on_control
from corridor.core.errors import InputError
from corridor.core.geometry import Similarity, rotation_from_vector

MOVED = Similarity(
    1.02, rotation_from_vector(np.array([0.02, -0.05, 1.3])), np.array([40, -9, 6.0])
)
ROLES = ["control", "check", "check", "control", "check", "check", "control"]
XYZ = ["x", "y", "z"]


@pytest.fixture
def block():
    """Seven ground points along 900 m on changing sides, every third one control."""
    return corridor()


def adjusted(block, by=MOVED, marks=None, error=None):
    """What an adjustment holds of a block that it found in another frame."""
    ground = block.ground if marks is None else block.ground.iloc[marks]
    error = np.zeros((len(ground), 3)) if error is None else error
    found = by.inverse().apply(ground[XYZ].to_numpy() + error)
    points = pd.DataFrame({"point": ground["point"], **dict(zip(XYZ, found.T, strict=True))})
    order = np.arange(len(block.images))[::-1]
    centre = by.inverse().apply(block.images[XYZ].to_numpy())
    return SimpleNamespace(
        start=block,
        points=points.assign(kind="mark"),
        # The adjustment keeps images in an order of its own.
        problem=SimpleNamespace(order=order),
        state=SimpleNamespace(centre=centre[order]),
    )


def test_a_block_moved_by_a_similarity_comes_back(block):
    laid = lay_on_control(adjusted(block))
    # Coordinates of 900 m hold 1e-13 m; seven parameters from three points lose a digit or two.
    assert laid.check_rms.d3 < 1e-10
    assert laid.centre == pytest.approx(block.images[XYZ].to_numpy(), abs=1e-10)
    assert laid.similarity.scale == pytest.approx(1.02, rel=1e-12)
    assert laid.similarity.rotation == pytest.approx(MOVED.rotation, abs=1e-10)


def test_control_positions_the_block_and_the_rest_checks_it(block):
    assert block.ground["role"].tolist() == ROLES
    laid = lay_on_control(adjusted(block))
    assert laid.check_points["point"].tolist() == ["GCP12", "GCP13", "GCP15", "GCP16"]
    given = block.ground.set_index("point").loc[laid.check_points["point"], XYZ]
    assert laid.check_points[XYZ].to_numpy().tolist() == given.to_numpy().tolist()


def test_differences_are_adjusted_minus_given_in_the_frame_of_the_ground(block):
    """An error of one check point stands in its row alone, its statistics follow by hand."""
    error = np.zeros((7, 3))
    error[2] = [0.03, -0.04, 0.12]
    laid = lay_on_control(adjusted(block, error=error))
    difference = laid.check_points[["dx", "dy", "dz"]].to_numpy()
    assert difference == pytest.approx(error[[1, 2, 4, 5]], abs=1e-10)
    # Four points, one of them off by 5 cm in plan, 12 cm in height, 13 cm in space.
    assert laid.check_rms == pytest.approx((0.025, 0.06, 0.065), abs=1e-10)
    assert laid.check_mean == pytest.approx((0.0125, 0.03, 0.0325), abs=1e-10)
    assert laid.check_std == pytest.approx((0.025, 0.06, 0.065), abs=1e-10)


def test_the_scale_is_free(block):
    """A wrong focal length scales heights and plan alike: a similarity takes that away."""
    shrunk = Similarity(0.9, np.eye(3), np.zeros(3))
    assert lay_on_control(adjusted(block, by=shrunk)).check_rms.d3 < 1e-10


def test_control_may_be_named(block):
    laid = lay_on_control(adjusted(block), control=["GCP12", "GCP13", "GCP15", "GCP16"])
    assert laid.check_points["point"].tolist() == ["GCP11", "GCP14", "GCP17"]
    assert laid.check_rms.d3 < 1e-10


def test_points_that_no_image_shows_or_nobody_uses_do_not_check(block):
    block.ground.loc[1, "role"] = "unused"
    laid = lay_on_control(adjusted(block, marks=[0, 1, 2, 3, 4, 6]))
    assert laid.check_points["point"].tolist() == ["GCP13", "GCP15"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda block: adjusted(block, marks=[0, 1, 2, 3]), "images show 2"),
        (lambda block: adjusted(block, marks=[]), "images show 0"),
    ],
)
def test_fewer_than_three_control_points_are_refused(block, change, says):
    with pytest.raises(InputError, match=says) as refused:
        lay_on_control(change(block))
    assert "\n" not in str(refused.value)


def test_control_on_one_line_is_refused(block):
    block.ground[XYZ] = np.outer(np.arange(7.0), [100.0, 50.0, 1.0])
    with pytest.raises(InputError, match="on one line"):
        lay_on_control(adjusted(block))


def test_a_name_that_is_no_ground_point_is_refused(block):
    with pytest.raises(InputError, match="GCP99"):
        lay_on_control(adjusted(block), control=["GCP11", "GCP12", "GCP13", "GCP99"])


def test_the_points_it_is_laid_on_have_residuals_too():
    """The thesis's tables 6.9 and 6.13: residuals at the ground points of the similarity itself."""
    block = corridor_block(images=12, strips=2, observations_per_image=60, seed=1)
    moved = block.ground["point"].tolist()
    laid = lay_on_control(adjust(block, control=[]), moved)
    assert laid.control_points["point"].tolist() == moved and not len(laid.check_points)
    assert laid.control_error.max() < 1e-6
    block.ground.loc[0, "z"] += 0.5
    laid = lay_on_control(adjust(block, control=[]), moved)
    assert np.argmax(laid.control_error) == 0
    # A similarity through eleven points takes up a part of it.
    assert 0.2 < laid.control_error[0] < 0.5
