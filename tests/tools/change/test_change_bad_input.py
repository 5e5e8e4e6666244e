"""What cannot be compared is told in one sentence, with status 2, and nothing is written."""

import re

import numpy as np
import pytest
from made import flown

import corridor
from corridor.core.errors import InputError
from corridor.interface.cli import main


def another_system(first, second):
    first.crs, second.crs = "EPSG:32631", "EPSG:2154"


def another_offset(first, second):
    second.offset = np.array([100.0, 0.0, 0.0])


def swapped_dates(first, second):
    first.extra, second.extra = {"date": "2024-06-01"}, {"date": "2023-06-01"}


def no_date(first, second):
    second.extra = {"date": "last summer"}


def another_place(first, second):
    for table in ("images", "points", "ground", "gnss"):
        getattr(second, table)["x"] += 5000.0


def exchanged_names(first, second):
    one, other = second.ground.loc[second.ground["role"] == "check", "point"].iloc[[0, -1]]
    for table in ("marks", "ground"):
        rows = getattr(second, table)
        rows["point"] = rows["point"].astype(str).replace({one: other, other: one})


def other_heights(first, second):
    """Above the geoid in place of the ellipsoid."""
    for table in ("images", "points", "ground", "gnss"):
        getattr(second, table)["z"] -= 47.9


def no_datum(first, second):
    for table in ("gnss", "ground", "marks"):
        setattr(second, table, getattr(second, table).iloc[:0])


def nothing(first, second):
    pass


@pytest.mark.parametrize(
    ("spoil", "options", "told"),
    [
        (another_system, [], "crs of BEFORE is EPSG:32631, of AFTER EPSG:2154"),
        (another_offset, [], "offset of BEFORE is .* one offset"),
        (swapped_dates, [], "exchange the two blocks"),
        (no_date, [], "'last summer' is not a date"),
        (another_place, [], "the epochs do not overlap"),
        (exchanged_names, [], "lies .* m apart in the two epochs .*different points"),
        (other_heights, [], r"all \d+ common points lie .*-47.9\) m apart .* geoid"),
        (no_datum, [], "AFTER has neither control nor GNSS and so no datum"),
        (nothing, ["--polygon", "far.csv", "--spacing", "20"], "polygon holds no ground"),
        (nothing, ["--profile", "here.csv"], "here.csv, row 3: y = 'here' is not a number"),
        (nothing, ["--profile", "excel.csv"], "excel.csv, line 2: .* has a decimal comma, and"),
        (nothing, ["--profile", "none.csv"], "there is no such file"),
        (
            nothing,
            ["--radius", "0.1", "--spacing", "20"],
            "tie points of both dates within 0.1 m",
        ),
        (nothing, ["--together", "--stable", "P77", "--points-only"], "P77 is to stand still"),
        (nothing, ["--common", "weather"], "'weather' is not an error that epochs can share"),
        (nothing, ["--level", "2"], "not a probability"),
        (nothing, ["--datum", "loose"], "'loose'"),
    ],
    ids=lambda value: value.__name__ if callable(value) else None,
)
def test_the_command_says_one_sentence_and_writes_nothing(
    spoil, options, told, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.csv").write_text("x,y\n10000,0\n10009,0\n10000,9\n")
    (tmp_path / "here.csv").write_text("x,y\n1,2\n3,here\n")
    (tmp_path / "excel.csv").write_text("x;y\n1,5;2.5\n3;4\n")
    first, second = flown(10), flown(11)
    spoil(first, second)
    first.copy().write("a")
    second.copy().write("b")
    try:
        status = main(["change", "a", "b", "-o", "out", "--no-camera", "--same-ties", *options])
    except SystemExit as end:
        status = end.code
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert status == 2
    assert re.search(told, last), last
    kept = ["a", "b", "excel.csv", "far.csv", "here.csv"]
    assert sorted(path.name for path in tmp_path.iterdir()) == kept


@pytest.mark.parametrize(
    ("option", "match"),
    [
        ({"datum": "loose"}, "datum 'loose' is unknown"),
        ({"motion": "shear"}, "motion 'shear' is unknown"),
        ({"level": 2.0}, "not a probability"),
    ],
)
def test_an_option_that_says_nothing(option, match):
    with pytest.raises(InputError, match=match):
        corridor.change(flown(10), flown(11), **option)
