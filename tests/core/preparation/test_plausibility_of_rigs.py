"""A mounting that the start poses contradict, and a rig that binds nothing, are told."""

import numpy as np
import pytest

import corridor
from corridor.core.preparation.plausibility import plausibility_warnings
from tests.rigged import mounting, quaternion, rig_table, rigged_block


@pytest.fixture(scope="module")
def rigged():
    return rigged_block(exposures=6, points=200)


def told(block, **left):
    """Sentences on the member `left`, whose table has other values."""
    table = rig_table()
    table["HEAD"]["member"]["left"] |= {"sigma_m": 0.001, "sigma_deg": 0.01} | left
    block = block.copy()
    block.extra = {**block.extra, "rig": table}
    return [one for one in plausibility_warnings(block) if "[rig.HEAD.member.left]" in one]


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (lambda q: [q[0], -q[1], -q[2], -q[3]], "from the member to the base"),
        (lambda q: [q[1], q[2], q[3], q[0]], "qw the last"),
    ],
)
def test_quaternions_of_the_other_sense_or_order_are_named(rigged, other, said):
    q = quaternion(mounting("left")[1]).tolist()
    (sentence,) = told(rigged, quaternion=other(q))
    assert said in sentence


def test_a_place_in_millimetres_is_told_and_a_right_one_is_not(rigged):
    assert told(rigged) == []
    (sentence,) = told(rigged, xyz=(1000 * mounting("left")[0]).tolist())
    assert "m from its xyz" in sentence


@pytest.mark.parametrize("named", [{}, {"exposure": [f"X{k}" for k in range(18)]}])
def test_a_rig_whose_cameras_never_fire_together_is_told_and_adjusts(rigged, named):
    block = rigged.copy()
    block.images = block.images.drop(columns="exposure").assign(**named)
    (sentence,) = told(block)
    assert "binds nothing" in sentence
    block.extra = {**block.extra, "rig": rig_table(sigma_m=0.001, sigma_deg=0.01)}
    assert corridor.adjust(block).converged
    assert np.isfinite(block.poses).all()
