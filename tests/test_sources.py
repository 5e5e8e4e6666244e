"""Whoever reads `Source: Fraser 1997` finds the title on one page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "sources.md").read_text(encoding="utf-8")
# An author, up to one line of further authors, and a year.
CITED = re.compile(
    r"Source[^:.]*:\s+(?:de )?(?P<author>[A-ZÖ][\w-]+)(?P<more>(?: and | et al\.|, |[A-Zö][\w-]+"
    r"|\s)*)\s(?P<year>(?:19|20)\d\d)\b"
)


def cited():
    for file in sorted((ROOT / "corridor").rglob("*.py")):
        for found in CITED.finditer(file.read_text(encoding="utf-8")):
            yield file, found["author"], found["year"]


def test_sources_are_cited():
    assert len({(author, year) for _, author, year in cited()}) > 15


@pytest.mark.parametrize(("author", "year"), sorted({found[1:] for found in cited()}))
def test_every_cited_source_is_on_the_page(author, year):
    lines = [line for line in PAGE.splitlines() if author in line and year in line]
    assert lines, f"docs/sources.md has no {author} {year}"
