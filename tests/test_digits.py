"""Published numbers of other programs, digit by digit; the whole table is docs/digits.md."""

import os
from pathlib import Path

import pytest

from benchmarks.digits import Row, half_unit, of_nist, rows_of

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("CORRIDOR_DATA", ROOT.parent / "shared" / "data"))
here = pytest.mark.skipif(not (DATA / "digits").is_dir(), reason=f"{DATA}/digits is not there")


@pytest.mark.parametrize(
    ("text", "half"), [("1.60984", 5e-6), ("3734", 0.5), (0.00482, 5e-6), ("1.7e-05", 5e-7)]
)
def test_half_a_unit_of_the_last_digit(text, half):
    assert half_unit(text) == pytest.approx(half)


def test_digits_are_counted_as_nist_counts_them():
    row = Row("one", "what", [(1.001, 1.0, 0.0005), (2.0, 2.0, 0.05)])
    assert row.lre[0] == pytest.approx(3.0) and row.lre[1] == 15.0
    assert row.equal == 1 and row.verdict == "within a unit of the last digit"
    away = Row("one", "what", [(1.0, 2.0, 0.05)], sigmas=[0.1])
    assert away.verdict == "differs"


@here
@pytest.mark.parametrize("answer", ["cam_weighted", "sxb_w_op1", "sxb_metashape_psz"])
def test_an_answer_of_dbat_is_met_to_its_digits(answer):
    rows = list(rows_of(DATA, [answer]))
    assert [row.what for row in rows][:2] == ["sigma0", "redundancy"]
    assert [row.what for row in rows if row.verdict == "differs"] == []


@here
@pytest.mark.slow
def test_the_protocol_of_aicon_with_its_scale_bar():
    """With the weights that it states: four measurements have ten times the sigma of the rest."""
    rows = {row.what: row for row in rows_of(DATA, ["aicon"])}
    assert [row.what for row in rows.values() if row.verdict == "differs"] == []
    for what in (
        "redundancy",
        "sigma0 (mm)",
        "scale bar (mm)",
        "correlations of the camera",
        "redundancies of rays",
        "critical value of the outlier test",
    ):
        assert rows[what].verdict == "all", what
    poses = rows["correlations of poses with the camera"]
    assert len(poses.pairs) == 115 * 42 and poses.equal > 0.99 * len(poses.pairs)
    assert rows["standard deviations of points (mm)"].equal > 0.99 * 450


@here
@pytest.mark.slow
def test_the_five_lenses_of_dbat_from_the_image_to_the_ray():
    """Camera and standard deviations to every digit but two of the weak run of five photographs."""
    rows = list(rows_of(DATA, ["camcal"]))
    assert [row.answer + row.what for row in rows if row.verdict == "differs"] == []
    for row in rows:
        if row.what != "poses" and (row.what != "camera" or row.answer != "camcal_5photos"):
            assert row.verdict == "all", (row.answer, row.what)


@here
@pytest.mark.slow
def test_what_dbat_counts_before_it_ends_without_a_result():
    rows = list(rows_of(DATA, ["camcal_failures"]))
    assert [row.verdict for row in rows] == ["all"] * 3


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_certified_regressions_are_rows_of_the_table():
    rows = list(of_nist())
    assert [row.verdict for row in rows if row.verdict == "differs"] == []
    assert [len(row.pairs) for row in rows] == [120, 114, 26]
