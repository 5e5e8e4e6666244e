"""The benchmarks still run, in a short form; their full form is for a quiet machine."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


def run(script, *options):
    return subprocess.run(
        [sys.executable, str(FOLDER / script), *options], capture_output=True, text=True
    )


def test_reading_and_writing_a_block_is_timed(tmp_path):
    done = run("block_io.py", "--observations", "50000", "--json", str(tmp_path / "io.json"))
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "io.json").read_text())
    assert all(value > 0 for value in figures.values() if isinstance(value, int | float))


@pytest.mark.skipif(sys.platform == "win32", reason="peak memory is asked of Unix")
def test_projects_out_and_in_again_are_timed(tmp_path):
    """Of two formats: each is two programs, which take longer to start than to work."""
    kept, formats = str(tmp_path / "x.json"), ("colmap", "micmac")
    done = run("interchange.py", "--observations", "5000", "--json", kept, *formats)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "x.json").read_text())
    assert {f"{form} {what} s" for form in formats for what in ("export", "import")} <= set(figures)
    assert all(value > 0 for value in figures.values())


def test_readout_times_in_photographs_are_timed_and_right(tmp_path):
    """Within what is asked of a star and a LED, 0.15 % and 0.05 %, and of one wheel, 1.2 %."""
    done = run("readout.py", "--short", "--json", str(tmp_path / "readout.json"))
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "readout.json").read_text())
    for target, percent in (("star", 0.15), ("wheel", 1.2), ("led", 0.05)):
        assert figures[target]["clock_s"] > 0
        assert abs(figures[target]["error_percent"]) < percent


@pytest.mark.skipif(sys.platform == "win32", reason="peak memory is asked of Unix")
def test_diagnoses_are_timed_and_say_something_before_the_counterparts(tmp_path):
    done = run("diagnosis_speed.py", "--short", "--json", str(tmp_path / "speed.json"))
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "speed.json").read_text())["rows"]
    assert [row["images"] for row in rows] == [24, 48]
    assert all(0 < row["first_s"] < row["wall_s"] and row["peak_mb"] > 50 for row in rows)
    assert rows[0]["exponent"] is None and -1 < rows[1]["exponent"] < 3


@pytest.mark.skipif(sys.platform == "win32", reason="peak memory is asked of Unix")
def test_a_river_is_adjusted_from_parquet_to_parquet_and_comes_out_right(tmp_path):
    """Two blocks: f within 5 of its sigmas, check points within 6 cm at 50 m, no larger errors."""
    kept, figures = tmp_path / "kept", tmp_path / "river.json"
    done = run("river.py", "--short", "--folder", str(kept), "--json", str(figures))
    assert done.returncode == 0, done.stderr
    rows = json.loads(figures.read_text())["rows"]
    assert [row["images"] for row in rows] == [60, 120]
    for row in rows:
        assert abs(row["f_over_sigma"]) < 5 and row["check_3d_m"] < 0.06
        assert 0.95 < row["sigma0"] < 1.05
        stages, seconds, peaks = zip(*row["stages"], strict=True)
        assert {"read", "order", "solve", "adjusted block"} < set(stages)
        assert list(seconds) == sorted(seconds) and seconds[-1] <= row["cpu_s"]
        assert list(peaks) == sorted(peaks) and peaks[-1] <= row["peak_mb"]
    assert (kept / "river_60_1_15" / "tie_points.parquet").is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="peak memory is asked of Unix")
def test_long_flights_are_simulated_and_timed(tmp_path):
    done = run("simulation.py", "--short", "--json", str(tmp_path / "simulation.json"))
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "simulation.json").read_text())["rows"]
    assert [row["images"] for row in rows] == [60, 120]
    assert all(0 < row["cpu_s"] and row["peak_mb"] > 50 for row in rows)


@pytest.mark.skipif(
    importlib.util.find_spec("pyceres") is not None, reason="pyceres is installed: the next test"
)
def test_without_ceres_one_sentence_says_what_to_install():
    done = run("against_ceres.py", "--short")
    assert done.returncode == 2
    assert "bench" in done.stderr.splitlines()[-1]


@pytest.mark.skipif(
    importlib.util.find_spec("pyceres") is None, reason="pyceres is not installed (extra 'bench')"
)
def test_ceres_and_we_agree_on_the_cost(tmp_path):
    done = run("against_ceres.py", "--images", "114", "--json", str(tmp_path / "ceres.json"))
    assert done.returncode in (0, 1), done.stderr
    assert (tmp_path / "ceres.json").exists()
