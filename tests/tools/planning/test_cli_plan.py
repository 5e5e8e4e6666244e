"""`corridor plan`: a plan in; a table, a picture and a sentence out."""

import json

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor.core.output import WIDTH
from corridor.interface.cli import main

PLAN = """
axis_m = [[0, 0], [0, 100]]
[noise]
tie_px = 0.5
mark_px = 0.5
gnss_m = 0.01
control_m = 0.002
[tie_points]
per_image = 40
[[flight]]
name = "nadir"
height_m = 50
images = 24
[[flight]]
name = "oblique"
height_m = 50
images = 24
tilt_deg = 23
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def rows(words, folder):
    """The rows that the command writes."""
    assert main(["plan", *map(str, words), "-o", str(folder)]) == 0
    return pd.read_csv(folder / "plan.csv")


def test_it_writes_table_picture_and_advice(plan, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["plan", str(plan), "--control", "0", "--control", "1", "-o", str(out)]) == 0
    assert sorted(p.name for p in out.iterdir()) == [
        "accuracy.png", "advice.txt", "control.csv", "control.png", "plan.csv", "plan.json",
    ]  # fmt: skip
    table = pd.read_csv(out / "plan.csv")
    assert table["flights"].unique().tolist() == ["nadir", "oblique", "nadir+oblique"]
    content = json.loads((out / "plan.json").read_text(encoding="utf-8"))
    assert len(content["rows"]) == 6
    assert content["settings"]["control"] == [0, 1]
    said = capsys.readouterr().out
    assert " ".join(said.split()).startswith(content["advice"]) and "accuracy.png" in said
    assert (out / "advice.txt").read_text(encoding="utf-8").strip() == content["advice"]


def test_it_says_where_the_control_point_is_and_which_sigmas_were_assumed(plan, capsys):
    """The one point of a straight corridor of 100 m lies on its axis, halfway (see `spread`)."""
    planned = corridor.plan(plan, control=1, goals=0.02, combined=False)
    point = planned.control.iloc[0]
    assert point["x"] == pytest.approx(0.0, abs=1e-9)
    assert point["y"] == pytest.approx(50.0, abs=5.0)
    said = str(planned)
    assert f"{point['point']}  " in said and "Where to survey" in said
    assert "image points 0.5 px" in said and "0.01/0.01/0.01 m" in said
    assert set(planned.laid_out().ground["role"]) == {"control", "check"}


def test_without_noise_the_plan_has_the_noise_that_simulate_gives_it(plan, tmp_path):
    plan.write_text(PLAN.replace("[noise]", "[start]").split("tie_px")[0]
                    + "[tie_points]" + PLAN.split("[tie_points]")[1])  # fmt: skip
    assert "ordinary ones as the plan states none" in corridor.plan(plan, control=1).sigmas


def test_a_bias_is_on_the_ground_without_control(plan, tmp_path):
    words = [plan, "--as-given", "--control", "0", "--bias", "0,0,0.5"]
    assert rows(words, tmp_path / "out")["z_m"].tolist() == [pytest.approx(0.50, abs=0.01)]


def test_without_an_output_it_says_that_nothing_was_written(plan, capsys):
    assert main(["plan", str(plan), "--as-given", "--control", "0"]) == 0
    said = capsys.readouterr().out
    assert "Nothing was written" in said
    assert max(map(len, said.splitlines())) <= WIDTH


def test_a_bias_that_is_estimated_is_not_on_the_ground(plan, tmp_path):
    words = [plan, "--as-given", "--control", "1", "--bias", "0.1,0.1,0.1"]
    blind = rows(words, tmp_path / "out")["d3_m"][0]
    words += ["--effect", "gnss_bias", *(f"--prior=gnss_bias.{axis}=0.2" for axis in "xyz")]
    assert rows(words, tmp_path / "out")["d3_m"][0] < 0.3 * blind


@pytest.mark.slow
def test_camera_and_arm_of_another_flight_set_are_carried_over(plan, tmp_path):
    """To the flights that have them: the oblique one is flown with an arm of its own."""
    words = [plan, "--control", "0"]
    free = rows(words, tmp_path / "out")
    words += ["--carry-over", plan, "--mounted", "nadir=nadir", "--held"]
    carried = rows(words, tmp_path / "out")
    assert len(carried) == 3
    assert (carried["z_m"] < free["z_m"]).all()


def test_what_cannot_be_determined_is_a_sentence_and_no_failure(plan, tmp_path, capsys):
    plan.write_text("gnss = false\n" + PLAN, encoding="utf-8")
    out = tmp_path / "out"
    assert main(["plan", str(plan), "--as-given", "--control", "0,4", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "stay open with no control point and no GNSS" in said
    rows = json.loads((out / "plan.json").read_text(encoding="utf-8"))["rows"]
    assert rows[0]["d3"] is None and rows[1]["d3"] > 0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere.toml"], "cannot be read"),
        (["thesis_50vv"], "did you mean thesis_50vt"),
        (["PLAN", "--control", "a"], "numbers of control points"),
        (["PLAN", "--control", "99"], "39 candidates"),
        (["PLAN", "--bias", "1,2"], "one number or three"),
        (["PLAN", "--correlated", "much"], "SHARE:SECONDS"),
        (["PLAN", "--correlated", "1.5"], "a share"),
        (["PLAN", "--goal", "0"], "accuracies in metres"),
        (["PLAN", "--camera", "nonsense"], "nonsense"),
        (["PLAN", "--mounted", "a"], "FLIGHT=FLIGHT"),
        (["PLAN", "--prior", "f=0"], "NAME=SIGMA"),
        (["PLAN", "--prior", "nix=1"], "nothing of that name"),
        (["PLAN", "--effect", "nix"], "nix"),
        (["PLAN", "--carry-over", "PLAN", "--mounted", "nadir=nobody"], "nobody"),
    ],
)
def test_wrong_input_is_status_2_and_one_sentence(plan, words, says, capsys):
    try:
        status = main(["plan", *(str(plan) if word == "PLAN" else word for word in words)])
    except SystemExit as end:
        status = end.code
    assert status == 2
    assert says in capsys.readouterr().err.splitlines()[-1]


def test_a_folder_of_something_else_is_not_replaced(plan, tmp_path):
    other = tmp_path / "mine"
    other.mkdir()
    (other / "diary.txt").write_text("dear diary", encoding="utf-8")
    assert main(["plan", str(plan), "--control", "0", "-o", str(other)]) == 2
    assert [p.name for p in other.iterdir()] == ["diary.txt"]


@pytest.mark.slow
def test_with_change_it_also_says_where_a_change_would_be_seen(plan, tmp_path, capsys):
    """The level of detection of `corridor change` for the plan flown twice, in words and a map."""
    out = tmp_path / "out"
    words = ["plan", str(plan), "--as-given", "--control", "3", "--change", "-o", str(out)]
    assert main(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Two such flights would show a change of" in said
    assert (out / "detection.png").is_file()
    table = pd.read_csv(out / "detection.csv")
    total = np.hypot(table["sigma_m"], table["sampling_m"])
    # Student's factor is never below the normal one.
    assert (table["detection_95_m"] > 1.9599 * total).all()
    tight = ["plan", str(plan), "--as-given", "--control", "3", "--change", "--gnss-sigma", "1,1,1"]
    assert main([*tight, "--bias-sigma", "0.5", "-o", str(tmp_path / "b")]) == 0
    biased = pd.read_csv(tmp_path / "b" / "detection.csv")
    assert biased["sigma_m"].median() > table["sigma_m"].median()


def test_a_carried_camera_has_no_level_of_detection(plan, tmp_path, capsys):
    words = ["plan", str(plan), "--as-given", "--control", "3", "--change", "-o", "x"]
    assert main([*words, "--carry-over", str(plan)]) == 2
    assert "without --carry-over" in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--mounted", "nadir=other"], ["--held"]])
def test_what_goes_with_a_flight_that_is_carried_over_is_refused_without(plan, capsys, option):
    assert main(["plan", str(plan), "--control", "3", *option]) == 2
    assert "--carry-over" in capsys.readouterr().err
