"""The shipped blocks with hidden effects: made by their script, small, and solved."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

import corridor
from benchmarks.diagnosis.__main__ import main

SHIPPED = Path(__file__).parents[2] / "data_synthetic"
SEALED, STORIES = SHIPPED / "hidden", SHIPPED / "stories"
NAMES = "ABCDEF"
TABLES = ("images", "tie_points", "marks", "points", "ground", "gnss")


@pytest.fixture(scope="module")
def make():
    spec = importlib.util.spec_from_file_location("make_hidden", SHIPPED / "make_hidden.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def again(make, tmp_path_factory):
    folder = make.write(tmp_path_factory.mktemp("again"), make.cases())
    return make.write(folder, make.stories())


@pytest.mark.parametrize("name", [*NAMES, "levee", "towpath", "viaduct", "quay", "weir"])
def test_the_script_makes_the_shipped_blocks(make, again, name):
    """Within one unit of the last digit, which another processor may round the other way."""
    home = SEALED if name in NAMES else STORIES
    one, shipped = corridor.read(again / name), corridor.read(home / name)
    for table in TABLES:
        a, b = getattr(one, table), getattr(shipped, table)
        assert list(a) == list(b) and len(a) == len(b)
        for column in a:
            if a[column].dtype.kind != "f":
                assert a[column].astype(str).tolist() == b[column].astype(str).tolist()
                continue
            digits = make.DIGITS[table].get(column, 9)
            assert np.abs(a[column] - b[column]).max() <= 1.01 * 10.0**-digits
    truth = [json.loads((path / f"{name}.truth.json").read_text()) for path in (again, home)]
    assert truth[0]["effects"] == truth[1]["effects"] and truth[0]["seed"] == truth[1]["seed"]


def test_they_are_small_and_nothing_in_them_gives_the_effect_away(make):
    files = [path for path in SEALED.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 3_000_000
    assert sorted(path.name for path in SEALED.iterdir() if path.is_dir()) == list(NAMES)
    slugs = {slug for case, _ in make.cases().values() for slug in case.effects}
    for path in files:
        if path.parent != SEALED:
            text = path.read_text(encoding="utf-8")
            assert not any(slug in text for slug in slugs), path
            assert len(corridor.read(path.parent).images) <= 30


def test_they_hold_one_of_everything():
    kinds = {
        name: json.loads((SEALED / f"{name}.truth.json").read_text()) for name in NAMES
    }  # fmt: skip
    count = sorted(len(truth["effects"]) for truth in kinds.values())
    assert count == [0, 1, 1, 1, 1, 2]
    assert sum(bool(truth["outside"]) for truth in kinds.values()) == 1


@pytest.mark.slow
def test_the_benchmark_solves_them(tmp_path):
    """A name for what has one, a set for the pair that nobody can tell apart, a place for the dent
    in the glass, and silence where nothing is hidden."""
    out = tmp_path / "out"
    command = ["--blocks", str(SEALED), "-o", str(out)]
    assert main([*command, "--without-baselines"]) == 0
    rows = json.loads((out / "benchmark.json").read_text(encoding="utf-8"))["rows"]
    said = {row["name"]: row for row in rows}
    assert not any(row["wrong"] or row["extras"] or row["failed"] for row in rows)
    verdicts = {name: row["verdict"] for name, row in said.items()}
    assert verdicts == {"A": "named", "B": "unknown", "C": "named", "D": "nothing",
                        "E": "ambiguous", "F": "named"}  # fmt: skip
    assert said["B"]["place"] is True
    assert said["E"]["inside"] == ["gnss_bias"]
    assert set(said["F"]["named"]) == {"radial_distortion", "control_blunder.G07"}
    off = [p["sigmas"] for row in rows for p in row["parameters"]]
    assert len(off) > 8 and np.abs(off).max() < 4.5
