"""Images that lie turned against their start poses: the measurements say what is turned."""

import numpy as np
import pytest
from test_gross_errors import accuracy, flown

import corridor
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.preparation import quarters_of, turned_back, turned_by


def viewed(block, which, turn):
    """The block with the pictures of some images turned clockwise by quarters, as a viewer does."""
    (camera,) = block.cameras.values()
    names = set(block.images["image"].astype(str).to_numpy()[which])
    for name in ("tie_points", "marks"):
        table = getattr(block, name).copy()
        mine = table["image"].astype(str).isin(names).to_numpy()
        x, y = table.loc[mine, ["x", "y"]].to_numpy(float).T
        for quarter in range(turn):
            # The last row becomes the first column.
            height = camera.width if quarter % 2 else camera.height
            x, y = height - 1 - y, x
        table.loc[mine, ["x", "y"]] = np.stack([x, y], axis=1)
        setattr(block, name, table)
    return block


@pytest.mark.parametrize("turn", [1, 2, 3])
def test_turning_back_undoes_what_a_viewer_did(turn):
    block = flown(50)
    changed = viewed(block.copy(), np.arange(5, 8), turn)
    angle = turned_by(changed)
    assert np.flatnonzero(angle).tolist() == [5, 6, 7]
    assert set(quarters_of(angle)[5:8]) == {turn}
    back = turned_back(changed, quarters_of(angle))
    for name in ("tie_points", "marks"):
        assert back.numbers(name, "x", "y") == pytest.approx(block.numbers(name, "x", "y"))


def test_nothing_is_turned_in_a_block_as_flown():
    assert not turned_by(flown(51)).any()


@pytest.mark.parametrize(
    ("which", "turn"), [(slice(5, 8), 2), (slice(12, 24), 2), (slice(3, 5), 1)]
)
def test_pictures_that_a_viewer_turned_are_turned_back(which, turn):
    block = flown(50)
    right = accuracy(corridor.adjust(block))
    found = corridor.adjust(viewed(block, which, turn))
    assert any("so they are turned back here" in note for note in found.notes)
    assert not any("ground point" in note and "set aside" in note for note in found.notes)
    assert accuracy(found) == pytest.approx(right, abs=1e-4)


def test_a_wrong_yaw_is_the_start_poses_own():
    """The measurements are right, and what the start says of twelve images is the way back."""
    block = flown(52)
    right = accuracy(corridor.adjust(block))
    pose = block.poses.copy()
    about = np.diag([-1.0, -1.0, 1.0])
    pose[12:24, 3:] = quaternion_from_rotation(about @ rotation_from_quaternion(pose[12:24, 3:]))
    block.put("images", ("x", "y", "z", "qw", "qx", "qy", "qz"), pose)
    found = corridor.adjust(block)
    assert any("the start poses are wrong" in note for note in found.notes)
    assert accuracy(found) == pytest.approx(right, abs=1e-4)


def test_a_diagnosis_of_turned_pictures_finds_no_effect():
    found = corridor.diagnose(viewed(flown(50), slice(12, 24), 2))
    assert found.verdict == "nothing"
    assert any("so they are turned back here" in note for note in found.notes)
