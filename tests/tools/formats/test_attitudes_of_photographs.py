"""attitudes.csv from photographs: as they state them, with the errors that the poses show."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import corridor
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.core.photographs import Metadata
from corridor.core.preparation import derived
from corridor.tools.formats import Project
from corridor.tools.formats.attitudes import with_attitudes
from corridor.tools.formats.importing import Additions, complete
from corridor.tools.formats.starting import rotation_of

from .conftest import exact_block

BORESIGHT = rotation_from_vector(np.radians([1.5, -0.8, 2.0]))


def flown(errors_deg, seed=1, **facts):
    """A project in a local frame, 24 images to and fro, and photographs whose gimbal is off."""
    rng = np.random.default_rng(seed)
    block, photos, rotation = exact_block(images=24), {}, []
    for k in range(24):
        yaw = 30.0 + 180 * (k // 8 % 2) + rng.normal(0, 2)
        photo = Metadata(
            Path(f"IMG_{k:04d}.JPG"), 4000, 3000, make="DJI", yaw=yaw,
            pitch=-90 + rng.normal(0, 2), roll=rng.normal(0, 2), **facts,
        )  # fmt: skip
        photos[k] = photo
        level = rng.normal(0, np.radians(errors_deg))  # about heading, right and down
        turned = rotation_of(photo, yaw)
        ahead = np.r_[(turned[2, :2] - turned[1, :2]), 0.0]
        ahead /= np.linalg.norm(ahead)
        axes = np.array([ahead, [ahead[1], -ahead[0], 0.0], [0.0, 0.0, -1.0]])
        rotation.append(BORESIGHT.T @ turned @ rotation_from_vector(axes.T @ level))
    images = block.images.assign(flight="F1")
    images[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(np.array(rotation))
    frame = {"lat_deg": 47.0, "lon_deg": 8.0, "height": 400.0}
    block = replace(block, images=images, extra={"local_frame": frame})
    return Project("colmap", Path("x"), block, placed=True), photos


def test_they_are_those_of_the_gimbal_and_their_sigmas_those_of_the_poses():
    """24 errors of 0.2, 0.3 and 1 degrees: a standard deviation of them is good to 20 %."""
    project, photos = flown((0.2, 0.3, 1.0))
    made = with_attitudes(project, photos).block
    stated = [rotation_of(photo, photo.yaw) for photo in photos.values()]
    assert np.abs(made.attitude_rotations - stated).max() < 1e-9
    sigma = made.attitudes[["sroll", "spitch", "syaw"]].iloc[0].to_numpy(float)
    assert sigma == pytest.approx([0.2, 0.3, 1.0], rel=0.5)
    (row,) = [one for one in derived(made) if one.column == "attitudes"]
    assert "24 of 24 images" in row.sentence


def test_the_adjustment_finds_the_boresight_from_them():
    project, photos = flown((0.02, 0.02, 0.02))
    made = with_attitudes(project, photos).block
    # What the poses of the project are is what its image points say.
    found = corridor.adjust(exact_points(made), camera="fixed", effects=["boresight"])
    angles = found.effects.query("slug == 'boresight'")["value"].to_numpy(float)
    assert np.degrees(np.linalg.norm(angles)) == pytest.approx(
        np.linalg.norm([1.5, -0.8, 2.0]), abs=0.1
    )


def exact_points(block):
    """The block with image points as its poses see its points."""
    from corridor.core.effects.forward import predict

    seen = predict(block)
    ties, marks = block.tie_points.copy(), block.marks.copy()
    ties[["x", "y"]], marks[["x", "y"]] = seen.tie, seen.mark
    return replace(block, tie_points=ties.dropna(), marks=marks.dropna())


def test_those_that_miss_the_poses_by_far_are_left_out_and_told():
    project, photos = flown((30.0, 30.0, 60.0))
    made = with_attitudes(project, photos)
    assert not len(made.block.attitudes)
    assert "attitudes of the photographs were left out: off by" in made.warnings[0]


def test_photographs_without_attitudes_or_a_project_without_a_place_are_refused():
    project, photos = flown((0.2, 0.2, 0.2))
    bare = {row: replace(photo, yaw=None) for row, photo in photos.items()}
    adrift = replace(project, placed=False, block=replace(project.block, extra={}))
    for one, other in ((project, bare), (adrift, photos)):
        with pytest.raises(InputError, match="leave --attitudes out"):
            with_attitudes(one, other)
    with pytest.raises(InputError, match="give their folder with --photos"):
        complete(project, Additions(attitudes=True))
