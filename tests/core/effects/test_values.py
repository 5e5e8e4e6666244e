"""Values of effects mean the same in every file that holds them."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import Values, add, correct, find, parse_word
from corridor.core.simulation import add_noise
from corridor.interface.cli import main
from corridor.tools.formats import export_project, read_adjusted


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Two flights of 27 images with GNSS, control and a second camera in the second flight."""
    block = corridor_block(images=54, strips=2, observations_per_image=40, seed=3)
    second = block.images["flight"] == block.flight_names[-1]
    if len(block.flight_names) == 1:
        second = np.arange(54) >= 27
        block.images["flight"] = np.where(second, "F2", "F1")
    block.cameras["Q1"] = next(iter(block.cameras.values()))
    block.cameras = {name: replace(c, calibrated=True) for name, c in block.cameras.items()}
    block.images.loc[second, "camera"] = "Q1"
    folder = tmp_path_factory.mktemp("blocks") / "flown"
    block.write(folder)
    return corridor.read(folder)


def gnss(block):
    return block.gnss[["x", "y", "z"]].to_numpy()


def pixels(block):
    return block.tie_points[["x", "y"]].to_numpy()


class TestWhatAnAdjustmentFoundIsExported:
    def test_an_effect_of_each_flight(self, block, tmp_path):
        """It was refused: "effect gnss_bias has no parameter 'F1'"."""
        given = {"gnss_bias@flight": {"x": {"F1": 0.3, "F2": -0.2}}}
        found = corridor.adjust(
            add(block, given),
            effects=["gnss_bias@flight"],
            lever_arm="fixed",
            camera="fixed",
            priors={f"gnss_bias.{axis}": (0.0, 1.0) for axis in "xyz"},
        )
        found.save(tmp_path / "result")
        adjusted, effects = read_adjusted(tmp_path / "result")
        assert effects["gnss_bias"].kind == "flight"
        assert effects["gnss_bias"]["x"] == pytest.approx(found.values["gnss_bias"]["x"], abs=1e-12)
        command = ["export", "colmap-text", str(tmp_path / "result"), "--corrected"]
        assert main([*command, "-o", str(tmp_path / "project")]) == 0
        moved = gnss(correct(adjusted, effects)) - gnss(adjusted)
        row = np.flatnonzero(adjusted.images["flight"] == "F2")[0]
        assert moved[row, 0] == pytest.approx(-effects["gnss_bias"]["x"]["F2"], abs=1e-9)

    def test_an_effect_of_more_than_fifty_images(self, block, tmp_path):
        """It was refused: "cannot be read"."""
        found = corridor.adjust(
            block,
            effects=["time_rounding"],
            camera="fixed",
            lever_arm="fixed",
            priors={"time_rounding.offset": (0.0, 0.01)},
        )
        found.save(tmp_path / "result")
        adjusted, effects = read_adjusted(tmp_path / "result")
        assert len(effects["time_rounding"]["offset"]) == 54
        export_project(adjusted, "colmap", tmp_path / "out", effects=effects, corrected=True)
        frame = found.effects.set_index("group")["value"]
        assert effects["time_rounding"]["offset"] == pytest.approx(frame.to_dict(), rel=1e-9)


