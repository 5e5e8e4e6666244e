"""The benchmark on real, tiny blocks: from a folder, gone on with, and how an effect shows."""

import importlib
import json

import numpy as np
import pandas as pd
import pytest

import corridor
from benchmarks import diagnosis as benchmark
from benchmarks.diagnosis.__main__ import main
from benchmarks.diagnosis.assess import assess
from benchmarks.diagnosis.baselines import METHODS, baselines
from benchmarks.diagnosis.generator import plan_of_benchmark as made
from benchmarks.diagnosis.signal import Signal, _as_one, signals
from benchmarks.diagnosis.truth import truth_of
from corridor.core.adjustment import Model
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis.reference import ReferenceModel

TINY = {"images": 24, "observations": 80, "check": 4, "noise": made.null("clean").noise}


def hidden(slug, factor=1.0, **changes):
    """A block of 24 images with one effect, white noise of 0.3 px and 8 mm."""
    return made.generate(made.single(slug, factor, **(TINY | changes)), 3)


def signal_of(one, **changes):
    found = corridor.diagnose(one.twin, only=changes.pop("only", None))
    evidence = found.course.rounds[0].evidence
    return signals(truth_of(one.truth | changes), evidence, one.block, one.twin, {})


@pytest.fixture(scope="module")
def shutter():
    return hidden("rolling_shutter")


class TestSignal:
    def test_two_ways_to_the_signal_to_noise_ratio_agree(self, shutter):
        """theta' M theta of the reduced system, and what two adjustments by plain least squares
        differ by in their residuals. The reduced system weighs image and GNSS noise as the block
        shows them: in 24 images within 15 per cent of what is stated."""
        (reduced,) = signal_of(shutter, only=["rolling_shutter"]).values()
        bare = {"effects": [{"slug": "rolling_shutter"}]}
        (residual,) = signal_of(shutter, only=["rolling_shutter"], **bare).values()
        assert (reduced.by, residual.by) == ("reduced", "residuals")
        assert reduced.ratio == pytest.approx(residual.ratio, rel=0.15)

    def test_it_is_the_truth_over_its_sigma(self, shutter):
        bare = {"effects": [{"slug": "rolling_shutter"}]}
        (found,) = signal_of(shutter, only=["rolling_shutter"], **bare).values()
        adjusted = corridor.adjust(shutter.twin, "fraser10", ["rolling_shutter"])
        assert found.ratio == pytest.approx(0.025 / adjusted.effects["sigma"].item(), rel=0.05)

    def test_a_bias_of_the_gnss_is_never_apart_from_one_of_the_control(self):
        one = hidden("gnss_bias", geometry="oblique")
        (found,) = signal_of(one, only=["gnss_bias", "control_datum", "thermal"]).values()
        assert found.rival == "control_datum" and not found.separable
        assert found.alike and found.apart < 0.05 * found.ratio

    def test_slow_noise_of_the_gnss_is_a_rival_of_what_the_antenna_feels(self, shutter):
        """It may pass for a bias of the antenna; what the pictures show it hardly explains.

        By either way: residuals, too, lose what the noise takes of them.
        """

        def both(one):
            bare = {"effects": [{"slug": truth_of(one.truth).inside[0].slug}]}
            slug = bare["effects"][0]["slug"]
            first = corridor.diagnose(one.twin, only=[slug]).course.rounds[0]
            found, residual = (
                signals(truth_of(one.truth | more), first.evidence, one.block, one.twin, {},
                        first.noises)[slug]
                for more in ({}, bare)
            )  # fmt: skip
            assert (residual.by, residual.ratio) == (
                "residuals",
                pytest.approx(found.ratio, rel=0.15),
            )
            assert residual.from_noise == pytest.approx(found.from_noise, rel=0.15)
            return found

        bias, picture = both(hidden("gnss_bias", geometry="oblique")), both(shutter)
        assert bias.apart == bias.ratio and bias.from_noise < 0.8 * bias.ratio
        assert picture.from_noise == pytest.approx(picture.ratio, rel=0.05)

    def test_what_noise_of_the_gnss_may_be_is_not_separable(self):
        assert Signal(9.0, 7.0, "clock_offset", "reduced").separable
        assert not Signal(9.0, 7.0, "clock_offset", "reduced", from_noise=4.9).separable
        assert not Signal(9.0, 7.0, "clock_offset", "reduced", from_noise=1.0).alike

    def test_forty_values_as_large_as_their_noise_bring_6_log_units(self):
        """40 (1 - log 2) / 2 = 6.137 for s^2 = 1, twice that is the square of the ratio."""
        assert _as_one(40.0, np.eye(40)) == pytest.approx(12.274, abs=1e-3)

    def test_nothing_is_known_of_blocks_whose_rows_differ_from_their_twins(self, shutter):
        fewer = shutter.block.copy()
        fewer.tie_points = fewer.tie_points.iloc[20:].reset_index(drop=True)
        evidence = corridor.diagnose(shutter.twin, only=["thermal"]).course.last.evidence
        truth = truth_of({"effects": ["rolling_shutter"]})
        (found,) = signals(truth, evidence, fewer, shutter.twin, {}).values()
        assert found.ratio is None and found.separable is None


