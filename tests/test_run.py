"""run.py: what it decides before it installs or starts anything."""

import ast
import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def run(monkeypatch, tmp_path):
    """run.py as a module whose .venv is in a temporary folder."""
    specification = importlib.util.spec_from_file_location("run_py", ROOT / "run.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    monkeypatch.setattr(module, "VENV", tmp_path / ".venv")
    monkeypatch.setattr(module, "STAMP", tmp_path / ".venv" / "corridor-installed.json")
    monkeypatch.setattr(module, "UNFINISHED", tmp_path / ".venv" / "corridor-unfinished")
    return module


def test_it_needs_nothing_but_the_standard_library():
    tree = ast.parse((ROOT / "run.py").read_text(encoding="utf-8"))
    names = {
        (node.module if isinstance(node, ast.ImportFrom) else alias.name).split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert names <= sys.stdlib_module_names


def test_an_old_python_can_read_it_and_is_told_what_to_do(run, capsys, monkeypatch):
    """Python 3.8 must get as far as the message."""
    ast.parse((ROOT / "run.py").read_text(encoding="utf-8"), feature_version=(3, 8))
    monkeypatch.setattr(run.sys, "version_info", (3, 10, 4))
    assert run.main([]) == 1
    message = capsys.readouterr().err
    assert "needs Python 3.11 or newer and this is 3.10" in message


def test_a_python_without_venv_is_told_the_package(run, capsys, monkeypatch):
    """Debian and Ubuntu ship ensurepip apart, in python3-venv."""
    monkeypatch.setattr(run.importlib.util, "find_spec", lambda name: None)
    assert run.main([]) == 1
    assert "sudo apt install python3-venv" in capsys.readouterr().err


class TestEnvironmentIsUsedAgain:
    @pytest.fixture
    def project(self, tmp_path):
        for name in ("pyproject.toml", "constraints.txt"):
            (tmp_path / name).write_text("a\nb\n", encoding="utf-8")
        return tmp_path

    def _stamp(self, run, project, extras):
        path = project / "stamp.json"
        text = run.json.dumps({"fingerprint": run.fingerprint(project), "extras": extras})
        path.write_text(text, encoding="utf-8")
        return path

    def test_while_nothing_changed(self, run, project):
        stamp = self._stamp(run, project, ["dev"])
        assert run.installed_extras(stamp, project) == {"dev"}

    @pytest.mark.parametrize("name", ["pyproject.toml", "constraints.txt"])
    def test_but_not_after_a_change(self, run, project, name):
        stamp = self._stamp(run, project, [])
        (project / name).write_text("a\nc\n", encoding="utf-8")
        assert run.installed_extras(stamp, project) is None

    def test_line_endings_are_no_change(self, run, project):
        stamp = self._stamp(run, project, [])
        (project / "constraints.txt").write_bytes(b"a\r\nb\r\n")
        assert run.installed_extras(stamp, project) == set()

    @pytest.mark.parametrize("text", ["", "{", '{"fingerprint": "x"}'])
    def test_a_half_written_record_counts_as_none(self, run, project, text):
        stamp = project / "stamp.json"
        stamp.write_text(text, encoding="utf-8")
        assert run.installed_extras(stamp, project) is None


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], ["data_synthetic/dike", "-o", "out/dike"]),
        (["--camera", "fixed"], ["data_synthetic/dike", "--camera", "fixed", "-o", "out/dike"]),
        (["mine"], ["mine", "-o", "out/mine"]),
        (["mine", "-o", "there"], ["mine", "-o", "there"]),
        (["mine", "--output=there"], ["mine", "--output=there"]),
    ],
)
def test_the_main_job_is_corridor_adjust(run, monkeypatch, arguments, expected):
    started = []
    monkeypatch.setattr(run, "set_up", lambda extras=(): Path("python"))
    monkeypatch.setattr(
        run.subprocess,
        "run",
        lambda command, **_: started.append(command) or subprocess.CompletedProcess(command, 0),
    )
    assert run.main(arguments) == 0
    words = [word.replace(str(ROOT), "").lstrip("\\/").replace("\\", "/") for word in started[0]]
    assert words == ["python", "-m", "corridor", "adjust", *expected]


