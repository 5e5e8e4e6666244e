"""Where a block says it lies, and where it does."""

import numpy as np
import pytest
from strips import corridor_block

from corridor.core.block import read
from corridor.core.errors import InputError
from corridor.core.gnss import (
    Local,
    grid_distortion,
    outside_area,
)
from corridor.core.preparation import plausibility_warnings

PLACE = Local(49.0, 8.5, 0.0)


@pytest.fixture()
def grid():
    from corridor.tools.formats.frames import local_table, moved

    block = corridor_block(images=12, strips=2).copy()
    block.extra["local_frame"] = local_table(PLACE)

    return moved(block, "EPSG:25832")


@pytest.mark.parametrize("away", [0.0, 500.0, 5_000.0])
def test_an_offset_that_nobody_subtracted_is_refused(grid, away):
    middle = np.nanmedian(grid.numbers("images", *"xyz") + grid.offset, axis=0)
    grid.offset = np.round((middle + away) / 1000) * 1000 * [1, 1, 0]
    with pytest.raises(InputError, match="was not subtracted from"):
        grid.check()


@pytest.mark.parametrize("crs", ["EPSG:2056", "EPSG:31467", "EPSG:27700", "EPSG:2154"])
def test_numbers_of_another_system_are_noticed(grid, crs):
    grid.crs = crs
    assert any("area of use" in told for told in plausibility_warnings(grid))


def test_a_short_block_in_a_grid_is_not_bothered(grid):
    scale, curved = grid_distortion(grid)
    assert abs(scale) < 5e-4 and curved < 5e-3
    assert not any("Cartesian" in told for told in plausibility_warnings(grid))


@pytest.mark.parametrize(
    ("place", "crs", "inside"),
    [((467_312.0, 5_429_000.0), "EPSG:25832", True),
     ((5_429_000.0, 467_312.0), "EPSG:25832", False),
     ((-69.0, 16.0), "EPSG:25832", False), ((8.5, 49.0), "EPSG:4326", True),
     ((49.0, 208.5), "EPSG:4326", False), ((32_467_312.0, 5_429_000.0), "EPSG:25832", False),
     ((-69.0, 16.0), "EPSG:32632", False),
     # Passau in zone 32, Bergen in zone 33: official systems of Bavaria and of Norway.
     ((823_000.0, 5_390_000.0), "EPSG:25832", True),
     ((-32_000.0, 6_730_000.0), "EPSG:25833", True)],
)  # fmt: skip
def test_areas_of_use(place, crs, inside):
    assert (outside_area(np.array([[*place, 100.0]]), crs) == "") is inside


def test_names_of_macos_and_roles_in_any_case_are_read(grid, tmp_path):
    block = corridor_block(images=12, strips=2).copy()
    block.write(tmp_path / "b")
    path = tmp_path / "b" / "ground.csv"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("control", "Control").replace("check", "CHECK"), encoding="utf-8")
    assert set(read(tmp_path / "b").ground["role"]) <= {"control", "check"}