class TestWhatTheNameCloses:
    def assessed(self, slug, *args, **changes):
        """Diagnosed among what is most like it: of these alone the answer is found as of all."""
        one = hidden(slug, *args, **changes)
        options = {"only": ["gnss_scale", "gnss_bias", "control_datum", "focal_drift", "thermal"]}
        return assess("one", one.block, one.twin, truth_of(one.truth), options, rivals=False)

    def test_a_scale_is_gone_once_it_is_estimated(self):
        row = self.assessed("gnss_scale", 25.0)
        assert row["excess"] > 2.0
        assert row["known_over_twin"] < 1.25 and row["closure_known"] > 0.98
        assert row["check_known"] == row["check_after"]  # it was named

    @pytest.mark.slow
    def test_control_in_a_datum_of_its_own_leaves_no_height_where_the_arm_is_free(self):
        """Nadir images: GNSS heights know the ground but for the antenna's, which nobody knows."""
        row = self.assessed("control_datum", geometry="nadir")
        assert row["excess"] > 2.0 and row["known_over_twin"] > 5.0


@pytest.fixture(scope="module")
def adjusted(shutter):
    believed = ReferenceModel.of(shutter.block, Model())
    return believed, believed.adjust()


class TestBaselines:
    @pytest.mark.slow
    def test_each_has_a_number_for_every_effect_that_can_be_tested(self, adjusted):
        said = baselines(*adjusted)
        assert set(said) == set(METHODS)
        assert {"rolling_shutter", "gnss_bias", "thermal"} <= set(said["bic"])
        control = {key for key in said["bic"] if key.startswith("control_blunder.")}
        assert len(control) == 5 and control <= set(said["correlation"])
        assert max(said["bic"], key=said["bic"].get) == "rolling_shutter"

    @pytest.mark.slow
    def test_an_expert_finds_a_strong_rolling_shutter_by_bic(self, adjusted):
        """Beside what it is mistaken for, a drift, an error of the clock and a wrong point."""
        tried = ["rolling_shutter", "focal_drift", "clock_offset", "gnss_bias", "control_blunder"]
        said = baselines(*adjusted, only=tried)
        assert set(said) == set(METHODS)
        assert max(said["bic"], key=said["bic"].get) == "rolling_shutter"
        assert {key.partition(".")[0] for key in said["correlation"]} == set(tried)
        assert all(0 <= value <= 1 for value in said["correlation"].values())


