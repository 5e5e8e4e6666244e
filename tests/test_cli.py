"""The command: what it prints, writes and returns."""

import argparse
import dataclasses
import errno
import json
import os
import re
import signal
import subprocess
import sys
import time

import joblib
import pytest

import corridor
import corridor.interface.cli
from corridor.core import registry
from corridor.core.errors import AdjustmentFailed
from corridor.core.parallel import parallel
from corridor.interface.cli import main

VERBS = sorted(registry.verbs())


def helps():
    """What `--help` prints of every verb and of every kind of one."""
    out = {}

    def visit(name, parser):
        out.setdefault(name, parser.format_help())
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for below, one in action.choices.items():
                    visit(f"{name} {below}", one)

    out["corridor"] = corridor.cli._parser().format_help()
    for verb in VERBS:
        visit("corridor", corridor.cli._parser(verb))
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small block with noise of known size, as a folder."""
    from strips import corridor_block

    from corridor.core.simulation import add_noise

    block = corridor_block(images=9, strips=3, observations_per_image=60, seed=4)
    noise = dict(tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01)
    path = tmp_path_factory.mktemp("blocks") / "small"
    add_noise(block, **noise, seed=4).write(path)
    return path


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    """The command as a user types it, in a process of its own."""
    out = tmp_path_factory.mktemp("results") / "small"
    command = [sys.executable, "-m", "corridor", "adjust", str(folder), "-o", str(out)]
    return out, subprocess.run(command, capture_output=True, text=True, encoding="utf-8")


class TestAdjust:
    def test_it_ends_with_status_0_and_names_what_it_wrote(self, done):
        out, process = done
        assert process.returncode == 0, process.stderr
        told = process.stdout.partition(f"Wrote {out}\n")[2]
        for path in out.iterdir():
            assert path.name in told or path.suffix == ".png"
        assert f"{len(list(out.glob('*.png')))} pictures" in told
        # What is to be read stands last.
        assert process.stdout.splitlines()[-1] == f"Read {out / 'report.html'}"

    def test_a_line_on_stderr_for_every_iteration_when_asked(self, done, folder, capsys):
        result = json.loads((done[0] / "adjustment.json").read_text(encoding="utf-8"))
        assert "iteration" not in done[1].stderr
        assert main(["adjust", str(folder), "-v", "--required", "0.02"]) == 0
        said = capsys.readouterr()
        lines = [line.split() for line in said.err.splitlines()]
        numbered = [line for line in lines if line and line[0].isdecimal()]
        assert len(numbered) >= result["iterations"] >= 1
        assert "cost: half the sum of squared residuals" in said.err
        assert said.out.startswith(("Good enough: ", "Not good enough: ", "Whether it is good"))

    def test_the_result_holds_what_the_design_promises(self, done):
        result = json.loads((done[0] / "adjustment.json").read_text(encoding="utf-8"))
        promised = (
            "converged iterations seconds sigma0 redundancy observations camera effects "
            "lever_arm check_points correlations warnings"
        )
        assert set(promised.split()) <= set(result)
        # The noise is as large as the sigmas say: sigma0 is 1 within a few sigma / sqrt(2 r).
        assert result["sigma0"] == pytest.approx(1.0, abs=5 / (2 * result["redundancy"]) ** 0.5)

    def test_the_adjusted_block_is_a_block(self, done, folder):
        adjusted = corridor.read(done[0] / "block")
        assert list(adjusted.images["image"]) == list(corridor.read(folder).images["image"])

    def test_the_pictures_are_there(self, done):
        assert {"check_points.png", "residual_vectors.png"} <= {p.name for p in done[0].iterdir()}

    def test_without_an_output_folder_it_says_that_nothing_is_kept(self, folder, capsys):
        assert main(["adjust", str(folder)]) == 0
        assert "Nothing was written" in capsys.readouterr().out

    def test_options_reach_the_call(self, folder, monkeypatch):
        called = _stand_in(monkeypatch)
        words = (
            "--camera f,cx,cy --effect gnss_bias,rolling_shutter --effect thermal --control P1,P2 "
            "--check none --loss huber:2 --prior camera.P1.f=8190+-5 --prior gnss_bias.z=0±0.05 "
            "--lever-arm fixed --threads 2 --iterations 70 --reject-gnss --strict"
        )
        main(["adjust", str(folder), *words.split()])
        called.pop("progress")
        told = vars(called.pop("model"))
        assert [effect.slug for effect in told.pop("effects")] == [
            "gnss_bias",
            "rolling_shutter",
            "thermal",
        ]
        assert {**called, **told} == {
            "camera": "f,cx,cy",
            "control": ["P1", "P2"],
            "check": [],
            "loss": "huber:2",
            "priors": {"camera.P1.f": (8190.0, 5.0), "gnss_bias.z": (0.0, 0.05)},
            "motion": None,
            "lever_arm": "fixed",
            "parameters": {},
            "threads": 2,
            "max_iterations": 70,
            "reject_gnss": True,
            "strict": True,
        }

    def test_what_is_not_asked_for_is_left_to_the_block(self, folder, monkeypatch):
        called = _stand_in(monkeypatch)
        main(["adjust", str(folder)])
        assert called["model"] == corridor.Model()

    @pytest.mark.parametrize(
        "words",
        [
            "--prior camera.P1.f=8190",
            "--prior camera.P1.f=8190+-0",
            "--prior camera.P1.f=8190+-nan",
            "--prior =1+-1",
            "--control ,",
            "--threads 0",
            "--lever-arm loose",
        ],
    )
    def test_an_option_that_makes_no_sense_is_status_2(self, folder, capsys, words):
        with pytest.raises(SystemExit) as stop:
            main(["adjust", str(folder), *words.split()])
        assert stop.value.code == 2
        assert words.split()[0] in capsys.readouterr().err.splitlines()[-1]


class TestEndings:
    """Wrong input 2, failed work 1, interrupted 130: one sentence, nothing half-written."""

    def _ended(self, capsys, status, *words):
        assert main(list(words)) == status
        error = capsys.readouterr().err
        assert "Traceback" not in error
        return error.splitlines()[-1]

    @pytest.mark.parametrize("verb", ["adjust", "summary"])
    def test_a_folder_that_is_not_there(self, tmp_path, capsys, verb):
        nowhere, out = tmp_path / "nowhere", tmp_path / "out"
        last = self._ended(capsys, 2, verb, str(nowhere), "-o", str(out))
        assert "nowhere" in last
        assert not out.exists()

    def test_the_result_of_an_adjustment_names_its_block(self, done, capsys):
        last = self._ended(capsys, 2, "summary", str(done[0]))
        assert f"{done[0] / 'block'}: give that" in last

    def test_an_effect_that_is_not_there(self, folder, tmp_path, capsys):
        out = tmp_path / "out"
        words = ("adjust", str(folder), "--effect", "gremlins", "-o", str(out))
        assert "gremlins" in self._ended(capsys, 2, *words)
        assert not out.exists()

    def test_describing_an_effect_that_is_not_there(self, capsys):
        assert "gremlins" in self._ended(capsys, 2, "effects", "gremlins")

    def test_work_that_fails_says_why(self, folder, capsys, monkeypatch):
        def fails(*_, **__):
            raise AdjustmentFailed("the block falls apart between A and B.")

        monkeypatch.setattr(corridor, "adjust", fails)
        last = self._ended(capsys, 1, "adjust", str(folder))
        assert last == "failed: the block falls apart between A and B."

    @pytest.mark.parametrize("verb", ["adjust", "diagnose"])
    def test_an_adjustment_that_does_not_converge_is_no_result(
        self, folder, tmp_path, capsys, verb
    ):
        block = corridor.read(folder)
        block.gnss.loc[0, "x"] += 3.0
        block.write(tmp_path / "astray")
        out = tmp_path / "out"
        words = (verb, str(tmp_path / "astray"), "-o", str(out), "--iterations", "1")
        assert main(list(words)) == 1
        said = capsys.readouterr()
        last = said.err.splitlines()[-1]
        assert "did not converge in 1 iterations" in last and "--iterations" in last
        assert not out.exists()
        if verb == "adjust":
            # What lies farthest off is named.
            assert f"most at {block.gnss['image'].iloc[0]}" in said.out
            assert "sigma naught" not in said.out.lower()

    def test_in_python_it_is_returned_with_its_warning(self, folder):
        found = corridor.adjust(corridor.read(folder), max_iterations=1)
        assert not found.converged and "did not converge" in found.warnings[0]

    def test_ctrl_c_during_the_iterations(self, folder, tmp_path, capsys, monkeypatch):
        def pressed(self, step):
            raise KeyboardInterrupt

        monkeypatch.setattr("corridor.interface.cli.verbs.adjust._Iterations.__call__", pressed)
        out = tmp_path / "out"
        last = self._ended(capsys, 130, "adjust", str(folder), "-o", str(out))
        assert last == "interrupted: nothing was written."
        assert list(tmp_path.iterdir()) == []

    def test_ctrl_c_that_a_library_makes_an_error_of_while_it_loads(self, capsys, monkeypatch):
        def load(_):
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise ImportError("the C-extensions failed") from None

        monkeypatch.setattr("corridor.interface.cli.verbs.effects.run", load)
        assert self._ended(capsys, 130, "effects") == "interrupted: nothing was written."

    @pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
    def test_ctrl_c_in_a_callback_that_cannot_raise(self, capsys, monkeypatch):
        class Lock:
            def __del__(self):
                signal.raise_signal(signal.SIGINT)

        def load(_):
            Lock()
            for _ in range(500):
                time.sleep(0.01)

        monkeypatch.setattr("corridor.interface.cli.verbs.effects.run", load)
        assert main(["effects"]) == 130
        assert capsys.readouterr().err == "interrupted: nothing was written.\n"

    def test_ctrl_c_before_there_is_a_command(self, monkeypatch, capsys):
        from corridor import __main__ as command

        class HalfMade:
            def __del__(self):
                raise AttributeError("what was not made yet")

        def pressed(*_):
            bar = HalfMade()
            raise KeyboardInterrupt(bar)

        before = signal.getsignal(signal.SIGINT)
        monkeypatch.setattr("corridor.interface.cli.main", pressed)
        monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
        try:
            assert command.main() == 130
        finally:
            signal.signal(signal.SIGINT, before)
        assert capsys.readouterr().err == "interrupted: nothing was written.\n"

    def test_ctrl_c_reaches_no_worker(self):
        with parallel(2) as work:
            told = list(work(joblib.delayed(signal.getsignal)(signal.SIGINT) for _ in range(4)))
        assert told == [signal.SIG_IGN] * 4

    def test_no_process_does_no_work(self):
        with pytest.raises(corridor.InputError, match="use 1 or more"), parallel(0):
            pass

    def test_a_value_may_begin_with_a_minus(self, capsys):
        words = ["plan", "no_such_plan", "--bias", "-0.05,0,0.07", "--gnss-sigma", "-.1,1,1"]
        last = self._ended(capsys, 2, *words, "--seed", "3")
        assert "no plan 'no_such_plan'" in last or "sigma" in last

    @pytest.mark.parametrize("ending", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left")])
    def test_ctrl_c_or_a_full_disk_during_writing(
        self, folder, tmp_path, capsys, monkeypatch, ending
    ):
        def stop(self, *_, **__):
            raise ending

        monkeypatch.setattr(corridor.Block, "write", stop)
        out = tmp_path / "out"
        status = 130 if ending is KeyboardInterrupt else 1
        assert "nothing was written" in self._ended(
            capsys, status, "adjust", str(folder), "-o", str(out)
        )
        assert list(tmp_path.iterdir()) == []


class TestSummary:
    def test_it_says_what_each_effect_lacks(self, folder, tmp_path, capsys):
        block = corridor.read(folder)
        block.gnss = block.gnss.iloc[:0]
        block.write(tmp_path / "no_gnss")
        assert main(["summary", str(tmp_path / "no_gnss")]) == 0
        lines = capsys.readouterr().out.splitlines()
        row = next(line for line in lines if "gnss_bias" in line)
        assert "gnss" in row.replace("gnss_bias", "")
        assert not [line for line in lines if "focal_drift" in line]

    def test_it_saves_the_first_look_when_asked(self, folder, tmp_path, capsys):
        out = tmp_path / "look"
        assert main(["summary", str(folder), "-o", str(out)]) == 0
        assert [path.name for path in out.iterdir()] == ["first_look.png"]
        assert str(out / "first_look.png") in capsys.readouterr().out
        assert (out / "first_look.png").read_bytes().startswith(b"\x89PNG")


class TestEffects:
    def test_the_catalogue_names_every_effect_with_place_parameters_units_and_needs(self, capsys):
        assert main(["effects"]) == 0
        blocks = capsys.readouterr().out.split("\n\n")
        told = {block.splitlines()[0]: block for block in blocks}
        for effect in corridor.catalogue():
            text = told[effect.slug]
            for word in (effect.title, effect.place, *effect.needs):
                assert word in text
        assert "readout (s)" in told["rolling_shutter"]

    def test_one_effect_in_full_gives_its_source_and_the_data_it_takes(self, capsys):
        """Every effect's file names the work it comes from."""
        for effect in corridor.catalogue():
            assert main(["effects", effect.slug]) == 0
            out = capsys.readouterr().out
            assert max(map(len, out.splitlines())) <= 100, effect.slug
            told = " ".join(out.split())
            for words in ("Source:", effect.revealed_by, effect.unobservable_when):
                assert words in told, effect.slug

    def test_many_parameters_of_one_kind_are_told_in_one_word(self, capsys):
        assert main(["effects", "image_deformation"]) == 0
        told = capsys.readouterr().out
        assert "x_1 to x_60 (px), y_1 to y_60 (px) for each camera" in told
        assert "0.5 px (x_1 to x_60)" in told


