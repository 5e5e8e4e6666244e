"""`corridor thermal`: from pictures to shifts of points, and one sentence for every wrong input."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pandas as pd
import pytest
from kit.wall import Course, Shots, Wall
from walls import camlight, off_by, rms

from corridor.core.errors import InputError
from corridor.core.output import sole
from corridor.interface.cli import main
from corridor.tools.thermal import read_maps, read_model, simple_model

ARRAYS = "picture time_s temperature_c reference width height x y dx dy sigma valid".split()
PROMISED = (
    "kind width height t0_c range_c normalisation coefficients residual_px lag_s lag_sigma_s "
    "warnings"
).split()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Nine pictures of 320 x 240, up and down."""
    folder = tmp_path_factory.mktemp("small") / "series"
    course = Course(np.linspace(0, 1600, 9), off_s=800)
    Shots(Wall(320, 240, seed=1), course, camlight(320, 240)).write(folder)
    return folder


@pytest.fixture(scope="module")
def mapped(small, tmp_path_factory):
    """The maps of the nine pictures, and what is said on stderr where nothing is wrong."""
    maps, said = tmp_path_factory.mktemp("mapped") / "maps.npz", io.StringIO()
    with contextlib.redirect_stderr(said):
        assert run("map", small, "-o", maps) == 0
    return maps, said.getvalue()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Thirteen pictures of 1280 x 960 and what the two commands make of them."""
    folder = tmp_path_factory.mktemp("made")
    model = camlight(1280, 960)
    course = Course(np.linspace(0, 1800, 13), off_s=900)
    Shots(Wall(1280, 960, seed=5), course, model).write(folder / "series")
    assert run("map", str(folder / "series"), "-o", str(folder / "maps.npz")) == 0
    assert run("fit", str(folder / "maps.npz"), "-o", str(folder / "m.json")) == 0
    return folder, model


def run(*words):
    """Exit status of `corridor thermal` with these words."""
    return main(["thermal", *map(str, words)])


def _interruptible():
    """In the command: a shell's background job ignores Ctrl-C, and so would what it starts; and who
    interrupts must get to it before a busy machine has finished the work."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.nice(19)


def copied(source, target):
    target.mkdir()
    for path in source.iterdir():
        (target / path.name).write_bytes(path.read_bytes())
    return target


def changed(folder, **columns):
    table = pd.read_csv(folder / "series.csv", dtype=str)
    for name, values in columns.items():
        for row, value in values.items():
            table.loc[row, name] = value
    table.to_csv(folder / "series.csv", index=False)


class TestThirteenPictures:
    def test_the_model_is_good_to_a_hundredth_of_a_pixel(self, made):
        """Issue 9, must show 3: RMS at most 0.01, corner 0.02 px, slope of f within 1 %."""
        folder, true = made
        found = read_model(folder / "m.json")
        for warm in np.linspace(*found.range_c, 5):
            off = off_by(found, true, warm)
            assert rms(off) <= 0.01 and np.abs(off).max() <= 0.02
        ends = np.array(found.range_c)
        slope = np.ptp(found.parameters(ends)["scale"]) / np.ptp(true.parameters(ends)["scale"])
        assert slope == pytest.approx(1.0, abs=0.01)

    def test_damaged_maps_are_maps_or_are_refused(self, made, tmp_path):
        whole = (made[0] / "maps.npz").read_bytes()
        rng, refused = np.random.default_rng(0), 0
        for _ in range(60):
            some = bytearray(whole)
            at = int(rng.integers(len(some) - 8))
            some[at : at + 8] = rng.bytes(8)
            (tmp_path / "some.npz").write_bytes(some)
            try:
                read_maps(tmp_path / "some.npz")
            except InputError as error:
                refused += 1
                assert "some.npz" in str(error)
        assert refused > 50

    def test_maps_hold_what_is_promised(self, made):
        with np.load(made[0] / "maps.npz", allow_pickle=False) as file:
            for name in ARRAYS:
                assert name in file
            assert file["dx"].shape == file["valid"].shape == (13, len(file["x"]))
            assert file["picture"].dtype.kind == "U" and file["valid"].dtype == bool
            assert (file["sigma"][file["valid"]] < 1).all()
            assert file["reference"].sum() == 1 and (file["width"], file["height"]) == (1280, 960)

    def test_the_model_says_what_is_promised_and_anyone_can_evaluate_it(self, made):
        """The polynomial of MODEL.json, written out."""
        folder, _ = made
        content = json.loads((folder / "m.json").read_text("utf-8"))
        assert all(key in content for key in PROMISED)
        unit = content["normalisation"]
        x, y, warm = 1000.0, 100.0, 40.0
        X, Y = (x - unit["x0"]) / unit["scale_px"], (y - unit["y0"]) / unit["scale_px"]
        t = (warm - content["t0_c"]) / unit["scale_c"]
        model = read_model(folder / "m.json")
        for key, got in zip(("dx", "dy"), model.displacement(x, y, warm), strict=True):
            value = sum(
                a * t ** (m + 1) * X**i * Y**j
                for m, layer in enumerate(content["coefficients"][key])
                for i, column in enumerate(layer)
                for j, a in enumerate(column)
            )
            assert got == pytest.approx(value, abs=1e-12)

    def test_pictures_lie_beside(self, made):
        for name in ("maps.png", "m.png"):
            assert cv2.imread(str(made[0] / name)) is not None


