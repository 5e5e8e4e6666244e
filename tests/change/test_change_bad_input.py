"""What cannot be compared is told in one sentence, and nothing is written."""

import numpy as np
import pytest
from made import flown

import corridor
from corridor.cli import main
from corridor.errors import InputError


def after(**changes):
    """A second date that differs in something that is no motion."""
    block = flown(11)
    for name, value in changes.items():
        setattr(block, name, value)
    return block


def refused(second, match, first=None, **options):
    with pytest.raises(InputError, match=match) as told:
        corridor.change(first or flown(10), second, camera=False, surface=False, **options)
    assert "\n" not in str(told.value)


def test_another_system_of_coordinates():
    first = flown(10)
    first.crs = "EPSG:32631"
    refused(after(crs="EPSG:2154"), "crs of BEFORE is EPSG:32631, of AFTER EPSG:2154", first)


def test_another_offset():
    refused(after(offset=np.array([100.0, 0.0, 0.0])), "offset of BEFORE is .* one offset")


def test_dates_that_are_swapped():
    first = flown(10)
    first.extra = {"date": "2024-06-01"}
    refused(after(extra={"date": "2023-06-01"}), "exchange the two blocks", first)


def test_a_date_that_is_none():
    refused(after(extra={"date": "last summer"}), "'last summer' is no date")


def shifted(metres):
    """The same dike in another place."""
    block = flown(11)
    for table in ("images", "points", "ground", "gnss"):
        getattr(block, table)["x"] += metres
    return block


def test_places_that_do_not_overlap():
    refused(shifted(5000.0), "the epochs do not overlap")


def test_a_name_that_means_another_point():
    block = flown(11)
    one, other = block.ground.loc[block.ground["role"] == "check", "point"].iloc[[0, -1]]
    names = {one: other, other: one}
    for table in ("marks", "ground"):
        rows = getattr(block, table)
        rows["point"] = rows["point"].astype(str).replace(names)
    block = block.copy()
    refused(block, "lies .* m apart in the two epochs .*different points")


def test_an_epoch_without_a_datum():
    block = flown(11)
    block.gnss, block.ground = block.gnss.iloc[:0], block.ground.iloc[:0]
    block.marks = block.marks.iloc[:0]
    refused(block, "AFTER has neither control nor GNSS and so no datum")


@pytest.mark.parametrize(
    ("option", "match"),
    [
        ({"datum": "loose"}, "datum 'loose' is unknown"),
        ({"motion": "shear"}, "motion 'shear' is unknown"),
        ({"level": 2.0}, "no probability"),
    ],
)
def test_an_option_that_says_nothing(option, match):
    refused(flown(11), match, **option)


def test_the_command_ends_with_two_and_writes_nothing(tmp_path, capsys):
    for name, block in (("a", flown(10)), ("b", after(crs="EPSG:2154"))):
        if name == "a":
            block.crs = "EPSG:32631"
        block.write(tmp_path / name)
    out = tmp_path / "out"
    assert main(["change", str(tmp_path / "a"), str(tmp_path / "b"), "-o", str(out)]) == 2
    assert "crs of BEFORE" in capsys.readouterr().err
    assert not out.exists()


def test_a_polygon_elsewhere():
    polygon = np.array([[1e4, 0], [1e4 + 9, 0], [1e4, 9]])
    with pytest.raises(InputError, match="polygon holds no ground"):
        corridor.change(
            flown(10), flown(11), camera=False, same_ties=True, spacing=20.0,
            polygons={"far": polygon},
        )  # fmt: skip


def test_a_line_that_is_no_table(tmp_path):
    (tmp_path / "line.csv").write_text("x,y\n1,2\n3,here\n")
    with pytest.raises(InputError, match="numbers in metres"):
        corridor.change.read_line(tmp_path / "line.csv")