class TestWhatADiagnosisFoundIsTakenOut:
    def diagnosis(self, tmp_path, *entries):
        path = tmp_path / "diagnosis.json"
        path.write_text(json.dumps({"effects": entries}))
        return path

    def test_of_two_cameras_each_has_its_own_value(self, block, tmp_path):
        """The last one's was applied to both."""
        entry = {"slug": "focal", "parameters": [{"name": "f", "value": 3.0, "sigma": 0.1}]}
        other = {**entry, "parameters": [{"name": "f", "value": -2.0, "sigma": 0.1}]}
        first, second = block.cameras
        path = self.diagnosis(tmp_path, entry | {"camera": first}, other | {"camera": second})
        found = Values.read(path, block)
        assert found["focal"]["f"] == {first: 3.0, second: -2.0}

    def test_each_image_has_its_own_value(self, block, tmp_path):
        """The root mean square over the images was taken as the value of every image."""
        names = block.images["image"].tolist()
        values = {name: {"offset": {"value": 0.001 * n}} for n, name in enumerate(names)}
        rms = {"name": "offset", "value": 0.03, "statistic": "root mean square over the images"}
        entry = {"slug": "time_rounding", "parameters": [rms], "group": "image", "values": values}
        found = Values.read(self.diagnosis(tmp_path, entry), block)
        assert found["time_rounding"].value[:, 0] == pytest.approx(0.001 * np.arange(54))

    def test_a_file_with_the_root_mean_square_alone_is_refused(self, block, tmp_path, capsys):
        rms = {"name": "offset", "value": 0.03, "statistic": "root mean square over the images"}
        path = self.diagnosis(tmp_path, {"slug": "time_rounding", "parameters": [rms]})
        block.write(tmp_path / "block")
        command = ["correct", str(tmp_path / "block"), "--effect", "time_rounding"]
        assert main([*command, "--from", str(path), "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err.strip()
        assert "root mean square" in said and "\n" not in said
        assert not (tmp_path / "out").exists()


def values_of_every_kind(block, rng):
    """An effect of the block, of flights, of cameras and of images."""
    shapes = {"gnss_scale": "block", "gnss_bias@flight": "flight", "focal": "camera"}
    shapes["motion_per_image"] = "image"
    out = {}
    for name, kind in shapes.items():
        found = Values.of(block, {name: {}})
        (one,) = found.values()
        assert one.kind == kind
        out[name] = rng.normal(size=one.value.shape)
    return Values.of(block, out)


class TestRoundTrips:
    def test_what_is_written_is_read(self, block, tmp_path):
        told = values_of_every_kind(block, np.random.default_rng(1))
        for name, table in told.tables().items():
            table.to_csv(tmp_path / name, index=False)
        content = json.dumps({"effects": told.to_json()}).replace("NaN", "null")
        (tmp_path / "adjustment.json").write_text(content)
        found = Values.read(tmp_path / "adjustment.json", block)
        assert list(found) == list(told)
        for slug, one in told.items():
            assert found[slug].kind == one.kind
            assert found[slug].value == pytest.approx(one.value, rel=1e-9)

    def test_numbers_alone_are_read_too(self, block, tmp_path):
        told = values_of_every_kind(block, np.random.default_rng(2))
        (tmp_path / "b.truth.json").write_text(json.dumps({"effects": told.plain()}))
        found = Values.read(tmp_path / "b.truth.json", block)
        pd.testing.assert_frame_equal(found.frame, told.frame)

    def test_what_is_taken_out_stands_in_the_block(self, block):
        given = {"gnss_bias@flight": {"z": {"F1": 0.1, "F2": 0.2}}, "gnss_scale": {"scale": 1e-5}}
        done = correct(block, given)
        assert done.extra["corrected"] == {
            "gnss_bias": {"z": {"F1": 0.1, "F2": 0.2}},
            "gnss_scale": {"scale": 1e-5},
        }

    def test_the_truth_of_a_simulation_is_taken_out_of_it(self, tmp_path):
        given = {"rolling_shutter": {"readout": 0.03}}
        flown = corridor.simulate("thesis_50vt", given, seed=1)
        flown.write(tmp_path / "flown")
        told = Values.read(tmp_path / "flown.truth.json", flown)
        assert told.plain() == given


def test_the_word_for_the_command_line():
    found = Values.of(corridor_block(images=4, strips=1), {"gnss_bias": {"x": 0.5, "z": -1}})
    assert str(found["gnss_bias"]) == "gnss_bias:x=0.5,z=-1"
    assert corridor.effects.parse_word(str(found)) == ("gnss_bias", {"x": 0.5, "z": -1.0})


def test_the_group_may_be_told_by_the_names_alone(block):
    found = Values.of(block, {"gnss_bias": {"x": {"F1": 1.0, "F2": 2.0}}})
    assert found["gnss_bias"].kind == "flight"


def test_an_unknown_group_is_refused(block):
    with pytest.raises(corridor.InputError, match="none for 'F9'"):
        Values.of(block, {"gnss_bias": {"x": {"F9": 1.0}}})


def test_an_effect_itself_may_stand_for_its_slug(block):
    bias = find("gnss_bias").per("flight")
    moved = gnss(add(block, {bias: {"x": 1.0}})) - gnss(block)
    assert moved[:, 0] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_diagnosis_writes_what_each_image_has(tmp_path):
    """Exposure times wrong by 60 ms at 10 m/s: each image's own error is read from the file."""
    plain = corridor_block(images=24, strips=2, observations_per_image=100, seed=4)
    truth = 0.06 * np.random.default_rng(1).standard_normal((24, 1))
    flown = add_noise(
        add(plain, {"time_rounding": truth}), tie_px=0.3, mark_px=0.3, gnss_m=0.02, seed=2
    )
    diagnosis = corridor.diagnose(flown, camera="fixed", only=["time_rounding"])
    (one,) = diagnosis.effects
    assert one["slug"] == "time_rounding"
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(diagnosis.to_dict()))
    found = Values.read(path, flown)["time_rounding"]
    assert found.kind == "image" and found.groups == flown.images["image"].tolist()
    off = (found.value - truth) / found.sigma
    assert np.abs(off).max() < 5 and np.sqrt(np.mean(off**2)) < 2
    assert np.corrcoef(found.value[:, 0], truth[:, 0])[0, 1] > 0.95


@pytest.mark.parametrize(
    ("word", "values"),
    [
        ("lag:lag.2=0.06", {"lag": {"2": 0.06}}),
        ("lag:lag.1=0,lag.2=0.06", {"lag": {"1": 0.0, "2": 0.06}}),
        ("blunder:x.G01.a=1,y=2", {"x": {"G01.a": 1.0}, "y": 2.0}),
    ],
)
def test_a_word_may_give_values_of_single_groups(word, values):
    assert parse_word(word)[1] == values


@pytest.mark.parametrize(
    "word", ["lag:lag.=1", "lag:.2=1", "lag:lag=1,lag.2=2", "lag:lag", "x:a=1,a=2", "x:a.F=1,a.F=2"]
)
def test_a_word_that_gives_none_is_refused(word):
    with pytest.raises(ValueError):
        parse_word(word)
