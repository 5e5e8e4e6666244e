"""Strips across a corridor: a flight with a line of its own, over the same ground."""

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.simulation import Flight, Plan, read_plan, simulate
from corridor.core.simulation.axis import Axis

ALONG = Flight("along", 60.0, images=12, strips=2)
ACROSS = ((100.0, -60.0), (100.0, 60.0))


def span(block, flight):
    mine = block.images[block.images["flight"] == flight]
    return np.ptp(mine["x"]), np.ptp(mine["y"])


@pytest.mark.parametrize("joined", ["one plan", "sum", "files"])
def test_strips_follow_the_line_of_their_flight(tmp_path, joined):
    axis = ((0.0, 0.0), (200.0, 0.0))
    across = Flight("across", 60.0, images=12, strips=2, axis_m=ACROSS)
    if joined == "one plan":
        plan = Plan("both", (ALONG, across), axis_m=axis)
    elif joined == "sum":
        other = Plan("other", (Flight("across", 60.0, images=12, strips=2),), axis_m=ACROSS)
        plan = Plan("first", (ALONG,), axis_m=axis) + other
    else:
        for name, line in (("along", "[[0, 0], [200, 0]]"), ("across", "[[100, -60], [100, 60]]")):
            (tmp_path / f"{name}.toml").write_text(
                f'axis_m = {line}\n[[flight]]\nname = "{name}"\nheight_m = 60\nimages = 12\n'
                "strips = 2\n"
            )
        plan = read_plan(f"{tmp_path}/along.toml+{tmp_path}/across.toml")
    block = simulate(plan, seed=0)
    x, y = span(block, "along")
    assert x > 150 and y < 60
    x, y = span(block, "across")
    assert y > 80 and x < 60
    # Both see the same points.
    seen = block.images["flight"].to_numpy()[block.image_rows("tie_points")]
    points = [set(block.tie_points["point"][seen == name]) for name in ("along", "across")]
    assert len(points[0] & points[1]) > 20


def test_flights_of_one_name_stay_two_flights():
    one = Plan("a", (Flight("F", 60.0, images=12, strips=2),), axis_m=((0.0, 0.0), (200.0, 0.0)))
    other = Plan("b", (Flight("F", 70.0, images=12, strips=2),), axis_m=ACROSS)
    assert [flight.name for flight in (one + other).flights] == ["F", "F_b"]


@pytest.mark.parametrize("word", ["across", "cross", "perpendicular"])
def test_a_direction_across_says_how_to_write_it(word):
    with pytest.raises(InputError, match="axis_m"):
        Flight("F", 60.0, direction=word)


def test_nearest_stations_of_an_axis_with_a_bend():
    axis = Axis(((0.0, 0.0), (300.0, 0.0), (300.0, 300.0)), 50.0)
    station = np.array([-20.0, 10.0, 290.0, 400.0, axis.length + 30.0])
    places = axis.place(station, np.array([5.0, -3.0, 4.0, 2.0, -6.0]))
    assert axis.nearest(places) == pytest.approx(station, abs=0.05)


def test_a_focal_length_in_millimetres_is_told(tmp_path):
    (tmp_path / "p.toml").write_text(
        '[[flight]]\nname = "F"\nheight_m = 60\ncamera = "m"\n[camera.m]\nwidth = 5280\n'
        "height = 3956\nf = 12.29\npixel_um = 3.3\n"
    )
    with pytest.raises(InputError, match="12.29 mm are 3724"):
        read_plan(tmp_path / "p.toml")


def test_what_a_noise_table_does_not_state_is_ordinary(tmp_path):
    (tmp_path / "p.toml").write_text(
        '[[flight]]\nname = "F"\nheight_m = 60\n[noise]\ntie_px = 0.3\n'
    )
    noise = read_plan(tmp_path / "p.toml").noise
    assert (noise.tie_px, noise.mark_px, noise.control_m) == (0.3, 0.5, 0.01)
