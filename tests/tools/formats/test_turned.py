"""Photographs that a viewer has turned are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from corridor.core.geometry import rotation_from_quaternion, rotation_from_vector
from corridor.core.photographs import Metadata, photographs_in, read_metadata
from corridor.tools.formats import Project
from corridor.tools.formats.heading import headings
from corridor.tools.formats.starting import can_start, rotation_of
from corridor.tools.formats.turned import _turned_back, upside_down, with_turned, yaw_of

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


SIX = [7, 8, 9, 10, 11]
LENS = {"k1": -0.06, "k2": 0.03, "p1": 0.0011, "p2": -0.0007}


def flown(turned=(), lens=LENS, **said):
    """A survey of three strips to and fro, pixels good to 0.3 px, and what its photographs say.

    turned: rows whose pixels a viewer has turned. said: of yaw and flight_yaw, by the true yaw.
    """
    block = exact_block(seed=5, images=18, points=400, **lens)
    rng = np.random.default_rng(3)
    for table in (block.tie_points, block.marks):
        table[["x", "y"]] += rng.normal(0, 0.3, (len(table), 2))
    yaw = yaw_of(rotation_from_quaternion(block.poses[:, 3:]))
    project = Project("photos", Path("flight"), block)
    if turned:
        project = _turned_back(project, np.array(turned))
    files = [Path(name) for name in block.images["image"]]
    photos = {
        row: Metadata(file, 4000, 3000, make="DJI", pitch=-90.0, roll=0.0,
                      **{name: float(of(yaw)[row]) for name, of in said.items()})
        for row, file in enumerate(files)
    }  # fmt: skip
    return project, photos


def absolute(yaw):
    return yaw + np.random.default_rng(7).normal(0, 2, len(yaw))


def of_the_nose(yaw):
    return np.random.default_rng(8).normal(0, 2, len(yaw))


def test_what_a_viewer_turned_is_turned_back_where_yaw_and_residuals_say_so():
    upright = flown()[0].block
    found = with_turned(*flown(SIX, yaw=absolute, flight_yaw=absolute))
    (said,) = found.notes
    assert said.startswith("5 of 18 photographs are turned by 180 degrees")
    assert "IMG_0007.JPG to IMG_0011.JPG" in said and "were turned back" in said
    for name in ("tie_points", "marks"):
        back, was = (getattr(block, name)[["x", "y"]] for block in (found.block, upright))
        assert back.to_numpy() == pytest.approx(was.to_numpy(), abs=1e-9)
    turn = rotation_from_quaternion(found.block.poses[:, 3:])
    assert turn == pytest.approx(rotation_from_quaternion(upright.poses[:, 3:]), abs=1e-12)


def test_of_another_programs_project_nothing_is_turned_but_the_originals_are_asked_for():
    project, photos = flown(SIX, yaw=absolute)
    found = with_turned(replace(project, form="colmap"), photos)
    (said,) = found.warnings
    assert "take the originals" in said
    assert found.block.tie_points.equals(project.block.tie_points)


@pytest.mark.parametrize(
    "said",
    [
        {"yaw": absolute, "flight_yaw": absolute},
        {"yaw": of_the_nose, "flight_yaw": absolute},  # a Mavic Mini
        {"yaw": of_the_nose},
        {"flight_yaw": absolute},
        {"yaw": lambda yaw: absolute(yaw) + 90, "flight_yaw": absolute},  # a gimbal held aside
        {"yaw": lambda yaw: np.random.default_rng(9).uniform(-180, 180, len(yaw))},
        {},
    ],
)
def test_no_good_photograph_is_called_turned(said):
    project, photos = flown(**said)
    found = with_turned(project, photos)
    assert found.warnings == [] and found.notes == []
    assert found.block.tie_points.equals(project.block.tie_points)


def test_a_yaw_that_the_residuals_contradict_turns_nothing():
    def half_wrong(yaw):
        return absolute(yaw) + 180 * np.isin(np.arange(len(yaw)), SIX)

    project, photos = flown(yaw=half_wrong, flight_yaw=half_wrong)
    found = with_turned(project, photos)
    (said,) = found.notes
    assert "the residuals fit the pictures as they are: nothing was turned" in said
    assert found.block.tie_points.equals(project.block.tie_points)


def test_where_the_lens_tells_nothing_nothing_is_turned_and_that_is_said():
    project, photos = flown(SIX, {"cx": 1999.5, "cy": 1499.5}, yaw=absolute)
    found = with_turned(project, photos)
    (said,) = found.warnings
    assert "neither prove nor disprove" in said
    assert found.block.tie_points.equals(project.block.tie_points)


def test_brightons_yaws_contradict_the_poses_of_the_six_that_a_viewer_turned(real_data):
    photos = [read_metadata(file) for file in photographs_in(real_data / "brighton" / "photos")]
    found = headings(photos)
    # As the pictures show it: all eighteen the same way round.
    seen = np.full(len(photos), 44.0)
    names = [photos[row].name for row in np.flatnonzero(upside_down(seen, found.yaw))]
    assert names == [f"DJI_{n:04d}.JPG" for n in TURNED]
    assert all(one.says == "agrees" for one in found.witnesses)


@pytest.mark.parametrize("name", ["i_sfm", "sheffield_cross", "special_plot"])
def test_real_gimbals_and_flights_agree(name, real_data):
    photos = [read_metadata(file) for file in photographs_in(real_data / name / "photos")]
    found = headings(photos)
    assert found.source == "the yaw of the gimbal" and found.witnesses[0].says == "agrees"
    assert found.yaw == pytest.approx([photo.yaw for photo in photos])


def test_gimbals_that_count_from_the_nose_are_added_to_the_flights_yaw():
    _, photos = flown(yaw=of_the_nose, flight_yaw=absolute)
    found = headings(list(photos.values()))
    off = found.yaw - [photo.flight_yaw for photo in photos.values()]
    assert off == pytest.approx([photo.yaw for photo in photos.values()])
    assert "nose" in found.witnesses[0].text


@pytest.mark.parametrize(
    ("maker", "pitch", "tags"),
    [("DJI", -90.0, {"GimbalYawDegree": "30"}), ("Parrot", 0.0, {})],
)
def test_a_camera_that_looks_down_starts_so(maker, pitch, tags):
    photo = Metadata(
        Path("a.jpg"), 4000, 3000, make=maker, yaw=30.0, pitch=pitch, roll=0.0, tags=tags
    )
    assert rotation_of(photo, 30.0) == pytest.approx(looking_down(np.array([30.0]))[0], abs=1e-12)
    assert not can_start([photo])
