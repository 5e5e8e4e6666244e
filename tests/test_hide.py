"""The game of the classroom: what is hidden stays hidden until the seal is opened."""

import pytest
from kit import hide

from corridor.core.errors import InputError


@pytest.mark.slow
def test_a_sealed_flight_says_nothing_of_what_is_hidden(tmp_path):
    flight = hide.hide(tmp_path / "flight", "clock_offset", "easy", seed=1)
    for path in tmp_path.rglob("*"):
        if path.is_file():
            assert b"clock_offset" not in path.read_bytes(), path
    assert hide.open_seal(flight) == {"hidden": "clock_offset", "values": {"offset": 0.05}}


@pytest.mark.parametrize(
    ("said", "hidden", "points"),
    [
        ("rolling_shutter", "rolling_shutter", 2),
        ("nothing", "nothing", 2),
        ("lever_arm", "rolling_shutter", 1),
        ("nothing", "rolling_shutter", 0),
        ("rolling_shutter", "nothing", 0),
    ],
)
def test_a_name_is_worth_two_points_and_seeing_something_one(said, hidden, points):
    assert hide.score(said, hidden) == points


def test_what_is_not_in_the_game_is_refused(tmp_path):
    with pytest.raises(InputError, match="gravity"):
        hide.hide(tmp_path / "flight", "gravity")