def test_the_lesson_is_served_by_the_kit(run, monkeypatch):
    """As README says; the kit lies in notebooks/, which no package installs."""
    started = []
    monkeypatch.setattr(run, "set_up", lambda extras=(): Path("python"))

    def start(command, env):
        started.append((command, env["PYTHONPATH"].split(run.os.pathsep)))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(run.subprocess, "run", start)
    assert run.main(["lesson", "--class"]) == 0
    assert started == [
        (["python", "-m", "kit.classroom", "--class"], [str(ROOT / "notebooks"), str(ROOT)])
    ]


def test_the_exit_status_is_that_of_the_adjustment(run, monkeypatch):
    monkeypatch.setattr(run, "set_up", lambda extras=(): Path("python"))
    monkeypatch.setattr(
        run.subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 2)
    )
    assert run.main(["no_such_block"]) == 2


class TestAnotherPython:
    """A patch update of the system is one; what was installed is used again, or asked for."""

    @pytest.fixture
    def installed(self, run, monkeypatch):
        """A .venv with dev, and the list of what run.py installs into it."""
        done = []
        venv = run.VENV
        run.python_of(venv).parent.mkdir(parents=True)
        (venv / "mine.txt").touch()
        run.record(["dev"], run.STAMP, run.fingerprint())
        monkeypatch.setattr(run, "install", lambda python, words: done.append(words))
        return done

    @staticmethod
    def answers(run, monkeypatch, version):
        """The interpreter of .venv says that it has this version; None: it does not start."""

        def start(command, **_):
            if version is None:
                raise OSError
            return subprocess.CompletedProcess(command, 0, stdout=version)

        monkeypatch.setattr(run.subprocess, "run", start)

    def test_it_is_used_again(self, run, installed, monkeypatch):
        self.answers(run, monkeypatch, "3 11\n")
        monkeypatch.setattr(run.platform, "python_version", lambda: "3.13.2")
        assert run.set_up() == run.python_of(run.VENV)
        assert installed == []

    def test_one_that_does_not_start_is_kept_and_told(self, run, installed, monkeypatch):
        self.answers(run, monkeypatch, None)
        with pytest.raises(run.CannotRun, match="extras dev. Delete that folder"):
            run.set_up()
        assert (run.VENV / "mine.txt").exists() and installed == []

    def test_extras_are_not_forgotten_when_versions_change(self, run, installed, monkeypatch):
        self.answers(run, monkeypatch, "3 12\n")
        run.record(["dev"], run.STAMP, "of other versions")
        run.set_up()
        assert installed[0][-1].endswith("[dev]")
        assert run.installed_extras(run.STAMP) == {"dev"}

    def test_one_whose_making_was_interrupted_is_made(self, run, installed, monkeypatch):
        self.answers(run, monkeypatch, "")
        run.UNFINISHED.touch()
        run.set_up(["dev"])
        assert not run.UNFINISHED.exists() and len(installed) == 1


@pytest.mark.parametrize("options", [(), ("--all",), ("--night",)])
def test_every_form_of_the_tests_runs_more_than_the_one_before(run, monkeypatch, options):
    started = []
    done = SimpleNamespace(returncode=0)
    monkeypatch.setattr(run, "set_up", lambda extras: Path("venv/bin/python"))
    monkeypatch.setattr(run.subprocess, "run", lambda command, **_: started.append(command) or done)
    monkeypatch.chdir(run.ROOT)
    assert run.main(["test", *options]) == 0
    words = started[-1]
    assert ("not slow" in words, "not night" in words) == (not options, options == ("--all",))
    assert ("notebooks" in words) == bool(options)


@pytest.mark.parametrize("name", ["seconds", "night"])
def test_lists_of_long_tests_name_tests_that_are_there(run, name):
    """A renamed test would run with the short ones, and nobody would know."""
    named = (run.ROOT / "tests" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    gone = []
    for line in named:
        file, *_, test = line.split("[")[0].split("::")
        path = run.ROOT / file
        if not path.is_file() or f"def {test}(" not in path.read_text(encoding="utf-8"):
            gone.append(line)
    assert named and not gone
