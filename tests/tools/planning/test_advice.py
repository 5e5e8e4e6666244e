"""Sentences that follow from numbers."""

import pandas as pd
import pytest

from corridor.tools.planning import advice


def row(flights, nadir, oblique, control, d3, transfer=(0.6, 1.0, 0.05), **more):
    return {
        "flights": flights, "nadir": nadir, "oblique": oblique, "control": control, "d3": d3,
        "transfer_x": transfer[0], "transfer_y": transfer[1], "transfer_z": transfer[2], "open": "",
    } | more  # fmt: skip


WHOLE = (1.0, 1.0, 1.0)
TABLE = pd.DataFrame(
    [
        row("n", 1, 0, 0, 0.15, WHOLE),
        row("n", 1, 0, 1, 0.028),
        row("n+o", 1, 1, 0, 0.083, WHOLE),
        row("n+o", 1, 1, 1, 0.006),
    ]
)


def test_the_fewest_flights_then_the_fewest_points_that_reach_the_goal():
    said = advice(TABLE, [0.01, 0.03])
    first, second = said.split(". For")
    assert first.startswith(
        "For 10 mm: one nadir and one oblique flight and one control point: 6 mm"
    )
    assert second.startswith(" 30 mm: one nadir flight and one control point: 28 mm")


def test_a_point_that_makes_the_height_says_so():
    assert "without the control point the height is only as good as the GNSS" in advice(TABLE)


def test_a_point_that_changes_nothing_of_the_bias_does_not_say_so():
    """A fixed lever arm: one point does not take the bias away."""
    table = TABLE.assign(transfer_z=1.0)
    assert "without the control point" not in advice(table)


def test_what_is_left_of_a_bias_in_plan_is_said():
    assert "horizontally 100 % of its constant error remains" in advice(TABLE)
    assert "horizontally" not in advice(TABLE.assign(transfer_x=0.1, transfer_y=0.1))


def test_no_control_at_all_rests_on_the_gnss():
    table = pd.DataFrame([row("n", 1, 0, 0, 0.009, WHOLE)])
    assert advice(table, [0.01]) == (
        "For 10 mm: one nadir flight and no control points: 9 mm; but it is only as good as the "
        "GNSS, whose constant errors nothing would show."
    )


def test_one_row_that_reaches_both_goals_is_said_once():
    said = advice(TABLE[TABLE["flights"] == "n+o"], [0.01, 0.03])
    assert said.startswith("For 10 mm and 30 mm: one nadir and one oblique flight")
    assert said.count("oblique") == 1


def test_a_goal_out_of_reach_names_the_nearest():
    assert advice(TABLE, [0.001]) == (
        "None of these reaches 1.0 mm; the nearest is one nadir and one oblique flight and one "
        "control point: 6 mm."
    )


def test_flight_sets_that_sound_alike_are_told_by_name():
    table = pd.DataFrame(
        [row("low", 1, 0, 1, 0.02), row("high", 1, 0, 1, 0.009), row("a+b", 2, 1, 3, 0.004)]
    )
    assert "one nadir flight (high) and one control point" in advice(table, [0.01])
    assert "two nadir and one oblique flight and three control points" in advice(table, [0.005])


def test_what_cannot_be_adjusted_is_never_advised():
    hole = row("n", 1, 0, 0, float("nan"), open="Height cannot be determined")
    assert "one control point" in advice(pd.DataFrame([hole, row("n", 1, 0, 1, 0.01)]), [0.01])
    said = advice(pd.DataFrame([hole]), [0.01])
    assert said == "None of these flight sets can be adjusted: Height cannot be determined."


@pytest.mark.parametrize("count", [11, 39])
def test_many_points_are_written_in_digits(count):
    assert f"{count} control points" in advice(pd.DataFrame([row("n", 1, 0, count, 0.01)]), [0.02])
