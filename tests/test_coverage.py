"""The page that says of every section of the works where it is done again, or why it is not."""

import pytest
from kit import coverage

ROWS = [row for work in coverage.read().values() for row in work["sections"]]


def test_the_committed_page_is_current():
    """If this fails: python -m kit.coverage, in notebooks/."""
    committed = (coverage.NOTEBOOKS / "coverage.md").read_text(encoding="utf-8")
    assert committed == coverage.page()


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['at']} {row['what']}")
def test_every_row_says_where_or_argues_why_not(row):
    assert row["status"] in coverage.STATUS
    if row["status"] == "done":
        notebook, heading = row["where"].split("#", 1)
        assert heading in coverage.headings(notebook)
    else:
        assert len(row["why"].split()) > 1
