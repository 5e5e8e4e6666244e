"""`corridor diagnose`: what it prints, writes and returns, whatever is missing from a block."""

import contextlib
import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

from corridor.core.simulation import add_noise
from corridor.interface.cli import main


def small(seed=4):
    """Twelve images of noise alone, with every column there is."""
    block = corridor_block(
        images=12, strips=3, observations_per_image=70, control=5, check=4, relief=5.0, seed=seed
    )
    block.images["temperature_c"] = 20 + 5 * np.sin(np.arange(12) / 3)
    return add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.004, seed=seed)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("blocks") / "small"
    small().write(path)
    return path


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    """The command as a user types it, and what came of it."""
    out = tmp_path_factory.mktemp("results") / "small"
    words = ["corridor", "diagnose", str(folder), "-o", str(out), "--counterparts", "19"]
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as told,
        contextlib.redirect_stderr(io.StringIO()) as news,
    ):
        patch.setattr(sys, "argv", words)
        status = main()
    return out, SimpleNamespace(returncode=status, stdout=told.getvalue(), stderr=news.getvalue())


class TestDiagnose:
    def test_it_ends_with_status_0_and_names_what_it_wrote(self, done):
        out, process = done
        assert process.returncode == 0, process.stderr
        told = process.stdout.partition(f"Wrote {out}\n")[2]
        for name in ("diagnosis.json", "block/ (", "corrected/ (", "pictures"):
            assert name in told
        assert process.stdout.splitlines()[-1] == f"Read {out / 'report.html'}"
        for name in ("report.html", "diagnosis.json", "block/block.toml", "corrected/images.csv"):
            assert (out / name).is_file()

    def test_it_opens_with_the_sentence(self, done):
        out, process = done
        result = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        printed = " ".join(process.stdout.split())
        assert printed.startswith(result["sentence"])

    def test_it_says_on_stderr_what_it_is_at(self, done):
        assert "searching, round 1" in done[1].stderr
        assert "simulating counterparts of the believed model: 19 of 19" in done[1].stderr
        assert "Traceback" not in done[1].stderr and "WARNING" not in done[1].stderr

    def test_the_page_says_how_it_was_made(self, done, folder):
        page = (done[0] / "report.html").read_text(encoding="utf-8")
        assert f"<pre>corridor diagnose {folder} -o {done[0]} --counterparts 19</pre>" in page

    def test_where_nothing_is_missing_the_detection_limits_lead(self, done):
        result = json.loads((done[0] / "diagnosis.json").read_text(encoding="utf-8"))
        page = (done[0] / "report.html").read_text(encoding="utf-8")
        assert result["verdict"] == "nothing"
        assert 0 < page.index("smallest seen") < page.index("<img")

    def test_without_an_output_folder_it_says_that_nothing_is_kept(self, folder, capsys):
        assert main(["diagnose", str(folder), "--only", "rolling_shutter"]) == 0
        assert "Nothing was written" in capsys.readouterr().out

    def test_options_reach_the_call(self, folder, monkeypatch):
        called = {}

        def record(block, **options):
            called.update(options)
            return SimpleNamespace()

        monkeypatch.setattr("corridor.diagnosis.diagnose", record)
        words = (
            "--camera f,cx,cy --effect gnss_bias --control P1,P2 --check none "
            "--prior thermal=0.075+-0.01 --prior camera.P1.f=8190+-5 --only thermal,focal_drift "
            "--only clock_offset --without refraction --level 0.05 --seed 7 --threads 1"
        )
        assert main(["diagnose", str(folder), *words.split()]) == 0
        called.pop("progress")
        told = vars(called.pop("model"))
        assert [effect.slug for effect in told.pop("effects")] == ["gnss_bias"]
        assert {**called, **told} == {
            "camera": "f,cx,cy",
            "loss": "squares",
            "lever_arm": None,
            "motion": None,
            "parameters": {},
            "control": ["P1", "P2"],
            "check": [],
            "priors": {"thermal": (0.075, 0.01), "camera.P1.f": (8190.0, 5.0)},
            "only": ["thermal", "focal_drift", "clock_offset"],
            "without": ["refraction"],
            "level": 0.05,
            "seed": 7,
            "threads": 1,
            "max_iterations": None,
            "strict": False,
        }


