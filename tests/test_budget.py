"""How many lines the package may have, room by room: `tests/budget.toml`.

Anyone may lower a number. Raise one only with the reason in the same commit.
"""

import tomllib
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "corridor"
BUDGET = tomllib.loads(Path(__file__).with_name("budget.toml").read_text(encoding="utf-8"))


def lines(place: str) -> int:
    """Lines of Python in a folder of the package, or in a file; "": in all of it."""
    found = PACKAGE / place
    files = [found] if found.is_file() else found.rglob("*.py")
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


@pytest.mark.parametrize("room", BUDGET["rooms"])
def test_a_room_keeps_to_its_budget(room):
    assert lines(room) <= BUDGET["rooms"][room]


def test_the_rooms_together_keep_to_the_whole():
    whole = sum(BUDGET["rooms"].values())
    assert whole <= BUDGET["whole"]
    assert lines("") <= BUDGET["whole"]


def test_every_room_has_a_budget():
    """Each file belongs to one of the rooms of the table."""
    rooms = [PACKAGE / room for room in BUDGET["rooms"]]
    stray = [
        str(file.relative_to(PACKAGE))
        for file in PACKAGE.rglob("*.py")
        if file.parent != PACKAGE
        and file.name != "__init__.py"
        and not any(file == room or room in file.parents for room in rooms)
    ]
    assert not stray
