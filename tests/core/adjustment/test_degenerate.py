"""Inputs that place nothing, or less than all, and exact control."""

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import left_out
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.preparation import plausibility_warnings, without_impossible_points


def flown(**options):
    options = {"images": 10, "strips": 2, "observations_per_image": 40, "seed": 1} | options
    block = corridor_block(**{"control": 4, "check": 2} | options)
    return corridor.simulation.add_noise(block, tie_px=0.5, mark_px=0.5, seed=1)


def test_start_poses_at_one_place_are_refused_in_one_sentence():
    block = flown()
    block.images[["x", "y", "z"]] = [1.0, 2.0, 60.0]
    with pytest.raises(corridor.InputError, match="all 10 images stand at one place"):
        corridor.adjust(block)


def test_positions_that_are_all_the_same_are_left_out_and_said_to_be():
    block = flown()
    block.gnss[["x", "y", "z"]] = [40.0, 0.0, 60.0]
    found = corridor.adjust(block)
    assert not len(found.residuals["gnss"])
    assert any("all 10 positions are the same (40, 0, 60)" in s for s in found.warnings)
    with pytest.raises(corridor.InputError, match="place nothing"):
        corridor.adjust(block, strict=True)


def test_positions_at_two_places_are_left_out_and_said_to_be():
    block = flown(images=14)
    block.gnss[["x", "y", "z"]] = [40.0, 0.0, 60.0]
    block.gnss.loc[block.gnss.index[7:], "x"] = 41.0
    found = corridor.adjust(block)
    assert any("14 positions stand at 2 places" in s for s in found.warnings)
    # Each image of a flight has its own.
    flight = flown(images=14)
    assert len(corridor.adjust(flight).residuals["gnss"]) == 14


def test_a_climb_at_one_place_is_a_flight():
    block = flown(images=14)
    given = block.gnss.copy()
    given[["x", "y"]] = [40.0, 0.0]
    given["z"] = 60.0 + 3.0 * np.arange(14)
    block.gnss = given
    assert left_out._without_one_position(block, strict=False) == (block, [])


def test_exact_control_is_held_to_all_digits():
    block = flown()
    block.ground[["sx", "sy", "sz"]] = 0.0
    found = corridor.adjust(block)
    assert np.abs(found.residuals["control"][["vx", "vy", "vz"]]).to_numpy().max() < 1e-9
    held = flown()
    held.ground[["sx", "sy", "sz"]] = 1e-6
    assert found.sigma0 == pytest.approx(corridor.adjust(held).sigma0, rel=1e-5)


@pytest.mark.parametrize("factor", [0.6, 0.512, 1.5])
def test_marks_of_resized_pictures_are_told(factor):
    block = flown()
    assert not [s for s in plausibility_warnings(block) if "by one factor" in s]
    block.marks[["x", "y"]] = (block.marks[["x", "y"]] + 0.5) * factor - 0.5
    (told,) = [s for s in plausibility_warnings(block) if "by one factor" in s]
    assert f"{factor:.2f}" in told
    found = corridor.adjust(block)
    assert found.warnings[0] == told and found.sigma0 < 1.2 and not len(found.check_points)
    with pytest.raises(InputError, match="by one factor"):
        corridor.adjust(block, strict=True)