class TestMap:
    def test_two_into_one_file_do_not_share_what_is_unfinished(self, small, tmp_path, capsys):
        with sole(tmp_path / "a.npz.lock") as ours:
            assert ours and run("map", small, "-o", tmp_path / "a.npz") == 2
        assert "another `corridor thermal map` is writing it" in capsys.readouterr().err
        assert not list(tmp_path.iterdir())

    def test_a_series_that_cannot_be_read_leaves_no_folder(self, tmp_path):
        assert run("map", tmp_path / "none", "-o", tmp_path / "new" / "a.npz") == 2
        assert not list(tmp_path.iterdir())

    def test_rows_may_come_in_any_order_and_stay_in_it(self, small, mapped, tmp_path):
        folder = copied(small, tmp_path / "shuffled")
        table = pd.read_csv(folder / "series.csv", dtype=str).iloc[::-1]
        table.to_csv(folder / "series.csv", index=False)
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        a, b = read_maps(tmp_path / "a.npz"), read_maps(mapped[0])
        assert a.picture.tolist() == table["picture"].tolist()
        np.testing.assert_array_equal(a.dx[::-1], b.dx)

    @pytest.mark.parametrize(
        "kind",
        [
            "sixteen bits",
            *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("colour", "jpeg")),
        ],
    )
    def test_pictures_may_be_of_any_usual_kind(self, small, mapped, tmp_path, kind):
        folder = copied(small, tmp_path / "kind")
        names = {}
        for n, path in enumerate(sorted(folder.glob("*.png"))):
            grey = cv2.imread(str(path), 0)
            if kind == "jpeg":
                names[n] = f"{path.stem}.jpg"
                cv2.imwrite(str(folder / names[n]), grey)
            elif kind == "colour":
                cv2.imwrite(str(path), cv2.merge([grey] * 3))
            else:
                cv2.imwrite(str(path), grey.astype(np.uint16) * 257)
        changed(folder, picture=names)
        assert run("map", folder, "-o", tmp_path / "a.npz") == 0
        a, b = read_maps(tmp_path / "a.npz"), read_maps(mapped[0])
        assert rms(a.dx - b.dx) < (0.002 if kind == "jpeg" else 1e-4)

    def test_unknown_temperatures_are_kept_as_unknown(self, small, tmp_path):
        folder = copied(small, tmp_path / "gaps")
        changed(folder, temperature_c={3: ""})
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        warm = read_maps(tmp_path / "a.npz").temperature_c
        assert np.isnan(warm[3]) and np.isfinite(np.delete(warm, 3)).all()

    @pytest.mark.parametrize(
        ("array", "change", "words"),
        [
            ("y", lambda y: np.where(np.arange(len(y)) == 2, np.nan, y),
             "array y has no place inside the picture for node 3 of"),
            ("x", lambda x: 10 * x, "array x has no place inside the picture"),
            ("x", lambda x: 0.5 * x, "px apart in x"),
            ("dx", lambda dx: 0 * np.nan_to_num(dx), "array dx is zero everywhere"),
            ("dy", lambda dy: np.full_like(dy, np.inf), "array dy has no number for picture"),
            ("time_s", lambda time: np.full_like(time, np.nan), "array time_s has no number for"),
            ("height", lambda height: np.array(np.nan), "width and height are"),
            ("reference", lambda mark: mark.astype(str), "array reference holds no numbers"),
        ],
    )  # fmt: skip
    def test_maps_that_nobody_measured_are_refused(
        self, mapped, tmp_path, capsys, array, change, words
    ):
        with np.load(mapped[0]) as file:
            arrays = dict(file)
        arrays[array] = change(arrays[array])
        np.savez(tmp_path / "b.npz", **arrays)
        assert run("fit", str(tmp_path / "b.npz"), "-o", str(tmp_path / "m.json")) == 2
        assert words in capsys.readouterr().err

    @pytest.mark.parametrize("slip", ["temperature", "pictures"])
    def test_a_picture_that_does_not_fit_its_temperature_is_named(
        self, small, mapped, tmp_path, capsys, slip
    ):
        folder = copied(small, tmp_path / "slip")
        if slip == "temperature":
            changed(folder, temperature_c={4: "0"})
        else:
            for to, source in (("0000.png", "0004.png"), ("0004.png", "0000.png")):
                shutil.copy(small / source, folder / to)
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        said = capsys.readouterr().err
        assert "picture 0004.png grew by" in said and "picture 0002.png" not in said
        assert "grew by" not in mapped[1]

    def test_two_pictures_that_are_one_are_told(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "twins")
        shutil.copy(folder / "0004.png", folder / "0006.png")
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        assert "0004.png and 0006.png are the same, dot by dot" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"temperature_c": {8: ""}}, "1 of 9 pictures have no temperature_c, the first of"),
            ({"reference": {4: "1"}}, "pictures of the reference were taken at"),
        ],
    )
    def test_what_a_model_will_lack_is_told(self, small, tmp_path, capsys, change, words):
        folder = copied(small, tmp_path / "lacking")
        changed(folder, **change)
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        assert words in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("warm", "words"),
        [
            ("31.5", "the temperatures span 0.0 C"),
            ("", "no picture has a temperature_c"),
            ("88.7", "the temperatures reach 88.7 C, and electronics endure 85 C"),
        ],
    )
    def test_one_temperature_of_all_pictures_or_none_is_told(
        self, small, tmp_path, capsys, warm, words
    ):
        folder = copied(small, tmp_path / "same")
        changed(folder, temperature_c=dict.fromkeys(range(9), warm))
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        assert f"series.csv: {words}" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("grey", "word"), [(120, "texture"), (255, "saturated")], ids=["blank", "saturated"]
    )
    def test_a_spoilt_picture_is_kept_without_nodes_and_named(
        self, small, tmp_path, capsys, grey, word
    ):
        folder = copied(small, tmp_path / "spoilt")
        cv2.imwrite(str(folder / "0004.png"), np.full((240, 320), grey, np.uint8))
        assert run("map", str(folder), "-o", str(tmp_path / "a.npz")) == 0
        said = [line for line in capsys.readouterr().err.splitlines() if "warning: " in line]
        assert len(said) == 1 and "0004.png" in said[0] and word in said[0]
        maps = read_maps(tmp_path / "a.npz")
        assert not maps.valid[4].any() and np.isnan(maps.dx[4]).all()
        assert maps.valid[[1, 2, 3, 5, 6, 7, 8]].all()

    @pytest.mark.slow
    def test_interrupted_it_leaves_no_maps_and_goes_on_to_the_same_numbers(self, tmp_path):
        folder = tmp_path / "series"
        course = Course(np.linspace(0, 1600, 30), off_s=800)
        Shots(Wall(900, 700, seed=1), course, camlight(900, 700)).write(folder)
        out, whole = tmp_path / "maps.npz", tmp_path / "whole.npz"
        command = [sys.executable, "-m", "corridor", "thermal", "map", str(folder), "-o"]
        process = subprocess.Popen(
            [*command, str(out)], stderr=subprocess.PIPE, text=True, preexec_fn=_interruptible
        )
        kept = tmp_path / "maps.npz.part"
        for _ in range(300_000):  # ten minutes and more: a busy machine compiles kernels first
            if len(list(kept.glob("*.npz"))) >= 2 or process.poll() is not None:
                break
            time.sleep(0.002)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=600)[1]
        assert process.returncode == 130 and "goes on" in said.splitlines()[-1]
        assert "Traceback" not in said
        done = list(kept.glob("*.npz"))
        assert not out.exists() and 2 <= len(done) < 30
        marks = {path.name: path.stat().st_mtime_ns for path in done}
        assert run("map", str(folder), "-o", str(whole)) == 0
        before = {path.name: path.stat().st_mtime_ns for path in kept.glob("*.npz")}
        assert before == marks
        assert run("map", str(folder), "-o", str(out)) == 0
        assert not kept.exists()
        a, b = read_maps(out), read_maps(whole)
        for name in ("dx", "dy", "sigma", "valid"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))

    def test_what_is_finished_is_not_done_again_unless_the_series_changed(self, small, tmp_path):
        from corridor.tools.thermal import measure_maps

        folder, keep = copied(small, tmp_path / "again"), tmp_path / "keep"

        def stop(step):
            if step.done == 4:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            measure_maps(folder, keep, stop)
        first = {path.name: path.stat().st_mtime_ns for path in keep.glob("*.npz")}
        assert len(first) == 4
        with pytest.raises(KeyboardInterrupt):
            measure_maps(folder, keep, stop)
        assert {path.name: path.stat().st_mtime_ns for path in keep.glob("*.npz")} == first
        os.utime(folder / "0006.png", ns=(1, 1))
        with pytest.raises(KeyboardInterrupt):
            measure_maps(folder, keep, stop)
        assert {path.name: path.stat().st_mtime_ns for path in keep.glob("*.npz")} != first


