"""One table, shown as text and as HTML, and JSON that every program can read."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from corridor.core.output import WIDTH, Link, Report, Table, json_text, plain, readable


def test_columns_of_numbers_end_on_the_right():
    frame = pd.DataFrame({"what": ["gnss", "ties"], "mm": ["12.0", "–"], "": ["± 3", "± 11"]})
    table = Table.of(frame, "Sizes")
    assert table.align == "lrr"
    assert str(table).splitlines() == [
        "Sizes",
        "  what    mm",
        "  " + "-" * 16,
        "  gnss  12.0   ± 3",
        "  ties     –  ± 11",
    ]


def test_a_long_text_at_the_end_goes_on_in_its_column():
    words = "missing " * 30
    table = Table("", rows=(("a column", words.strip()),), align="ll")
    first, *more = str(table).splitlines()
    assert more and all(line.startswith(" " * 12 + "missing") for line in more)
    assert max(map(len, [first, *more])) <= WIDTH


def test_a_table_without_names_of_columns_has_no_head_in_html():
    assert "<thead>" not in Table("", rows=(("a", "1"),), align="lr").html()
    assert Table("").html() == "<table>\n</table>"


def test_a_name_cannot_break_out_of_a_page():
    name = "<script>x</script>"
    table = Table(name, (name,), ((name,),), "l", (name,))
    assert "<script" not in Report(name, name, [name], [table]).page([(name, name, b"png")])


def test_plain_values_are_finite_or_null():
    value = {1: np.arange(2), "b": (np.float64("nan"), np.bool_(True), math.inf), "c": pd.NA}
    assert plain(value) == {"1": [0, 1], "b": [None, True, None], "c": None}
    assert json.loads(json_text(value)) == plain(value)


@pytest.mark.parametrize(
    ("value", "said"), [(2000, "2,000"), (0.05, "0.05"), (12.0, "12"), (0, "0"), (1e-9, "1e-09")]
)
def test_a_number_is_written_as_a_person_writes_it(value, said):
    assert readable(value) == said


def test_a_cell_of_a_page_leads_somewhere_and_a_sentence_holds_a_command():
    row = (Link("km 1", "blocks/km 1/a&b.html"), "look at `corridor adjust A<B`")
    html = Table("Blocks", ("block", "to do"), (row,), "lw").html()
    assert '<a href="blocks/km%201/a%26b.html">km 1</a>' in html
    assert '<td class="name text">look at <code>corridor adjust A&lt;B</code></td>' in html
    assert "km 1   look at" in str(Table("Blocks", ("block", "to do"), (row,), "lw"))
