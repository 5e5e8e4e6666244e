"""Published numbers of other programs, digit by digit; the whole table is docs/digits.md."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.digits import Row, half_unit, rows_of

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
    """Its print is no minimum with equal weights: points that it weighted otherwise differ."""
    redundancy, sigma0, bar, points, errors = rows_of(DATA, ["aicon"])
    assert redundancy.verdict == bar.verdict == "all"
    assert sigma0.verdict != "differs"
    assert errors.equal > 0.94 * len(errors.pairs)
    away = [abs(a - b) / s for (a, b, _), s in zip(points.pairs, points.sigmas, strict=True)]
    assert np.median(away) < 0.02 and np.percentile(away, 95) < 0.2
