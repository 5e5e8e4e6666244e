"""Start values are no measurement: whatever they say, the result is what the measurements say."""

import numpy as np
import pytest
from conftest import SHIPPED

import corridor
from corridor.core.adjustment.blunders import without_wild_cells
from corridor.core.block import POSE
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.core.preparation import astray, plausibility_warnings
from corridor.interface.cli import main

BLOCK = corridor.read(SHIPPED / "dike")
COUNT = len(BLOCK.images)
MIDDLE = COUNT // 2


def placed(change):
    """The shipped block with start poses (images, 7) changed."""
    block, pose = BLOCK.copy(), BLOCK.poses.copy()
    block.put("images", POSE, change(pose))
    return block


def turned(degrees):
    """Start poses turned about the axes of the world, by degrees (images, 3)."""

    def change(pose):
        turn = np.array([rotation_from_vector(one) for one in np.radians(degrees)])
        rotation = np.einsum("nij,nkj->nik", rotation_from_quaternion(pose[:, 3:]), turn)
        pose[:, 3:] = quaternion_from_rotation(rotation)
        return pose

    return change


def about(axis, degrees, images=slice(None)):
    out = np.zeros((COUNT, 3))
    out[images, axis] = degrees
    return out


def at_random(size, seed=7):
    return np.random.default_rng(seed).normal(0.0, size, (COUNT, 3))


def moved(by):
    def change(pose):
        pose[:, :3] += by
        return pose

    return change


def lost(images):
    def change(pose):
        pose[images] = np.nan
        return pose

    return change


STARTS = {
    "all headings of the way back": turned(about(2, 180.0)),
    "all headings a quarter turn off": turned(about(2, 90.0)),
    "headings that nobody knows": turned(at_random(60.0) * [0.0, 0.0, 1.0]),
    "tilts of 25 degrees": turned(at_random(25.0) * [1.0, 1.0, 0.0]),
    "one image that looks away": turned(about([0, 1, 2], [70.0, 40.0, 20.0], MIDDLE)),
    "another heading of one image": turned(about(2, 180.0, MIDDLE)),
    "two images exchanged": lambda pose: pose[np.r_[1, 0, 2:COUNT]],
    "a row too far down": lambda pose: np.roll(pose, 1, axis=0),
    "on the ground": moved([0.0, 0.0, -50.0]),
    "two kilometres too high": moved([0.0, 0.0, 2000.0]),
    **{f"image {k} without": lost([k]) for k in (6, 12, 27, 33)},
    "every second image without": lost(slice(None, None, 2)),
}


# Far from the truth the adjustment goes a long way before it is asked for another start.
SLOW = {
    "two kilometres too high", "all headings of the way back", "all headings a quarter turn off",
    "headings that nobody knows",
}  # fmt: skip


@pytest.fixture(scope="module")
def right():
    bare = BLOCK.copy()
    bare.gnss = bare.gnss.iloc[:0]
    return {True: corridor.adjust(BLOCK), False: corridor.adjust(bare)}


@pytest.mark.parametrize("gnss", [True, False])
@pytest.mark.parametrize(
    "start", [pytest.param(one, marks=pytest.mark.slow if one in SLOW else ()) for one in STARTS]
)
def test_start_values_decide_nothing(start, gnss, right):
    block = placed(STARTS[start])
    if not gnss:
        block.gnss = block.gnss.iloc[:0]
    found = corridor.adjust(block)
    assert found.converged
    assert len(found.start.images) == COUNT
    assert found.sigma0 == pytest.approx(right[gnss].sigma0, rel=1e-3)
    assert np.allclose(found.check_rms, right[gnss].check_rms, rtol=0.01)


@pytest.mark.slow
def test_nor_do_they_decide_a_diagnosis():
    found = corridor.diagnose(placed(STARTS["all headings of the way back"]))
    assert found.verdict == "nothing"


@pytest.mark.slow
def test_nor_do_they_where_they_leave_no_datum():
    """The equations of the datum could not be factored: a traceback."""
    block = corridor.read(SHIPPED / "stories" / "levee")
    right, pose = corridor.adjust(block), block.poses
    pose[:COUNT] = STARTS["one image that looks away"](pose[:COUNT])
    block.put("images", POSE, pose)
    assert np.allclose(corridor.adjust(block).check_rms, right.check_rms, rtol=0.01)


def test_start_values_that_are_not_used_are_told():
    found = corridor.adjust(placed(STARTS["one image that looks away"]))
    assert found.warnings[0].startswith("The start poses of images.csv are not used")


# --- at first sight ------------------------------------------------------------------------------


def with_cells(table, column, change):
    block = BLOCK.copy()
    frame = getattr(block, table).copy()
    values = frame[column].to_numpy(float).copy()
    change(values)
    frame[column] = values
    setattr(block, table, frame)
    return block


def filled(values):
    values[len(values) // 2 :] = values[len(values) // 2]


def all_alike(values):
    values[:] = values[0]


@pytest.mark.parametrize("change", [filled, all_alike])
@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("gnss", "x"), ("gnss", "y"), ("gnss", "z"), ("images", "x"), ("images", "z"),
        ("images", "time_s"), ("marks", "x"), ("marks", "y"), ("tie_points", "y"),
    ],
)  # fmt: skip
def test_a_column_that_was_filled_down_is_told(table, column, change):
    told = plausibility_warnings(with_cells(table, column, change))
    assert any(f"{table}.csv: {column} is " in one and "copied" in one for one in told)


@pytest.mark.parametrize("axis", "xy")
def test_ground_control_that_was_filled_down_is_refused(axis):
    with pytest.raises(corridor.InputError, match=f"ground.csv has {axis} = .* in all rows"):
        corridor.adjust(with_cells("ground", axis, all_alike))


def test_one_height_of_all_ground_control_is_told():
    found = corridor.adjust(with_cells("ground", "z", all_alike))
    assert any("All its points have the same z" in one for one in found.warnings)


def test_a_wild_start_pose_is_told_and_accuses_no_gnss():
    block = with_cells("images", "x", lambda values: np.put(values, MIDDLE, 1e20))
    told = plausibility_warnings(block)
    assert any(f"images.csv, row {MIDDLE + 2}: the start pose of " in one for one in told)
    assert np.flatnonzero(astray(block)).tolist() == [MIDDLE]
    assert not np.flatnonzero(astray(BLOCK)).size


def test_a_wild_time_is_told():
    block = with_cells("images", "time_s", lambda values: np.put(values, MIDDLE, 1e9))
    assert any("time_s is 1e+09" in one or "time_s is 1000000000" in one
               for one in plausibility_warnings(block))  # fmt: skip


def test_a_summary_is_shown_of_a_block_that_an_adjustment_refuses(tmp_path, capsys):
    block = BLOCK.copy()
    block.ground[list("xyz")] = block.ground[list("xyz")].to_numpy() / 0.3048
    block.write(tmp_path / "feet")
    assert main(["summary", str(tmp_path / "feet")]) == 0
    assert capsys.readouterr().out.count("is in feet") == 1


def test_control_that_is_named_and_not_in_the_table_is_judged_too():
    block, names = BLOCK.copy(), BLOCK.ground["point"].astype(str).tolist()
    block.ground["role"] = "check"
    block.ground["z"] = float(block.ground["z"].iloc[0])
    found = corridor.adjust(block, control=names[::2], check=names[1::2])
    assert any("All its points have the same z" in one for one in found.warnings)


def test_the_shipped_block_has_no_such_row():
    assert not plausibility_warnings(BLOCK)
    assert not without_wild_cells(BLOCK, corridor.Model())[1]