def test_marks_of_one_image_in_another_size_are_told_and_set_aside():
    block = flown()
    image = block.marks["image"].value_counts().index[0]
    mine = (block.marks["image"] == image).to_numpy()
    block.marks.loc[mine, ["x", "y"]] = (block.marks.loc[mine, ["x", "y"]] + 0.5) / 2 - 0.5
    left, told = without_impossible_points(block)
    assert len(told) == 1 and f"{mine.sum()} of {len(mine)} marks, in {image}, lie" in told[0]
    assert "0.50" in told[0] and "by 2.0" in told[0]
    assert not (left.marks["image"] == image).any() and len(left.marks) == (~mine).sum()
    assert corridor.adjust(block).sigma0 < 1.2
    block.marks.loc[mine, "x"] += 100 * np.arange(mine.sum())  # a blunder each is no size
    assert not without_impossible_points(block)[1]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda xy, size: xy * [1, -1] + [0, size[1] - 1], "y were counted upwards"),
        (lambda xy, size: size - 1 - xy, "turned by 180 degrees"),
        (lambda xy, size: xy * [-1, 1] + [size[0] - 1, 0], "mirrored"),
        (lambda xy, size: xy[:, ::-1], "x and y were exchanged"),
        (lambda xy, size: 0.004 * (xy - (size - 1) / 2), "from the middle, in a unit of 2"),
        (lambda xy, size: (xy - (size - 1) / 2) * [1, -1] / 100, "y upwards, in a unit of "),
    ],
)
def test_marks_of_turned_and_mirrored_pictures_are_told(change, said):
    block = flown()
    assert not [s for s in plausibility_warnings(block) if "Marks lie" in s]
    camera = next(iter(block.cameras.values()))
    size = np.array([camera.width, camera.height])
    block.marks[["x", "y"]] = change(block.marks[["x", "y"]].to_numpy(), size)
    (told,) = [s for s in plausibility_warnings(block) if "Marks lie" in s]
    assert said in told


@pytest.mark.parametrize(
    ("read", "said"),
    [
        (lambda x, y, z: (y, x, z), "x and y exchanged beside"),
        (lambda x, y, z: (y, -x, z), "x and y exchanged, and y with the opposite sign"),
        (lambda x, y, z: (x, -y, z), "y with the opposite sign"),
        (lambda x, y, z: (900.0 - x, y, z), "x with the opposite sign"),
        (lambda x, y, z: (x, y, -z), "z counted downwards"),
    ],
)
def test_ground_points_with_other_axes_are_refused_and_told(read, said):
    block = flown(relief=6.0)
    block.ground[["x", "y", "z"]] = np.stack(read(*block.numbers("ground", *"xyz").T), axis=1)
    with pytest.raises((InputError, AdjustmentFailed), match=said):
        corridor.adjust(block)


def hanging():
    """A block of 40 images of which one hangs on three points that one other image shows."""
    block = flown(images=40)
    name = str(block.images["image"].iloc[20])
    ties = block.tie_points.astype({"point": str, "image": str})
    mine = ties[ties["image"] == name]
    partner = ties[ties["point"].isin(mine["point"]) & (ties["image"] != name)]["image"].mode()[0]
    both = mine["point"][mine["point"].isin(ties.loc[ties["image"] == partner, "point"])]
    chosen = both.tolist()[:3]
    hung = ties["point"].isin(chosen)
    keep = (hung & ties["image"].isin([name, partner])) | (~hung & (ties["image"] != name))
    block.gnss = block.gnss[block.gnss["image"] != name].reset_index(drop=True)
    block.marks = block.marks[block.marks["image"] != name].reset_index(drop=True)
    ties = ties[keep]
    ties = ties[ties["point"].map(ties["point"].value_counts()) > 1]
    return block.with_(tie_points=ties.reset_index(drop=True)), name


def test_an_image_whose_pose_nothing_determines_is_left_out_by_name():
    block, name = hanging()
    found = corridor.adjust(block)
    assert found.converged and name not in found.problem.images.names
    assert any(s.startswith(f"Image {name} is left out: its pose") for s in found.warnings)
    with pytest.raises(corridor.InputError, match=f"the pose of image {name} cannot be determined"):
        corridor.adjust(block, strict=True)


def test_observations_that_were_put_in_twice_are_refused_in_memory_too():
    block = flown()
    again = block.tie_points.iloc[:50]
    block.tie_points = pd.concat([block.tie_points, again], ignore_index=True)
    with pytest.raises(InputError, match="stands already in tie_points.csv"):
        corridor.adjust(block)


def test_many_wrong_matches_accuse_no_control_point():
    block = flown(images=20, observations_per_image=80, control=6)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(block.tie_points)) < 0.05
    block.tie_points.loc[wrong, "x"] += 60.0
    said = corridor.adjust(block, loss="huber:2").warnings
    assert not [note for note in said if "Ground control is wrong" in note]
