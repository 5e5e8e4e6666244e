"""Photographs that a viewer has turned are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from corridor.core.block import POSE
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.core.photographs import Metadata, photographs_in, read_metadata
from corridor.tools.formats import Project
from corridor.tools.formats.starting import can_start, rotation_of
from corridor.tools.formats.turned import said_yaw, upside_down, with_turned, yaw_of

from .conftest import exact_block

TURNED = range(24, 30)


def looking_down(yaw_deg):
    """World to camera, the top of the picture to this yaw: x right, y down in the picture."""
    yaw = np.radians(yaw_deg)
    north_up = np.diag([1.0, -1.0, -1.0])
    about = rotation_from_vector(np.column_stack([np.zeros((len(yaw), 2)), yaw]))
    return north_up @ about


def test_the_yaw_of_a_pose_is_where_the_top_of_the_picture_points():
    yaw = np.array([-170.0, -45.0, 0.0, 30.0, 90.0])
    assert yaw_of(looking_down(yaw)) == pytest.approx(yaw)


@pytest.mark.parametrize("whole", [0.0, 77.0, 180.0])
def test_the_turned_ones_are_found_whatever_way_the_block_is_turned(whole):
    rng = np.random.default_rng(1)
    said = np.repeat([0.0, 180.0, 0.0], 10)
    seen = said + rng.normal(0, 6, 30) + whole
    seen[20:26] += 180
    assert np.flatnonzero(upside_down(seen, said)).tolist() == list(range(20, 26))
    seen[3] = np.nan
    assert not upside_down(seen, said)[3]


def test_yaws_that_tell_nothing_name_nobody():
    rng = np.random.default_rng(2)
    said = rng.uniform(-180, 180, 40)
    assert not upside_down(rng.uniform(-180, 180, 40), said).any()
    assert not upside_down(said + 180, said).any()  # mounted so
    assert not upside_down(said[:3] + [0, 0, 180], said[:3]).any()


def brighton(real_data, turned):
    """A project with poses made from the photographs' yaw, and their metadata."""
    files = photographs_in(real_data / "brighton" / "photos")
    photos = {row: read_metadata(file) for row, file in enumerate(files)}
    block = exact_block(images=len(files), names="DJI_{:04d}.JPG")
    named = dict(zip(block.images["image"], (photo.name for photo in photos.values()), strict=True))
    block.images["image"] = block.images["image"].map(named)
    for table in (block.tie_points, block.marks):
        table["image"] = table["image"].cat.rename_categories(named)
    yaw = np.array([said_yaw(photo) for photo in photos.values()])
    yaw += [180.0 * (int(p.name[4:8]) in turned) for p in photos.values()]
    block.images[list(POSE[3:])] = quaternion_from_rotation(looking_down(yaw + 5.0))
    return Project("made", files[0].parent, block), photos


def test_brighton_names_the_six_that_a_viewer_turned(real_data):
    (said,) = with_turned(*brighton(real_data, TURNED)).warnings
    assert said.startswith("6 of 18 photographs are turned by 180 degrees")
    assert "DJI_0024.JPG to DJI_0029.JPG;" in said and "turn them back" in said
    assert "Microsoft Windows Photo Viewer" in said


def test_pictures_that_stand_as_they_say_give_no_warning(real_data):
    assert with_turned(*brighton(real_data, ())).warnings == []


def test_what_was_mapped_from_the_photographs_is_turned_back(real_data):
    project, photos = brighton(real_data, TURNED)
    upright = brighton(real_data, ())[0].block
    size = upright.cameras["P1"].width - 1, upright.cameras["P1"].height - 1
    taken = [photo.name for photo in photos.values() if int(photo.name[4:8]) in TURNED]
    tables = {}
    for name in ("tie_points", "marks"):
        table = getattr(upright, name)
        mine = table["image"].isin(taken).to_numpy()
        assert mine.any() and not mine.all()
        pixels = table[["x", "y"]].to_numpy()
        pixels = np.where(mine[:, None], np.array(size) - pixels, pixels)
        tables[name] = table.assign(x=pixels[:, 0], y=pixels[:, 1])
    project = replace(project, form="photos", block=replace(project.block, **tables))
    back = with_turned(project, photos)
    assert back.warnings == [] and "6 of 18" in back.notes[-1]
    assert "their measurements were turned back" in back.notes[-1]
    for name in tables:
        found, was = (getattr(block, name)[["x", "y"]] for block in (back.block, upright))
        assert found.to_numpy() == pytest.approx(was.to_numpy(), abs=1e-9)
    turn = rotation_from_quaternion(back.block.poses[:, 3:])
    assert turn == pytest.approx(rotation_from_quaternion(upright.poses[:, 3:]), abs=1e-12)


@pytest.mark.parametrize(
    ("maker", "pitch", "tags"),
    [("DJI", -90.0, {"GimbalYawDegree": "30"}), ("Parrot", 0.0, {})],
)
def test_a_camera_that_looks_down_starts_so(maker, pitch, tags):
    photo = Metadata(
        Path("a.jpg"), 4000, 3000, make=maker, yaw=30.0, pitch=pitch, roll=0.0, tags=tags
    )
    assert rotation_of(photo) == pytest.approx(looking_down(np.array([30.0]))[0], abs=1e-12)
    assert not can_start([photo])
