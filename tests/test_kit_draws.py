"""Tables of draws that chapters read instead of flying minutes of simulated surveys."""

import numpy as np
import pytest
from kit import draws

TABLES = draws.tables()
# Draws that no chapter makes again: their chapters make those of the other tables.
AGAIN = {
    "arms": ("s1", 0.3, 1.0, 5),
    "viabon": ("d2", 150, "marks", 2.0, 7),
    "dike_shutter": ("b", "heading kept, one way", "translation", "true", 23.0, 50.0, 1),
}


def squares(a, seed):
    """A draw that takes no time."""
    return {"square": a * a + 1e-7 * seed, "root": np.sqrt(a)}


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.setattr(draws, "FOLDER", tmp_path)
    return draws.Table("squares", ("a", "seed"), [(2.0, 0), (3.0, 0), (3.0, 1)], squares)


def test_what_is_missing_is_made_and_what_is_there_is_kept(table, capsys):
    table.complete()
    assert len(capsys.readouterr().out.splitlines()) == 3 + 1
    table.complete()
    assert len(capsys.readouterr().out.splitlines()) == 1
    assert table.of(2.0, 0) == pytest.approx({"square": 4.0, "root": 1.41421})
    # What no table has is made.
    assert table.of(5.0, 3) == {"square": 25.0 + 3e-7, "root": np.sqrt(5.0)}
    assert table.some([(2.0, 0), (5.0, 3)])["square"].tolist() == pytest.approx([4.0, 25.0])


def test_a_draw_that_has_changed_is_told_by_name(table):
    table.complete()
    assert table.again(3.0, 1) == "3.0 1, made again: as kept"
    other = squares(3.0, 1) | {"root": 1.8}
    assert table.again(3.0, 1, made=other) == "3.0 1, made again: NOT as kept: root"
    assert "not among" in table.again(7.0, 1)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_table_holds_what_is_planned_and_nothing_else(table):
    kept = table.read()
    assert table.missing(kept) == []
    assert len(kept) == len(set(table.planned)) == len(table.planned)


@pytest.mark.slow
@pytest.mark.parametrize("name", AGAIN)
def test_a_draw_made_again_is_the_one_in_the_table(name):
    assert TABLES[name].again(*AGAIN[name]).endswith("made again: as kept")
