"""The picture of error against number of control points."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from corridor.interface.figures import accuracy_by_control

COUNTS = np.array([0, 1, 3, 5])


def series(count):
    return {
        f"set {k}": (COUNTS, 0.03 / (1 + COUNTS) * (1 + k), 0.08 / (1 + COUNTS) * (1 + k))
        for k in range(count)
    }


def test_plan_and_height_stand_side_by_side_in_millimetres():
    figure = accuracy_by_control(series(1))
    plan, height = figure.axes
    assert plan.lines[-1].get_ydata() == pytest.approx([30.0, 15.0, 7.5, 5.0])
    assert height.lines[-1].get_ydata() == pytest.approx([80.0, 40.0, 20.0, 80 / 6])
    assert plan.get_ylim() == height.get_ylim()
    assert plan.get_xticks().tolist() == COUNTS.tolist()


@pytest.mark.parametrize("count", [2, 7, 8])
def test_every_flight_set_looks_different_even_in_grey(count):
    figure = accuracy_by_control(series(count))
    lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 4]
    assert len(lines) == count
    looks = {(line.get_marker(), line.get_markerfacecolor() == "white") for line in lines}
    assert len(looks) == count
    grey = [to_rgb(line.get_color()) @ np.array([0.299, 0.587, 0.114]) for line in lines]
    assert max(grey) < 0.75


def test_every_flight_set_is_named_once():
    figure = accuracy_by_control(series(7))
    named = [t.get_text() for legend in figure.legends for t in legend.get_texts()]
    assert named == list(series(7))


def test_what_cannot_be_adjusted_is_left_out_of_its_line():
    figure = accuracy_by_control(
        {"a": (COUNTS, np.array([np.nan, 1, 1, 1]), np.array([np.nan, 2, 2, 2]))}
    )
    figure.draw_without_rendering()
    nothing = accuracy_by_control({"a": (COUNTS, np.full(4, np.nan), np.full(4, np.nan))})
    assert "can be adjusted" in " ".join(t.get_text() for t in nothing.texts)
