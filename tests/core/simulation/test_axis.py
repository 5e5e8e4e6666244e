"""The axis of a corridor: straight lines and arcs, by plane geometry."""

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.simulation.axis import Axis

# 300 m north, then 200 m east: a right angle to the right, rounded with r = 100 m about (100, 200).
RIGHT_ANGLE = Axis([(0, 0), (0, 300), (200, 300)], bend_radius=100)
ARC = 100 * np.pi / 2
# A river: bends to both sides, none of them square.
WINDING = Axis([(0, 0), (100, 250), (400, 300), (500, 100), (800, 150)], bend_radius=60)


def test_a_right_angle_is_as_long_as_its_straight_parts_and_a_quarter_circle():
    """The arc takes r tan 45 degrees = 100 m of both legs: 200 + 100 pi / 2 + 100."""
    assert RIGHT_ANGLE.length == pytest.approx(300 + ARC, rel=1e-14)


def test_points_of_the_arc_lie_a_radius_from_its_centre():
    position, _ = RIGHT_ANGLE.at(200 + np.linspace(0, ARC, 50))
    # Coordinates of 300 m hold 6e-14 m.
    assert np.hypot(*(position - [100, 200]).T) == pytest.approx(100, abs=1e-12)


def test_the_arc_begins_and_ends_on_the_legs():
    position, tangent = RIGHT_ANGLE.at([200, 200 + ARC / 2, 200 + ARC])
    half = 100 * np.sqrt(0.5)
    assert position == pytest.approx(
        np.array([[0, 200], [100 - half, 200 + half], [100, 300]]), abs=1e-12
    )
    assert tangent == pytest.approx(
        np.array([[0, 1], [np.sqrt(0.5), np.sqrt(0.5)], [1, 0]]), abs=1e-12
    )


@pytest.mark.parametrize("axis", [RIGHT_ANGLE, WINDING], ids=["right angle", "winding"])
class TestEveryAxis:
    def test_stations_are_lengths_along_it(self, axis):
        """A chord of 1 cm on an arc of 60 m is short by s^3 / 24 r^2 = 1e-11 m, 1e-9 of it."""
        station = np.arange(0, axis.length, 0.01)
        position, _ = axis.at(station)
        walked = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(position, axis=0).T))])
        assert np.abs(walked - station).max() < 2e-9 * axis.length

    def test_the_tangent_is_the_derivative_of_the_position(self, axis):
        station = np.linspace(-30, axis.length + 30, 400)
        step = 1e-4
        (after, _), (before, _) = axis.at(station + step), axis.at(station - step)
        _, tangent = axis.at(station)
        # Differences: step^2 / 6 r^2 = 5e-13 and 1e-13 m / 2e-4 m; next to a bend step / 2 r.
        assert np.abs((after - before) / (2 * step) - tangent).max() < 1e-6

    def test_the_tangent_has_length_one(self, axis):
        _, tangent = axis.at(np.linspace(-50, axis.length + 50, 200))
        assert np.hypot(*tangent.T) == pytest.approx(1, abs=1e-14)

    def test_it_begins_and_ends_where_the_polyline_does(self, axis):
        position, _ = axis.at([0, axis.length])
        assert position == pytest.approx(np.array(axis.vertices)[[0, -1]], abs=1e-10)

    def test_both_ends_go_on_straight(self, axis):
        position, tangent = axis.at([-40, 0, axis.length, axis.length + 40])
        assert position[0] == pytest.approx(position[1] - 40 * tangent[1], abs=1e-10)
        assert position[3] == pytest.approx(position[2] + 40 * tangent[2], abs=1e-10)

    def test_places_beside_it_lie_at_their_distance_to_the_right(self, axis):
        station = np.linspace(0, axis.length, 50)
        position, tangent = axis.at(station)
        away = axis.place(station, np.full(50, 7.0)) - position
        assert np.hypot(*away.T) == pytest.approx(7, abs=1e-10)
        # A quarter turn clockwise: the cross product of tangent and away is negative.
        assert tangent[:, 0] * away[:, 1] - tangent[:, 1] * away[:, 0] == pytest.approx(-7)


def test_north_has_the_east_on_its_right():
    place = Axis([(0, 0), (0, 10)]).place(np.array([5.0]), np.array([2.0]))
    assert place[0] == pytest.approx([2, 5], abs=1e-14)


def test_a_straight_axis_with_a_vertex_on_it_has_no_bend():
    axis = Axis([(0, 0), (30, 40), (60, 80)])
    assert axis.length == pytest.approx(100)
    assert axis.at([75.0])[0][0] == pytest.approx([45, 60])


def test_a_radius_too_large_for_the_legs_is_shrunk_to_fit():
    """Two legs of 50 m: r tan 45 degrees is at most 50 m, and nothing stays straight."""
    axis = Axis([(0, 0), (0, 50), (50, 50)], bend_radius=1000)
    assert axis.length == pytest.approx(50 * np.pi / 2)


def test_two_corners_share_the_leg_between_them():
    """A step of 40 m: each arc gets 20 m of it, so r = 20 m and the legs keep 80 m each."""
    axis = Axis([(0, 0), (0, 100), (40, 100), (40, 200)], bend_radius=1000)
    assert axis.length == pytest.approx(80 + 20 * np.pi + 80)


@pytest.mark.parametrize(
    ("vertices", "says"),
    [
        ([(0, 0)], "two or more positions"),
        ([], "two or more positions"),
        ([(0, 0, 0), (1, 1, 1)], "two or more positions"),
        ([(0, 0), (0, 0), (5, 5)], "position twice"),
        ([(0, 0), (0, 100), (0, 10)], "turns back on itself"),
        # 160 degrees off straight ahead.
        ([(0, 0), (0, 100), (34.2, 6.0)], "turns back on itself"),
    ],
)
def test_a_polyline_that_nobody_can_fly_along_is_refused(vertices, says):
    with pytest.raises(InputError, match=says) as refused:
        Axis(vertices)
    assert "\n" not in str(refused.value)
