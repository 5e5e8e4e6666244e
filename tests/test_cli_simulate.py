"""`corridor simulate`: a plan in, a block and its truth out."""

import json

import pytest

import corridor
from corridor.interface.cli import main

PLAN = """
[ground]
control = 3
check = 2

[tie_points]
per_image = 40

[[flight]]
name = "F1"
height_m = 50
strips = 2
images = 8
forward = 0.7
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(PLAN, encoding="utf-8")
    return path


def test_it_writes_the_block_and_its_truth_beside_it(plan, tmp_path, capsys):
    out = tmp_path / "flown"
    assert main(["simulate", str(plan), "-o", str(out), "--seed", "3"]) == 0
    block = corridor.read(out)
    truth = json.loads((tmp_path / "flown.truth.json").read_text(encoding="utf-8"))
    assert list(truth["centre"]) == list(block.images["image"])
    assert truth["seed"] == 3
    said = capsys.readouterr().out
    assert "8 images" in said and "flown.truth.json" in said


def test_the_same_seed_writes_the_same_bytes(plan, tmp_path):
    for name in ("a", "b"):
        main(["simulate", str(plan), "-o", str(tmp_path / name)])
    first, second = (
        {p.relative_to(tmp_path / name): p.read_bytes() for p in (tmp_path / name).iterdir()}
        for name in ("a", "b")
    )
    assert first == second


def test_effects_are_added_and_are_part_of_the_truth(plan, tmp_path):
    words = ["--effect", "rolling_shutter:readout=0.03", "--effect", "gnss_bias:x=0.1,z=-0.2"]
    assert main(["simulate", str(plan), "-o", str(tmp_path / "flown"), *words]) == 0
    truth = json.loads((tmp_path / "flown.truth.json").read_text(encoding="utf-8"))
    assert truth["effects"] == {
        "rolling_shutter": {"readout": 0.03},
        "gnss_bias": {"x": 0.1, "z": -0.2},
    }


def test_a_plan_without_noise_is_flown_with_ordinary_noise(plan, tmp_path, capsys):
    assert main(["simulate", str(plan), "-o", str(tmp_path / "flown")]) == 0
    assert "tie points 0.5 px" in capsys.readouterr().out
    truth = json.loads((tmp_path / "flown.truth.json").read_text(encoding="utf-8"))
    assert truth["noise"]["tie_px"] == 0.5 and truth["noise"]["gnss_m"] == [0.02, 0.02, 0.04]
    adjusted = corridor.adjust(tmp_path / "flown")
    # The noise is as large as the block states.
    assert adjusted.sigma0 == pytest.approx(1.0, abs=5 / (2 * adjusted.redundancy) ** 0.5)


def test_a_perfect_block_is_there_for_the_asking(plan, tmp_path, capsys):
    assert main(["simulate", str(plan), "-o", str(tmp_path / "flown"), "--noise", "none"]) == 0
    assert "noise: none" in capsys.readouterr().out
    here, python = corridor.read(tmp_path / "flown"), corridor.simulate(plan)
    assert here.tie_points["x"].tolist() == python.tie_points["x"].tolist()


def test_noise_of_the_plan_goes_before(plan, capsys):
    plan.write_text(f"{PLAN}\n[noise]\ntie_px = 0.3\n", encoding="utf-8")
    assert main(["simulate", str(plan)]) == 0
    assert "tie points 0.3 px, marks 0.5 px" in capsys.readouterr().out


def test_without_an_output_it_says_that_nothing_was_written(plan, capsys):
    assert main(["simulate", str(plan)]) == 0
    assert "Nothing was written" in capsys.readouterr().out


def test_without_a_plan_it_lists_those_that_come_with_the_package(capsys):
    assert main(["simulate"]) == 0
    said = capsys.readouterr().out
    for name in corridor.simulation.ready_made():
        assert name in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["thesis_50vv"], "did you mean thesis_50vt"),
        (["nowhere.toml"], "cannot be read"),
        (["thesis_50vt", "--effect", "nix:a=1"], "nix"),
        (["thesis_50vt", "--effect", "rolling_shutter"], "SLUG:PARAMETER=VALUE"),
        (["thesis_50vt", "--effect", "rolling_shutter:readout=slow"], "SLUG:PARAMETER=VALUE"),
        (["thesis_50vt", "--effect", "rolling_shutter:readout"], "SLUG:PARAMETER=VALUE"),
        (["thesis_50vt", "--camera", "fraser8"], "goes with --like"),
        (["thesis_50vt", "--like", "somewhere"], "give one of them"),
        (["--like", "somewhere", "--noise", "none"], "noise of the measured block"),
        (["--like", "nowhere"], "there is no such folder"),
        (["thesis_50vt", "--effect", "rolling_shutter:speed=1"], "no parameter 'speed'"),
        (["thesis_50vt", "--seed", "-1"], "whole number"),
    ],
)
def test_wrong_input_is_status_2_and_one_sentence(words, says, capsys):
    try:
        status = main(["simulate", *words])
    except SystemExit as end:
        status = end.code
    assert status == 2
    assert says in capsys.readouterr().err.splitlines()[-1]


def test_a_folder_that_is_no_block_is_not_replaced_and_no_truth_stays(plan, tmp_path, capsys):
    other = tmp_path / "mine"
    other.mkdir()
    (other / "diary.txt").write_text("dear diary", encoding="utf-8")
    assert main(["simulate", str(plan), "-o", str(other)]) == 2
    assert [p.name for p in other.iterdir()] == ["diary.txt"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "small.toml"]


class TestLikeAMeasuredBlock:
    """`--like`: what a measured block would be, were the believed model the whole truth."""

    @pytest.fixture
    def measured(self, plan, tmp_path):
        noise = "[noise]\ntie_px = 0.3\nmark_px = 0.3\ngnss_m = 0.01\ncontrol_m = 0.004\n"
        plan.write_text(f"{PLAN}\n{noise}", encoding="utf-8")
        words = ["--effect", "rolling_shutter:readout=0.03", "--seed", "5"]
        assert main(["simulate", str(plan), "-o", str(tmp_path / "measured"), *words]) == 0
        return tmp_path / "measured"

    def test_it_writes_a_block_of_the_same_observations_and_its_truth(self, measured, tmp_path):
        out = tmp_path / "like"
        assert main(["simulate", "--like", str(measured), "-o", str(out)]) == 0
        here, there = corridor.read(out), corridor.read(measured)
        columns = ["point", "image"]
        assert here.tie_points[columns].astype(str).equals(there.tie_points[columns].astype(str))
        assert not here.tie_points["x"].equals(there.tie_points["x"])
        truth = json.loads((tmp_path / "like.truth.json").read_text(encoding="utf-8"))
        assert list(truth["centre"]) == list(here.images["image"])
        assert truth["effects"] == {}

    def test_an_effect_of_the_model_is_estimated_and_is_part_of_the_truth(self, measured, tmp_path):
        words = [
            "--camera",
            "f,cx,cy",
            "--effect",
            "rolling_shutter",
            "--effect",
            "gnss_bias:z=0.5",
        ]
        out = tmp_path / "like"
        assert main(["simulate", "--like", str(measured), "-o", str(out), *words]) == 0
        effects = json.loads((tmp_path / "like.truth.json").read_text(encoding="utf-8"))["effects"]
        adjusted = corridor.adjust(
            corridor.read(measured), camera="f,cx,cy", effects=["rolling_shutter"]
        )
        assert effects["rolling_shutter"]["readout"] == pytest.approx(
            adjusted.effects["value"].iloc[0], abs=adjusted.effects["sigma"].iloc[0]
        )
        assert effects["gnss_bias"] == {"z": 0.5}


def test_a_measured_block_is_not_replaced_by_a_simulated_one(plan, tmp_path, capsys):
    out = tmp_path / "flown"
    words = ["simulate", str(plan), "-o", str(out)]
    assert main(words) == main(words) == 0
    (tmp_path / "flown.truth.json").unlink()  # as of a block that somebody measured
    before = (out / "images.csv").read_bytes()
    assert main([*words, "--seed", "1"]) == 2
    assert "flown.truth.json" in capsys.readouterr().err
    assert (out / "images.csv").read_bytes() == before


def test_times_in_milliseconds_are_refused(plan, tmp_path, capsys):
    words = ["simulate", str(plan), "--effect", "rolling_shutter:readout=25"]
    assert main([*words, "-o", str(tmp_path / "b")]) == 2
    assert "25 ms are 0.025" in capsys.readouterr().err


def test_a_length_that_leads_off_the_earth_is_refused(plan, tmp_path, capsys):
    words = ["simulate", str(plan), "--effect", "gnss_bias:z=1e12"]
    assert main([*words, "-o", str(tmp_path / "b")]) == 2
    assert "farther than the middle of the Earth" in capsys.readouterr().err


def test_an_interior_moved_by_a_whole_focal_length_is_refused(plan, tmp_path, capsys):
    words = ["simulate", str(plan), "--effect", "focal:f=-100000"]
    assert main([*words, "-o", str(tmp_path / "b")]) == 2
    assert "give the difference" in capsys.readouterr().err


def test_the_settings_of_a_block_are_called_no_plan(plan, tmp_path, capsys):
    out = tmp_path / "flown"
    assert main(["simulate", str(plan), "-o", str(out)]) == 0
    assert main(["simulate", str(out / "block.toml"), "-o", str(tmp_path / "b")]) == 2
    assert "--like BLOCK" in capsys.readouterr().err
