"""How precise the ground is along a line."""

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor.core.adjustment import read_corners
from corridor.core.errors import InputError
from corridor.interface.cli import main

DIKE = "data_synthetic/dike"


@pytest.fixture(scope="module")
def adjusted():
    return corridor.adjust(corridor.read(DIKE), camera="fixed")


def sound(adjusted):
    sigma = adjusted.point_sigma
    rows = np.flatnonzero(np.isfinite(sigma).all(axis=1))
    return adjusted.points[["x", "y"]].to_numpy(float)[rows], sigma[rows]


def test_at_a_point_it_is_the_standard_deviation_of_the_point(adjusted):
    places, sigma = sound(adjusted)
    inner = int(np.argmin(np.linalg.norm(places - np.median(places, axis=0), axis=1)))
    table = adjusted.precision_along(places[inner : inner + 1]).table
    assert table["sh"].iloc[0] == pytest.approx(np.hypot(*sigma[inner, :2]), rel=1e-9)
    assert table["sz"].iloc[0] == pytest.approx(sigma[inner, 2], rel=1e-9)
    assert table["distance"].iloc[0] == 0.0


def test_between_points_it_is_not_smaller_than_however_they_are_correlated(adjusted):
    """Of three equal sigmas s the mean's lies between 0 and s; told is s."""
    places, sigma = sound(adjusted)
    middle = np.median(places, axis=0)
    near = np.argsort(np.linalg.norm(places - middle, axis=1))[:40]
    table = adjusted.precision_along(middle[None]).table
    assert sigma[near, 2].min() <= table["sz"].iloc[0] <= sigma[near, 2].max()


def test_stations_hold_the_corners_and_stand_as_far_apart_as_points(adjusted):
    places, _ = sound(adjusted)
    low, high = np.percentile(places, [30, 70], axis=0)
    corners = np.array([low, [high[0], low[1]], high])
    table = adjusted.precision_along(corners).table
    length = np.abs(high - low).sum()
    assert table["station"].iloc[[0, -1]].tolist() == pytest.approx([0.0, length])
    for corner in corners:
        assert np.abs(table[["x", "y"]].to_numpy() - corner).max(axis=1).min() < 1e-9
    assert 10 < len(table) < 2000 and table["sz"].notna().all()


def test_an_accuracy_is_believed_where_it_is_reached_and_nowhere_else(adjusted):
    places, _ = sound(adjusted)
    corners = np.percentile(places, [25, 75], axis=0)
    table = adjusted.precision_along(corners).table
    half = float(table["sz"].median())
    for required, told in (
        (2 * table[["sh", "sz"]].max(axis=None), "may be believed in height everywhere"),
        (table[["sh", "sz"]].min(axis=None) / 2, "may not be believed in height"),
        (half, "may be believed in height on"),
    ):
        assert told in str(adjusted.precision_along(corners, required))


def test_outside_the_points_nothing_is_known_and_told(adjusted):
    places, _ = sound(adjusted)
    middle = np.median(places, axis=0)
    found = adjusted.precision_along(np.array([middle, middle + [1000.0, 0.0]]), 1.0)
    assert "believed in height where it is known" in str(found) and "Not known at" in str(found)
    assert found.table["sz"].iloc[0] > 0 and np.isnan(found.table["sz"].iloc[-1])
    with pytest.raises(InputError, match="the line lies outside the points"):
        adjusted.precision_along(middle[None] + 1e4)


def test_the_offset_may_stand_in_the_line(adjusted):
    places, _ = sound(adjusted)
    corners = np.percentile(places, [40, 60], axis=0)
    plain = adjusted.precision_along(corners)
    before, adjusted.block.offset = adjusted.block.offset, np.array([467000.0, 5428000.0, 0.0])
    try:
        found = adjusted.precision_along(corners + adjusted.block.offset[:2])
    finally:
        adjusted.block.offset = before
    assert found.shifted and "offset of the block was taken off" in str(found)
    assert np.allclose(found.table["sz"], plain.table["sz"], rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "least", "said"),
    [("x,y\n1,2\n", 2, "1 corners do not make"), ("x,y\n1,\n", 1, "row 2: x and y"),
     ("x,y\n", 1, "0 corners")],
)  # fmt: skip
def test_a_table_that_is_no_line_is_refused(tmp_path, text, least, said):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_corners(tmp_path / "a.csv", least)


@pytest.mark.slow
def test_the_command_answers_and_writes_the_stations(tmp_path, capsys):
    (tmp_path / "axis.csv").write_text("x;y\n10,5;0\n60,5;20\n")
    words = ["adjust", DIKE, "-o", str(tmp_path / "out"), "--line", str(tmp_path / "axis.csv")]
    assert main([*words, "--required", "0.01"]) == 0
    assert "axis.csv: Along the line of 54 m the ground is known horizontally" in (
        capsys.readouterr().out
    )
    table = pd.read_csv(tmp_path / "out" / "line.csv")
    assert list(table) == ["station", "x", "y", "sh", "sz", "distance"] and table["sz"].max() < 0.1