def test_a_result_is_written_though_nobody_reads_on(tmp_path):
    """`corridor data fetch dike | head -0`: the pipe is closed before the first line."""
    end, start = os.pipe()
    os.close(end)
    words = [sys.executable, "-m", "corridor", "data", "fetch", "dike", "-o", str(tmp_path / "d")]
    try:
        done = subprocess.run(words, stdout=start, stderr=subprocess.PIPE, text=True)
    finally:
        os.close(start)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "d" / "block.toml").is_file()


class TestHelp:
    def test_it_starts_a_newcomer(self, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["--help"])
        text = capsys.readouterr().out
        assert stop.value.code == 0
        for verb in ("adjust", "summary", "effects"):
            assert f"corridor {verb}" in text

    @pytest.mark.parametrize("words", [[], ["adjust"], ["readout", "led"]], ids=" ".join)
    def test_help_as_a_word_is_help_as_an_option(self, capsys, words):
        told = []
        for typed in (["help", *words], [*words, "--help"]):
            with pytest.raises(SystemExit) as stop:
                main(typed)
            assert stop.value.code == 0
            told.append(capsys.readouterr().out)
        assert told[0] == told[1]

    @pytest.mark.parametrize("verb", VERBS)
    def test_every_verb_has_examples(self, capsys, verb):
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        told = capsys.readouterr().out
        assert f"  corridor {verb}" in told.partition("examples:")[2]

    @pytest.mark.parametrize(
        ("verb", "kind"),
        [("readout", kind) for kind in ("star", "wheel", "led", "examples")]
        + [("thermal", step) for step in ("map", "fit", "apply", "prior")],
    )
    def test_every_kind_of_a_verb_has_examples(self, capsys, verb, kind):
        with pytest.raises(SystemExit):
            main([verb, kind, "--help"])
        assert f"  corridor {verb} {kind} " in capsys.readouterr().out.partition("examples:")[2]

    def test_simulate_lists_every_key_of_a_plan(self, capsys):
        with pytest.raises(SystemExit):
            main(["simulate", "--help"])
        told = capsys.readouterr().out.partition("Keys of a plan")[2]
        plan = dataclasses.asdict(corridor.simulation.read_plan("thesis_50vt"))
        parts = ("terrain", "tie_points", "ground", "noise", "start")
        tables = {f"[{name}]": plan.pop(name) for name in parts}
        tables["[[flight]]"] = plan.pop("flights")[0]
        head = plan.keys() - {"cameras", "effects", "effect"}
        for table, keys in {"": head, **tables}.items():
            assert table in told
            assert all(re.search(rf"\b{key}\b", told) for key in keys)

    def test_a_plan_is_printed_by_its_name_and_can_be_flown(self, tmp_path, capsys):
        assert main(["simulate", "thesis_50vt", "--show"]) == 0
        path = tmp_path / "mine.toml"
        path.write_text(capsys.readouterr().out, encoding="utf-8")
        assert corridor.simulation.read_plan(path).flights[0].name == "50vt"
        assert main(["simulate", "thesis_50vv", "--show"]) == 2
        assert "did you mean thesis_50vt" in capsys.readouterr().err

    def test_it_tells_its_version(self, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["--version"])
        assert stop.value.code == 0
        assert capsys.readouterr().out.strip() == f"corridor {corridor.__version__}"

    @pytest.mark.parametrize("columns", [72, 80, 100])
    def test_no_line_is_wider_than_the_terminal(self, monkeypatch, columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        told = helps()
        assert len(told) > len(VERBS) + 10
        for verb, text in told.items():
            wide = [line for line in text.splitlines() if len(line) > columns]
            # A path or a list without blanks cannot be folded.
            assert all(len(line.split()) <= 2 for line in wide), (verb, wide)

    def test_a_folded_command_can_be_pasted(self, monkeypatch):
        def commands(columns):
            monkeypatch.setenv("COLUMNS", str(columns))
            text = re.sub(r" \\\n +", " ", "\n".join(helps().values()))
            return re.findall(r"^ +corridor .*", text, re.MULTILINE)

        assert commands(70) == commands(1000)

    def test_it_does_not_wait_for_the_numerical_libraries(self):
        """`corridor --help` loads neither numpy nor numba, nor does a list of what there is."""
        program = (
            "import sys, corridor.cli\n"
            "try: corridor.cli.main(['data', 'list']), corridor.cli.main(['adjust', '--help'])\n"
            "except SystemExit: pass\n"
            "sys.exit(', '.join({'numpy', 'numba', 'pandas', 'matplotlib'} & set(sys.modules)))\n"
        )
        process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert process.stderr.strip() == ""


class Report(str):
    """What is printed of an adjustment that nobody made."""

    converged = True


def _stand_in(monkeypatch):
    """Put a recorder in the place of corridor.adjust; the dictionary of what it was given."""
    called = {}

    def record(block, **options):
        called.update(options)
        return Report("a report")

    monkeypatch.setattr(corridor, "adjust", record)
    return called