class TestBadInput:
    @pytest.mark.parametrize(
        "words",
        [
            "--prior thermal=0.075",
            "--counterparts 5",
            "--seed -1",
            "--level high",
            "--only ,",
            "--threads 0",
        ],
    )
    def test_an_option_that_makes_no_sense_is_status_2(self, folder, capsys, words):
        with pytest.raises(SystemExit) as stop:
            main(["diagnose", str(folder), *words.split()])
        assert stop.value.code == 2
        assert words.split()[0] in capsys.readouterr().err.splitlines()[-1]

    @pytest.mark.parametrize(
        ("words", "said"),
        [
            ("--effect jelly", "jelly"),
            ("--only jelly", "jelly"),
            ("--level 2", "level"),
            ("--control P99", "P99"),
            ("--prior jelly=1+-1", "jelly"),
        ],
    )
    def test_what_does_not_exist_is_one_sentence(self, folder, capsys, words, said):
        assert main(["diagnose", str(folder), *words.split()]) == 2
        last = capsys.readouterr().err.splitlines()[-1]
        assert last.startswith("error: ") and said in last

    def test_a_folder_of_something_else_is_refused_before_any_work(
        self, folder, tmp_path, monkeypatch, capsys
    ):
        monkeypatch.setattr("corridor.diagnosis.diagnose", None)
        (tmp_path / "thesis.tex").write_text("years of work")
        assert main(["diagnose", str(folder), "-o", str(tmp_path)]) == 2
        assert "name a new folder" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def without_times(block):
    block.images = block.images.drop(columns="time_s")


def without_temperatures(block):
    block.images = block.images.drop(columns="temperature_c")


def without_gnss(block):
    block.gnss = block.gnss.iloc[:0]


def without_check_points(block):
    block.ground = block.ground.assign(role=block.ground["role"].replace("check", "unused"))


def without_control(block):
    block.ground = block.ground.assign(role=block.ground["role"].replace("control", "unused"))


def without_ground(block):
    block.ground, block.marks = block.ground.iloc[:0], block.marks.iloc[:0]


def without_point_coordinates(block):
    block.points = block.points.iloc[:0]


def with_marks_alone(block):
    block.tie_points, block.points = block.tie_points.iloc[:0], block.points.iloc[:0]


def with_a_track_alone(block):
    time = block.images["time_s"].to_numpy()
    order = np.argsort(time)
    epochs = np.arange(np.floor(time.min()) - 3, np.ceil(time.max()) + 4, 0.5)
    columns = {
        axis: np.interp(epochs, time[order], block.gnss[axis].to_numpy()[order]) for axis in "xyz"
    }
    block.track = pd.DataFrame({"time_s": epochs, **columns})
    block.gnss = block.gnss.iloc[:0]


class TestMissing:
    """Must show 11: columns that are missing stop nothing, and are listed with what to add."""

    @pytest.mark.parametrize(
        ("leave_out", "said"),
        [
            (without_ground, "check points (role check in ground.csv)"),
            *(
                pytest.param(leave_out, said, marks=pytest.mark.slow)
                for leave_out, said in (
                    (without_times, "time_s in images.csv"),
                    (without_gnss, "antenna positions (gnss.csv"),
                    (with_marks_alone, ""),
                    (without_temperatures, "temperature_c in images.csv"),
                    (without_check_points, "check points (role check in ground.csv)"),
                    (without_control, "control points (role control in ground.csv"),
                    (without_point_coordinates, ""),
                    (with_a_track_alone, "interpolated from the track"),
                )
            ),
        ],
    )
    def test_it_ends_in_a_sentence_all_the_same(self, leave_out, said, tmp_path, capsys):
        block = small()
        leave_out(block)
        block.write(tmp_path / "block")
        assert main(["diagnose", str(tmp_path / "block")]) == 0
        printed = " ".join(capsys.readouterr().out.split())
        assert printed.startswith("Nothing is missing from the model")
        assert said in printed

    @pytest.mark.slow
    @pytest.mark.parametrize("leave_out", [without_ground, with_marks_alone, with_a_track_alone])
    def test_the_report_is_written_too(self, leave_out, tmp_path):
        block = small()
        leave_out(block)
        block.write(tmp_path / "block")
        assert main(["diagnose", str(tmp_path / "block"), "-o", str(tmp_path / "out")]) == 0
        assert "To test more, add" in (tmp_path / "out" / "report.html").read_text("utf-8")

    @pytest.mark.slow
    def test_five_images_end_in_a_sentence(self, real_data, tmp_path):
        block = real_data / "strasbourg"
        assert main(["diagnose", str(block), "-o", str(tmp_path / "out")]) == 0
        assert json.loads((tmp_path / "out" / "diagnosis.json").read_text("utf-8"))["sentence"]
