"""The short form of what docs/guarantees.md promises, and that its figures are those of a run."""

import json
import random
from pathlib import Path

import pytest

from benchmarks.guarantees import damage, full, interrupted, malformed, order, subjects, table

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_is_what_the_figures_say():
    figures = json.loads((DOCS / "guarantees.json").read_text(encoding="utf-8"))
    page = (DOCS / "guarantees.md").read_text(encoding="utf-8")
    assert page == table.text(figures), "python -m benchmarks.guarantees page"


def test_a_case_is_told_by_its_number(tmp_path):
    """The same number damages the same file in the same way."""
    good = tmp_path / "good"
    for subject in subjects.SUBJECTS:
        (good / subject.name).mkdir(parents=True)
        for name in ("a.csv", "plan.toml", "star.png", "wheel.png", "led.jpg", "maps.npz",
                     "model.json", "points.csv"):  # fmt: skip
            (good / subject.name / name).write_text("x,y\n1,2\n3,4\n")
    one, two = (malformed.prepared(5, 1, True, good, tmp_path / name) for name in "ab")
    assert one[0] == two[0]


@pytest.mark.parametrize("seed", range(40))
def test_damage_changes_a_table_and_says_what_it_did(tmp_path, seed):
    path = tmp_path / "t.csv"
    rows = "\n".join(f"p{k},{k}.5,{2 * k}.25" for k in range(30))
    path.write_text(f"point,x,y\n{rows}\n")
    before = path.read_bytes()
    said = damage.damage(path, random.Random(seed), [])
    kind, name, _ = said.split(": ", 2)
    assert kind in ("bytes", "cell", "column", "order", "encoding", "size", "file")
    assert name == "t.csv"
    same = path.is_file() and not path.is_symlink() and path.read_bytes() == before
    # A cell may be replaced by an equal one, a column or a file exchanged with itself.
    assert not same or kind in ("bytes", "cell", "column", "file", "order")


@pytest.mark.slow
def test_a_thousand_malformed_inputs_end_in_a_sentence_or_a_right_result(tmp_path):
    found = malformed.run(range(1000), seed=1, short=True, place=tmp_path / "run")
    assert found.cases == 1000
    assert not found.faults, found.faults[:3]
    assert found.outcomes["refused"] > 300 and found.outcomes["right"] > 100


@pytest.mark.slow
def test_what_must_not_matter_does_not():
    assert order.run(seed=1)["holds"]


@pytest.mark.slow
def test_verbs_stopped_at_two_moments_leave_nothing_half_written():
    found = interrupted.run(2, 1, print)
    assert not found["faults"] and found["stopped"] > found["moments"] / 2


@pytest.mark.slow
def test_verbs_on_a_full_disk_leave_nothing_half_written():
    assert full.run(print)["holds"]