@pytest.fixture(scope="module")
def folder(shutter, tmp_path_factory):
    """A stranger's folder: a block with twin and truth, another with the least truth there is."""
    path = tmp_path_factory.mktemp("theirs")
    shutter.write(path / "first")
    other = made.generate(made.null("clean", **{k: v for k, v in TINY.items() if k != "noise"}), 4)
    (path / "more").mkdir()
    other.block.write(path / "more" / "second")
    (path / "more" / "second.truth.json").write_text('{"effects": []}', encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "b"
    code = main(["--blocks", str(folder), "-o", str(out),
                 "--without-baselines"])  # fmt: skip
    return out, code


@pytest.mark.slow
class TestCommand:
    def test_a_strangers_folder_is_diagnosed(self, done):
        out, code = done
        assert code == 0
        content = json.loads((out / "benchmark.json").read_text(encoding="utf-8"))
        first, second = content["rows"]
        assert (first["name"], second["name"]) == ("first", "more-second")
        assert first["named"] == ["rolling_shutter"] and first["twin"]["verdict"] == "nothing"
        assert min(first["check_before"], first["check_after"], first["check_twin"]) > 0.001
        assert abs(first["parameters"][0]["sigmas"]) < 4
        assert second["verdict"] == "nothing" and second["kind"] == "null"
        assert content["summary"]["null"]["all"]["false_name"]["count"] == 2

    def test_a_row_for_each_block_and_pictures_are_written(self, done):
        out, _ = done
        table = pd.read_csv(out / "benchmark.csv")
        assert table["answer"].tolist() == ["rolling_shutter", "nothing"]
        assert table["ratio"].iloc[0] > 8
        for name in ("confusion.png", "rates.png"):
            assert (out / name).read_bytes()[:4] == b"\x89PNG"

    def test_blocks_that_are_done_are_not_diagnosed_again(self, done, folder):
        out, _ = done
        before = {p.name: p.stat().st_mtime_ns for p in (out / "blocks").iterdir()}
        (out / "blocks" / "first.json").unlink()
        rows = benchmark.run(benchmark.of_folder(folder), out, rivals=False, level=0.01)
        after = {p.name: p.stat().st_mtime_ns for p in (out / "blocks").iterdir()}
        assert before["more-second.json"] == after["more-second.json"]
        assert before["first.json"] < after["first.json"]
        assert [row["name"] for row in rows] == ["first", "more-second"]

    def test_a_truth_that_cannot_be_read_is_a_result_and_costs_no_other_block(
        self, done, folder, tmp_path
    ):
        out, _ = done
        trials = benchmark.of_folder(folder)
        broken = folder / "broken.truth.json"
        broken.write_text("{", encoding="utf-8")
        (folder / "broken").mkdir()
        (folder / "broken" / "block.toml").write_text("name = 'x'", encoding="utf-8")
        try:
            rows = benchmark.run(benchmark.of_folder(folder), out, rivals=False, level=0.01)
        finally:
            broken.unlink()
            (folder / "broken" / "block.toml").unlink()
            (folder / "broken").rmdir()
        assert len(rows) == len(trials) + 1
        failed = {row["name"]: row["failed"] for row in rows if row["failed"]}
        assert list(failed) == ["broken"]
        assert "broken" in benchmark.as_text(benchmark.summary(rows))


class TestRefused:
    def test_a_folder_without_blocks(self, tmp_path, capsys):
        code = main(["--blocks", str(tmp_path), "-o", str(tmp_path / "o")])
        assert code == 2 and "holds no block" in capsys.readouterr().err

    def test_an_output_folder_that_holds_something_else(self, folder, tmp_path):
        (tmp_path / "thesis.txt").write_text("years of work", encoding="utf-8")
        with pytest.raises(InputError, match="no earlier benchmark"):
            benchmark.run(benchmark.of_folder(folder), tmp_path)

    @pytest.mark.parametrize(
        "options", [["--cases", "nul"], ["--cases", "null", "--count", "0"], ["--level", "2"], []]
    )
    def test_options_that_cannot_be(self, options, tmp_path, capsys):
        with pytest.raises(SystemExit) as stop:
            main([*options, "-o", str(tmp_path / "o")])
        assert stop.value.code == 2


class TestFailing:
    """What a block does to the diagnosis is a result; what we do to it is not."""

    @staticmethod
    def run(monkeypatch, error, folder):
        def assess(name, *_):
            if name == "second":
                raise error
            return {"name": name, "failed": None}

        monkeypatch.setattr(importlib.import_module("benchmarks.diagnosis.run"), "assess", assess)
        trials = [
            benchmark.Trial(name, name, lambda: (None, None, None)) for name in ("first", "second")
        ]
        return benchmark.run(trials, folder)

    def test_a_fault_of_ours_ends_the_run_and_finished_rows_are_kept(self, monkeypatch, tmp_path):
        with pytest.raises(TypeError, match="ours"):
            self.run(monkeypatch, TypeError("ours"), tmp_path)
        assert [p.name for p in (tmp_path / "blocks").iterdir()] == ["first.json"]

    @pytest.mark.parametrize("fault", [InputError("no"), AdjustmentFailed("no")])
    def test_what_diagnosing_may_raise_is_a_row(self, monkeypatch, fault):
        def diagnose(*_, **__):
            raise fault

        monkeypatch.setattr("benchmarks.diagnosis.assess.diagnose", diagnose)
        block = hidden("rolling_shutter").block
        row = assess("it", block, None, truth_of({"effects": []}), {})
        assert row["failed"] == "no" and row["kind"] == "null"


class TestPlan:
    @pytest.mark.parametrize("kind", made.KINDS)
    def test_names_are_unique_and_seeds_too(self, kind):
        cases = made.plan(kind, None, 0, True)
        assert len({name for name, *_ in cases}) == len(cases) > 5
        assert len({seed for *_, seed in cases}) == len(cases)

    def test_single_effects_are_of_every_slug_geometry_and_ratio(self):
        cases = made.plan("single", None, 0, True)
        assert len(cases) == 23 * 5 * 3
        assert len({name.split("-", 2)[2] for name, *_ in cases}) == len(cases)

    def test_a_trial_is_made_when_it_is_its_turn(self):
        first, second = benchmark.of_generator(["single"], 2, seed=7, short=True)
        block, twin, truth = second.load()
        assert first.name != second.name and len(block.images) == len(twin.images) == 40
        assert truth.kind == "single" and truth.label in second.name

    def test_more_blocks_than_cases_begin_again_with_other_seeds(self):
        every = made.plan("together", None, 0, True)
        more = made.plan("together", len(every) + 1, 0, True)
        assert more[-1][1] == every[0][1] and more[-1][2] != every[0][2]


@pytest.mark.slow
def test_a_cluster_gives_the_same_answer(done, folder, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    (trial,) = benchmark.of_folder(folder / "more")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        (row,) = benchmark.run(
            [trial], tmp_path / "o", cluster=cluster.scheduler_address, rivals=False
        )
    kept = json.loads((done[0] / "blocks" / "more-second.json").read_text(encoding="utf-8"))
    assert row["said"]["threshold"] == kept["said"]["threshold"]
    assert row["check_before"] == pytest.approx(kept["check_before"], rel=1e-9)


@pytest.mark.slow
def test_two_processes_give_the_same_rows(done, folder, tmp_path):
    out, _ = done
    rows = benchmark.run(benchmark.of_folder(folder), tmp_path / "o", jobs=2, rivals=False)
    kept = json.loads((out / "benchmark.json").read_text(encoding="utf-8"))["rows"]
    for one, other in zip(rows, kept, strict=True):
        assert one["verdict"] == other["verdict"]
        assert one["parameters"] == other["parameters"]
