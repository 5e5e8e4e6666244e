"""Flight plans: what a file says is what the plan holds."""

from dataclasses import fields, replace

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.simulation import (
    ORDINARY_NOISE,
    Flight,
    Plan,
    Start,
    TiePoints,
    cameras,
    read_plan,
    ready_made,
)
from corridor.core.simulation.axis import Axis

EVERYTHING = """
name = "all of it"
source = "made up"
description = "every table of a plan"
axis_m = [[0, 0], [0, 100], [50, 150]]
bend_radius_m = 40
gnss = false

[terrain]
relief_m = 2
level_m = 120
roughness_m = 0.1

[tie_points]
per_image = 100
border_px = 20
match_angle_deg = 25
match_scale = 1.5

[ground]
control = 3
check = 4
layout = "spread"
offset_m = 9
check_from_ties = 50
within_m = 20

[noise]
tie_px = 0.5
gnss_m = [0.01, 0.02, 0.03]
rounding_px = 1e-3

[start]
centre_m = 1
camera = { f = 50, k1 = 0.01 }

[effects.rolling_shutter]
readout = 0.03

[camera.own]
width = 4000
height = 3000
f = 3500

[[flight]]
name = "first"
camera = "own"
height_m = [30, 50]
strips = 2
offsets_m = [-5, 5]
stations_m = [10, 90]
attitude_jitter_deg = [1, 2, 3]
forward = 0.7
speed_m_s = 4

[[flight]]
height_m = 60
"""


@pytest.fixture
def everything(tmp_path):
    path = tmp_path / "everything.toml"
    path.write_text(EVERYTHING, encoding="utf-8")
    return path


def test_a_plan_holds_what_its_file_says(everything):
    plan = read_plan(everything)
    assert plan.name == "all of it" and plan.gnss is False
    assert plan.axis_m == ((0, 0), (0, 100), (50, 150)) and plan.bend_radius_m == 40
    assert (plan.terrain.relief_m, plan.terrain.level_m, plan.terrain.roughness_m) == (2, 120, 0.1)
    assert plan.tie_points == TiePoints(100, 20, 25, 1.5)
    assert (plan.ground.layout, plan.ground.offset_m, plan.ground.within_m) == ("spread", 9, 20)
    # What a table [noise] does not name is ordinary noise.
    named = {"tie_px": 0.5, "gnss_m": (0.01, 0.02, 0.03), "rounding_px": 1e-3}
    assert plan.noise == replace(ORDINARY_NOISE, **named)
    assert plan.start == Start(centre_m=1.0, camera={"f": 50, "k1": 0.01})
    assert plan.effects == {"rolling_shutter": {"readout": 0.03}}
    first, second = plan.flights
    assert first.heights.tolist() == [30, 50] and first.attitude_jitter_deg == (1, 2, 3)
    assert first.offsets_m == (-5, 5) and first.stations_m == (10, 90)
    assert plan.camera(first)["f"] == 3500
    # A flight without a name is called by its number.
    assert second.name == "2" and plan.camera(second) == cameras()["camlight"]


def test_a_plan_is_called_after_its_file(tmp_path):
    path = tmp_path / "dam.toml"
    path.write_text("[[flight]]\nheight_m = 50\n")
    assert read_plan(str(path)).name == "dam"


def test_what_is_left_out_is_the_default(tmp_path):
    path = tmp_path / "least.toml"
    path.write_text("[[flight]]\nname = 'a'\nheight_m = 50\n")
    assert read_plan(path) == Plan("least", (Flight("a", 50.0),))


def test_one_height_is_that_of_all_strips():
    assert Flight("a", 50.0, strips=3).heights.tolist() == [50, 50, 50]
    assert Flight("a", (30.0, 70.0), strips=2).heights.tolist() == [30, 70]


def test_plans_joined_by_a_plus_are_flown_in_that_order_over_the_first_ones_ground():
    joined = read_plan("thesis_road+thesis_50vt")
    road, dike = read_plan("thesis_road"), read_plan("thesis_50vt")
    # A flight of another axis keeps its own.
    own = [replace(flight, axis_m=dike.axis_m) for flight in dike.flights]
    assert joined.flights == (*road.flights, *own)
    for key in ("axis_m", "terrain", "noise", "ground", "gnss"):
        assert getattr(joined, key) == getattr(road, key)
    assert road.source in joined.source and dike.source in joined.source
    assert joined == road + dike


def test_a_folder_of_the_same_name_does_not_hide_a_ready_made_plan(tmp_path, monkeypatch):
    """`corridor simulate thesis_50vt -o thesis_50vt`, twice."""
    (tmp_path / "thesis_50vt").mkdir()
    monkeypatch.chdir(tmp_path)
    assert read_plan("thesis_50vt").name == "thesis_50vt"


def test_a_plan_file_needs_no_ending(everything, tmp_path):
    assert read_plan(everything.rename(tmp_path / "plan.txt")).name == "all of it"


def test_a_change_is_made_to_every_flight():
    plan = read_plan("thesis_50vt+thesis_50ob").with_flights(tilt_deg=20.0)
    assert [flight.tilt_deg for flight in plan.flights] == [20, 20]
    assert [flight.images for flight in plan.flights] == [42, 44]


def test_the_axis_of_a_plan_is_its_polyline():
    plan = Plan("p", (Flight("a", 50.0),), ((0, 0), (0, 100), (80, 160)), 30.0)
    assert plan.axis == Axis(((0, 0), (0, 100), (80, 160)), 30.0)


def test_a_camera_of_the_plan_goes_before_one_of_the_same_name(everything):
    own = read_plan(everything).cameras["own"]
    flight = Flight("a", 50.0, camera="camlight")
    assert Plan("p", (flight,), cameras={"camlight": own}).camera(flight) is own


def test_every_key_of_a_flight_is_told_of_in_its_docstring():
    """A plan is written by people who have nothing else to look at."""
    assert [entry.name for entry in fields(Flight) if entry.name not in Flight.__doc__] == []


def test_cameras_state_where_they_come_from_and_sit_near_the_middle():
    """A principal point is within 3 % of the picture's middle, f is the lens over the pixel."""
    for camera in cameras().values():
        middle = [(camera.width - 1) / 2, (camera.height - 1) / 2]
        assert [camera["cx"], camera["cy"]] == pytest.approx(middle, abs=0.03 * camera.width)
    # Focal lengths, mm: 35 (CamLight, P1); the L1D-20c is a 28 mm, the phone a 26 mm equivalent.
    for name, focal in (("camlight", 35.0), ("dji_p1", 35.0)):
        camera = cameras()[name]
        assert camera["f"] * camera.pixel_um / 1000 == pytest.approx(focal, rel=0.03)
    for name, focal in (("mavic2pro", 28.0), ("phone", 26.0)):
        camera = cameras()[name]
        diagonal = np.hypot(camera.width, camera.height)
        assert camera["f"] / diagonal * np.hypot(36, 24) == pytest.approx(focal, rel=0.06)


def test_ready_made_plans_are_told_apart_by_name_and_state_their_source():
    for name in ready_made():
        plan = read_plan(name)
        assert plan.name == name and plan.description and "Zhou 2019" in plan.source


def test_an_unknown_name_is_refused_with_the_nearest():
    with pytest.raises(InputError, match="did you mean thesis_50ob"):
        read_plan("thesis_50vt+thesis_50bo")
