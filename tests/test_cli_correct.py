"""`corridor correct`: a block in, the block without an effect out."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import add
from corridor.interface.cli import main

READOUT = 0.0564


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A block with a rolling shutter, which its block.toml states."""
    block = corridor_block(images=8, strips=2, observations_per_image=60, seed=3)
    block.cameras = {k: replace(c, readout_s=READOUT) for k, c in block.cameras.items()}
    path = tmp_path_factory.mktemp("blocks") / "flown"
    add(block, {"rolling_shutter": {"readout": READOUT}}).write(path)
    return path


def pixels(block):
    return block.tie_points[["x", "y"]].to_numpy()


def test_the_readout_that_the_block_states_is_taken_out_of_it(folder, tmp_path, capsys):
    out = tmp_path / "corrected"
    assert main(["correct", str(folder), "--effect", "rolling_shutter", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "readout = 0.0564" in said and "vx, vy, vz of images.csv" in said
    before, after = corridor.read(folder), corridor.read(out)
    assert np.abs(pixels(after) - pixels(before)).max() > 1
    # Issue 10, Must 6.
    back = add(after, {"rolling_shutter": {"readout": READOUT}})
    assert np.abs(pixels(back) - pixels(before)).max() < 1e-6
    record = after.extra["corrected"]
    assert record["rolling_shutter"] == {"readout": READOUT}
    assert any("velocities" in note for note in record["notes"])


def test_values_are_given_or_come_from_an_adjustment(folder, tmp_path):
    given, found = tmp_path / "given", tmp_path / "found"
    main(["correct", str(folder), "--effect", "rolling_shutter:readout=0.03", "-o", str(given)])
    told = {"effects": {"rolling_shutter": {"readout": {"value": 0.03, "sigma": 1.0, "unit": "s"}}}}
    (tmp_path / "adjustment.json").write_text(json.dumps(told))
    words = ["--effect", "rolling_shutter", "--from", str(tmp_path / "adjustment.json")]
    assert main(["correct", str(folder), *words, "-o", str(found)]) == 0
    assert np.array_equal(pixels(corridor.read(given)), pixels(corridor.read(found)))


def test_a_diagnosis_gives_values_as_well(folder, tmp_path):
    entry = {"slug": "gnss_bias", "parameters": [{"name": "z", "value": 0.07}]}
    (tmp_path / "diagnosis.json").write_text(json.dumps({"effects": [entry]}))
    words = ["--effect", "gnss_bias", "--from", str(tmp_path / "diagnosis.json")]
    assert main(["correct", str(folder), *words, "-o", str(tmp_path / "out")]) == 0
    moved = corridor.read(tmp_path / "out").gnss["z"] - corridor.read(folder).gnss["z"]
    assert moved.to_numpy() == pytest.approx(-0.07)


@pytest.mark.parametrize(
    "effect", ["lever_arm:x=0.1,y=0,z=0.2", "focal:f=3", "control_datum:z=0.1"]
)
def test_any_effect_of_the_catalogue_is_taken_out(folder, tmp_path, effect):
    assert main(["correct", str(folder), "--effect", effect, "-o", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--effect", "rolling"], "is unknown"),
        (["--effect", "gnss_bias"], "states none: write gnss_bias:x="),
        (["--effect", "rolling_shutter:speed=3"], "no parameter 'speed'"),
        (["--effect", "gnss_bias", "--from", "nowhere.json"], "nowhere.json cannot be read"),
    ],
)
def test_wrong_input_is_one_sentence_and_no_block(folder, tmp_path, capsys, words, said):
    out = tmp_path / "out"
    assert main(["correct", str(folder), *words, "-o", str(out)]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and "\n" not in error
    assert not out.exists()


def test_time_stamps_that_nothing_can_fly_stop_it(folder, tmp_path, capsys):
    block = corridor.read(folder)
    block.images = block.images.drop(columns=["vx", "vy", "vz"])
    block.images["time_s"] /= 100
    block.gnss = block.gnss.iloc[:0]
    block.write(tmp_path / "fast")
    words = ["--effect", "rolling_shutter", "-o", str(tmp_path / "out")]
    assert main(["correct", str(tmp_path / "fast"), *words]) == 2
    assert "m/s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_heat_is_taken_out_by_the_model_of_a_laboratory_and_comes_back(tmp_path, capsys):
    """Issue 9, Must 9."""
    block = corridor_block(images=8, strips=2, observations_per_image=60, seed=3)
    block.images["temperature_c"] = np.linspace(26, 34, 8)
    block.write(tmp_path / "warm")
    camera = next(iter(block.cameras.values()))
    model = corridor.thermal.simple_model(camera.width, camera.height, radial=(0.01,))
    model.write(tmp_path / "model.json")
    command = ["correct", str(tmp_path / "warm"), "--effect", "thermal"]
    command += ["--model", str(tmp_path / "model.json"), "-o", str(tmp_path / "cool")]
    assert main(command) == 0
    count = len(block.tie_points)
    assert f"tie_points: {count} of {count} rows moved" in capsys.readouterr().out
    cool = corridor.read(tmp_path / "cool")
    assert np.abs(pixels(cool) - pixels(block)).max() > 0.1
    back, _ = corridor.thermal.uncorrect(cool, model)
    assert np.abs(pixels(back) - pixels(block)).max() < 1e-6


def test_a_thermal_model_is_refused_with_values_or_another_effect(folder, tmp_path, capsys):
    model = tmp_path / "model.json"
    corridor.thermal.simple_model(5120, 3840).write(model)
    for effect in ("rolling_shutter", "thermal:scale=0.1"):
        command = ["correct", str(folder), "--effect", effect, "--model", str(model)]
        assert main([*command, "-o", str(tmp_path / "out")]) == 2
        assert "--effect thermal alone" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_block_is_never_replaced_by_what_is_made_of_it(folder, tmp_path, capsys):
    """The same words a second time would take the effect out twice."""
    words = ["correct", str(folder), "--effect", "rolling_shutter:readout=0.03", "-o"]
    before = (folder / "tie_points.csv").read_bytes()
    (tmp_path / "link").symlink_to(folder)
    for same in (folder, folder / ".." / folder.name, tmp_path / "link"):
        assert main([*words, str(same)]) == 2
        assert "is what is read, and would be replaced" in capsys.readouterr().err
    assert (folder / "tie_points.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [(["rolling_shutter:readout=nan"], "readout = nan is not a number"),
     (["rolling_shutter:readout=inf"], "readout = inf is not a number"),
     (["rolling_shutter:readout=0.02", "rolling_shutter:readout=0.03"], "readout is given twice")],
)  # fmt: skip
def test_a_value_is_a_number_and_given_once(folder, tmp_path, capsys, words, said):
    every = [word for one in words for word in ("--effect", one)]
    assert main(["correct", str(folder), *every, "-o", str(tmp_path / "out")]) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_block_of_which_nothing_was_taken_out_is_not_replaced(folder, tmp_path, capsys):
    words = ["correct", str(folder), "--effect", "rolling_shutter:readout=0.03", "-o"]
    assert main([*words, str(tmp_path / "out")]) == main([*words, str(tmp_path / "out")]) == 0
    other = tmp_path / "measured"
    shutil.copytree(folder, other)
    capsys.readouterr()
    assert main([*words, str(other)]) == 2
    assert "nothing was taken out" in capsys.readouterr().err


def test_a_block_in_the_folder_that_would_be_replaced_is_kept(folder, tmp_path, capsys):
    result = tmp_path / "result"
    shutil.copytree(folder, result / "block")
    (result / "adjustment.json").write_text('{"files": ["block/block.toml"]}', encoding="utf-8")
    assert main(["adjust", str(result / "block"), "-o", str(result)]) == 2
    assert "holds what is read, and would be replaced" in capsys.readouterr().err