class TestWrongSeries:
    def ends(self, folder, tmp_path, capsys):
        out = tmp_path / "none.npz"
        status = run("map", str(folder), "-o", str(out))
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert not out.exists() and not (tmp_path / "none.npz.part").exists()
        assert said.startswith("error: ")
        return status, said

    def test_another_size(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        cv2.imwrite(str(folder / "0005.png"), np.zeros((200, 320), np.uint8))
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and "0005.png" in said and "320 x 200" in said

    def test_a_cut_off_picture(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        whole = (folder / "0005.png").read_bytes()
        (folder / "0005.png").write_bytes(whole[: len(whole) // 2])
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and "0005.png" in said and "cut off" in said

    def test_not_a_picture(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        (folder / "0005.png").write_text("no picture")
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and "0005.png" in said

    def test_no_reference(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        changed(folder, reference={0: "0"})
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and "reference" in said

    def test_no_usable_picture(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        for path in folder.glob("*.png"):
            cv2.imwrite(str(path), np.full((240, 320), 130, np.uint8))
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and "usable" in said and "texture" in said

    @pytest.mark.parametrize(
        ("columns", "words"),
        [
            ({"picture": {2: "gone.png"}}, ("row 4", "gone.png")),
            ({"picture": {2: ""}}, ("row 4", "no picture is named")),
            ({"picture": {2: "0001.png"}}, ("row 4", "twice")),
            ({"time_s": {2: "noon"}}, ("row 4", "time_s", "noon")),
            ({"time_s": {2: ""}}, ("row 4", "time_s")),
            ({"temperature_c": {2: "warm"}}, ("row 4", "temperature_c")),
            ({"temperature_c": {2: "297.4"}}, ("row 4", "give degrees Celsius")),
            ({"reference": {2: "yes"}}, ("row 4", "reference")),
            ({"reference": {8: ""}}, ("row 10", "reference is empty")),
        ],
    )
    def test_a_wrong_cell_is_named_with_its_row(self, small, tmp_path, capsys, columns, words):
        folder = copied(small, tmp_path / "s")
        changed(folder, **columns)
        status, said = self.ends(folder, tmp_path, capsys)
        assert status == 2 and all(word in said for word in words)

    def test_no_series(self, tmp_path, capsys):
        status, said = self.ends(tmp_path, tmp_path, capsys)
        assert status == 2 and "series.csv" in said

    def test_a_file_in_place_of_the_folder(self, small, tmp_path, capsys):
        status, said = self.ends(small / "series.csv", tmp_path, capsys)
        assert status == 2 and "is a file; give the folder" in said


class TestFit:
    def test_no_temperature_is_wrong_input(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        changed(folder, temperature_c=dict.fromkeys(range(9), ""))
        assert run("map", str(folder), "-o", str(tmp_path / "m.npz")) == 0
        status = run("fit", str(tmp_path / "m.npz"), "-o", str(tmp_path / "m.json"))
        assert status == 2 and "temperature_c" in capsys.readouterr().err
        assert not (tmp_path / "m.json").exists()

    def test_a_jump_of_the_tripod_is_warned_of_and_named(self, small, tmp_path, capsys):
        folder = copied(small, tmp_path / "s")
        for n in range(5, 9):
            moved = np.roll(cv2.imread(str(folder / f"000{n}.png"), 0), (1, 1), (0, 1))
            cv2.imwrite(str(folder / f"000{n}.png"), moved)
        assert run("map", str(folder), "-o", str(tmp_path / "m.npz")) == 0
        capsys.readouterr()
        assert run("fit", str(tmp_path / "m.npz"), "-o", str(tmp_path / "m.json")) == 0
        said = capsys.readouterr().err
        assert "warning: " in said and "0004.png" in said and "0005.png" in said
        assert any("0005.png" in text for text in read_model(tmp_path / "m.json").warnings)

    @pytest.mark.parametrize("content", [b"", b"PK nothing", None])
    def test_no_maps_is_wrong_input(self, tmp_path, capsys, content):
        path = tmp_path / "m.npz"
        if content is not None:
            path.write_bytes(content)
        assert run("fit", str(path), "-o", str(tmp_path / "m.json")) == 2
        assert "m.npz" in capsys.readouterr().err


class TestApply:
    def points(self, tmp_path, text):
        path = tmp_path / "points.csv"
        path.write_text(text)
        return str(path)

    def test_there_and_back_is_nothing(self, made, tmp_path):
        """Design: 1e-6 px."""
        draw = np.random.default_rng(0)
        table = pd.DataFrame(
            {
                "x": draw.uniform(0, 1279, 200), "y": draw.uniform(0, 959, 200),
                "temperature_c": draw.uniform(24.5, 45, 200),
            }
        )  # fmt: skip
        there, back = tmp_path / "there.csv", tmp_path / "back.csv"
        table.to_csv(tmp_path / "p.csv", index=False)
        model = str(made[0] / "m.json")
        assert run("apply", model, "--points", str(tmp_path / "p.csv"), "-o", str(there)) == 0
        moved = pd.read_csv(there)
        assert moved.columns.tolist() == "x y temperature_c dx dy sigma extrapolated".split()
        np.testing.assert_array_equal(moved[["x", "y"]], table[["x", "y"]])
        seen = table.assign(x=moved["x"] + moved["dx"], y=moved["y"] + moved["dy"])
        seen.to_csv(tmp_path / "q.csv", index=False)
        command = ["thermal", "apply", model, "--points", str(tmp_path / "q.csv"), "--inverse"]
        assert main([*command, "-o", str(back)]) == 0
        again = pd.read_csv(back)
        assert np.abs(again["x"] + again["dx"] - table["x"]).max() < 1e-6
        assert np.abs(again["y"] + again["dy"] - table["y"]).max() < 1e-6

    def test_outside_the_range_sigma_grows_with_one_warning(self, made, tmp_path, capsys):
        low, high = read_model(made[0] / "m.json").range_c
        rows = "".join(f"100,100,{high + k}\n" for k in (-0.5, 2, 5, 10, 20))
        path = self.points(tmp_path, "x,y,temperature_c\n" + rows)
        out = tmp_path / "o.csv"
        assert run("apply", str(made[0] / "m.json"), "--points", path, "-o", str(out)) == 0
        said = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
        assert len(said) == 1 and "outside" in said[0]
        table = pd.read_csv(out)
        assert table["extrapolated"].tolist() == [0, 1, 1, 1, 1]
        assert (np.diff(table["sigma"]) > 0).all()

    def test_points_of_a_larger_picture_are_told(self, made, tmp_path, capsys):
        path = self.points(tmp_path, "x,y\n100,100\n5000,3800\n")
        command = ["thermal", "apply", str(made[0] / "m.json"), "--points", path]
        assert main([*command, "--temperature", "35", "-o", str(tmp_path / "o.csv")]) == 0
        said = capsys.readouterr().err
        assert "1 of 2 points lie outside the" in said and "pictures of another size?" in said

    def test_inside_nothing_is_said(self, made, tmp_path, capsys):
        path = self.points(tmp_path, "x,y\n0,0\n640.5,300\n")
        command = ["thermal", "apply", str(made[0] / "m.json"), "--points", path]
        assert main([*command, "--temperature", "35", "-o", str(tmp_path / "o.csv")]) == 0
        assert capsys.readouterr().err == ""
        assert (pd.read_csv(tmp_path / "o.csv")["temperature_c"] == 35).all()

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("x,y\n1,2\n", ("temperature_c",)),
            ("x,temperature_c\n1,30\n", ("column y",)),
            ("x,y,temperature_c\n1,2,30\n1,2,\n", ("row 3", "temperature_c")),
            ("x,y,temperature_c\n1,two,30\n", ("row 2", "two")),
        ],
    )
    def test_a_wrong_table_is_named_with_its_row(self, made, tmp_path, capsys, text, words):
        path = self.points(tmp_path, text)
        out = tmp_path / "o.csv"
        assert run("apply", str(made[0] / "m.json"), "--points", path, "-o", str(out)) == 2
        said = capsys.readouterr().err
        assert all(word in said for word in words) and not out.exists()

    @pytest.mark.parametrize(
        "change",
        [
            lambda c: c.pop("coefficients"),
            lambda c: c.update(kind="spline"),
            lambda c: c["normalisation"].update(scale_px=0),
            lambda c: c["coefficients"].update(dx=[1, 2]),
            lambda c: c.update(range_c=[50, 20]),
            lambda c: c.update(covariance=c["covariance"][1:]),
        ],
    )
    def test_a_wrong_model_is_refused(self, made, tmp_path, capsys, change):
        content = json.loads((made[0] / "m.json").read_text("utf-8"))
        change(content)
        (tmp_path / "m.json").write_text(json.dumps(content))
        path = self.points(tmp_path, "x,y,temperature_c\n1,2,30\n")
        command = ["thermal", "apply", str(tmp_path / "m.json"), "--points", path, "-o"]
        assert main([*command, str(tmp_path / "o.csv")]) == 2
        assert "m.json" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("rows", "more", "words"),
    [
        ("10,,40", (), ("row 2: y is empty",)),
        ("10,20,313", (), ("row 2", "Celsius")),
        ("10,20,40", ("--temperature", "40"), ("one of the two",)),
        ("", (), ("has no point",)),
    ],
)
def test_points_that_cannot_be_moved_are_told(tmp_path, capsys, rows, more, words):
    simple_model(400, 300).write(tmp_path / "m.json")
    (tmp_path / "p.csv").write_text(f"x,y,temperature_c\n{rows}\n", encoding="utf-8")
    points = ("--points", str(tmp_path / "p.csv"), *more, "-o", str(tmp_path / "o.csv"))
    assert run("apply", str(tmp_path / "m.json"), *points) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words) and "float64" not in said


def test_points_in_shares_of_the_picture_are_told(tmp_path, capsys):
    simple_model(400, 300).write(tmp_path / "m.json")
    (tmp_path / "p.csv").write_text("x,y\n0.1,0.2\n0.5,0.6\n", encoding="utf-8")
    points = ("--points", str(tmp_path / "p.csv"), "--temperature", "30")
    assert run("apply", str(tmp_path / "m.json"), *points, "-o", str(tmp_path / "o.csv")) == 0
    assert "Write pixels" in capsys.readouterr().err


def test_the_points_are_never_replaced_by_what_is_made_of_them(tmp_path, capsys):
    simple_model(400, 300).write(tmp_path / "m.json")
    points = tmp_path / "p.csv"
    points.write_text("x,y,temperature_c,name\n10,20,30,a\n", encoding="utf-8")
    model = str(tmp_path / "m.json")
    assert run("apply", model, "--points", str(points), "-o", str(points)) == 2
    assert "is what is read" in capsys.readouterr().err
    assert "name" in points.read_text(encoding="utf-8")
