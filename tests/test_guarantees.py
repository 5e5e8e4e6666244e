"""The short form of what docs/guarantees.md promises, and that its figures are those of a run."""

import json
import random
from pathlib import Path

import pytest

import corridor
from benchmarks import rigs
from benchmarks.guarantees import (
    damage,
    full,
    interrupted,
    malformed,
    order,
    sigmas,
    subjects,
    table,
    verbs,
)
from corridor.core.output import files
from corridor.interface import cli, figures

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_is_what_the_figures_say():
    figures = json.loads((DOCS / "guarantees.json").read_text(encoding="utf-8"))
    page = (DOCS / "guarantees.md").read_text(encoding="utf-8")
    assert page == table.text(figures), "python -m benchmarks.guarantees page"


def test_rates_of_rigs_are_those_of_the_draws_that_were_done():
    """A draw that failed counts nowhere; what is named beside a null is false."""
    row = {"failed": None, "named": [], "inside": [], "wrong": [], "extras": 0}
    found = rigs.counts([
        row | {"name": "mounting-001", "named": ["mounting"], "inside": ["mounting"]},
        row | {"name": "mounting-002", "inside": ["mounting"], "extras": 1},
        row | {"name": "mounting-003", "failed": "no"},
        row | {"name": "rig-001", "wrong": ["focal"]},
        row | {"name": "attitudes-001"},
    ])  # fmt: skip
    assert found["mounting"] == {"done": 2, "named": 1, "inside": 2, "false": 1}
    page = table.text({"rigs": {"kinds": found, "first": 1, "nulls": ["attitudes", "rig"]}})
    assert "draws from 1 on: " in page and "mounting: 1 named, 2 in the set, of 2" in page
    assert "something named in 1 of 2" in page


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


@pytest.mark.parametrize(
    ("status", "said", "there", "wrong"),
    [
        (130, "interrupted: nothing was written.", set(), ""),
        (130, "interrupted: the finished pictures are kept", {"m.npz.part/0.npz"}, ""),
        (130, "interrupted: nothing was written.", {"out/a", "out/b"}, ""),
        (0, "Wrote out", {"out/a", "out/b"}, ""),
        (0, "Wrote out", {"out/a"}, "half an output: ['out/a']"),
        (130, "interrupted: nothing was written.", {".out.1.part/a"}, "half an output"),
        (130, "", set(), "not a word"),
        (1, "failed: no", set(), "status 1"),
        (130, "Traceback (most recent call last):", set(), "a traceback"),
    ],
)
def test_what_is_half_written_is_told_from_what_is_whole(status, said, there, wrong):
    found = verbs.fault(status, said, there, {"out/a", "out/b"}, (130, 0))
    assert found.startswith(wrong) and bool(found) == bool(wrong)


# One of each way to write: a folder, a folder with its truth beside it, a project, a file.
QUICK = ("correct", "simulate", "export", "gnss")


@pytest.mark.slow
def test_a_verb_that_is_stopped_leaves_nothing_half_written():
    found = interrupted.run(times=2, seed=1, say=print, some=QUICK)
    assert found["holds"] and found["moments"] == 2 * len(QUICK), found["faults"]


@pytest.mark.slow
def test_a_full_disk_leaves_nothing_half_written():
    found = full.run(say=print, some=QUICK, shares=(0.0, 0.9))
    assert found["holds"] and found["tries"] == 2 * len(QUICK), found["faults"]


@pytest.mark.parametrize("kind", ["gnss", "readout"])
def test_errors_are_no_larger_than_stated(kind):
    """A few draws of the long run: 1.05 or less lies in their interval of 95 %."""
    assert sigmas.run(draws=8, seed=3, say=print, some=(kind,))["kinds"][kind]["low"] <= 1.05


@pytest.fixture
def put_back(monkeypatch):
    """What trials change in this process to be quick is as it was for other tests."""
    changed = (corridor, "adjust"), (cli, "_parser"), (files, "png"), (figures, "png")
    for owner, name in changed:
        monkeypatch.setattr(owner, name, getattr(owner, name))
    yield
    malformed._without_waste.cache_clear()


@pytest.mark.slow
def test_malformed_inputs_end_in_a_sentence_or_a_right_result(tmp_path, put_back):
    """The first cases of the long run, without the commands that take long."""
    found = malformed.run(range(100), short=True, place=tmp_path / "run")
    assert found.cases == 100
    assert not found.faults, found.faults[:3]
    assert found.outcomes["refused"] > 30 and found.outcomes["right"] > 10


@pytest.mark.slow
def test_what_must_not_matter_does_not():
    assert order.run(seed=0)["holds"]
