"""Sets corridor up and runs it, from nothing but Python 3.11 or newer.

python run.py                    adjust the shipped block; results under out/dike
python run.py BLOCK              the same with your own block folder
python run.py BLOCK -o OUT ...   anything after BLOCK goes to `corridor adjust`
python run.py lesson             the bicycle wheel as a page for a browser; with --class for
                                 every phone in the room
python run.py test               style, import contract, tests and the first notebook
python run.py test --all         the long tests and every notebook as well
python run.py test --night       these and what takes longest: whole flights, rates of many draws
python run.py site               build the documentation into out/site

The first run makes the folder .venv beside this file and installs into it the versions
named in constraints.txt; later runs use it again, whatever Python starts them, and install
anew when those or pyproject.toml change. To start afresh, delete .venv: nothing else does.
"""

import hashlib
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
STAMP = VENV / "corridor-installed.json"
# There only until the environment is whole: what holds it was interrupted, and is made again.
UNFINISHED = VENV / "corridor-unfinished"
SHIPPED_BLOCK = ROOT / "data_synthetic" / "dike"
OLDEST = (3, 11)
NBVAL = ("--nbval", "--nbval-current-env", "--nbval-cell-timeout", "1800")
# A file is one worker's: what its tests share is made once. tests/conftest.py orders the files.
WORKERS = ("-n", "2", "--dist", "loadfile", "--no-loadscope-reorder")


class CannotRun(Exception):
    """What stands in the way, in words for the person at the keyboard."""


def say(text):
    print(text, flush=True)


def check_python(version=None):
    """Raises CannotRun if this Python is too old or cannot make environments."""
    version = tuple(sys.version_info[:2]) if version is None else version
    if version < OLDEST:
        raise CannotRun(
            "corridor needs Python {}.{} or newer and this is {}.{} ({}). Install a newer one and "
            "start this file with it, for example: python3.12 run.py".format(
                *OLDEST, *version, sys.executable
            )
        )
    if any(importlib.util.find_spec(name) is None for name in ("venv", "ensurepip")):
        raise CannotRun(
            "This Python cannot make virtual environments: its modules venv and ensurepip are "
            "missing. On Debian or Ubuntu: sudo apt install python3-venv. Then run this again."
        )


def python_of(venv):
    """Path of the interpreter inside a virtual environment, on any system."""
    if os.name == "nt":
        return venv / "Scripts" / "python.exe"
    return venv / "bin" / "python"


def environment():
    """Variables for the programs we start: nothing from outside may reach into .venv.

    Python writes down what it compiled: tests start it some hundred times.
    """
    ours = ("PYTHONPATH", "PYTHONHOME", "PYTHONDONTWRITEBYTECODE")
    kept = {k: v for k, v in os.environ.items() if k not in ours}
    return {**kept, "PYTHONUTF8": "1", "PIP_USER": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def fingerprint(root=ROOT):
    """Changes when the environment has to be installed again."""
    digest = hashlib.sha256()
    for name in ("pyproject.toml", "constraints.txt"):
        digest.update((root / name).read_bytes().replace(b"\r\n", b"\n"))
    digest.update(f"{root} {platform.machine()}".encode())
    return digest.hexdigest()


def recorded(stamp=STAMP):
    """What was written when corridor was installed; empty where nothing can be read."""
    try:
        found = json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def installed_extras(stamp=STAMP, root=ROOT):
    """Extras that .venv holds in today's versions; None if it has to be installed."""
    found = recorded(stamp)
    if found.get("fingerprint") != fingerprint(root):
        return None
    return set(found.get("extras", ()))


def record(extras, stamp=STAMP, mark=""):
    """Write which extras .venv has; mark: the fingerprint once they are installed."""
    content = {"fingerprint": mark, "extras": sorted(extras)}
    stamp.write_text(json.dumps(content) + "\n", encoding="utf-8")


def works(python):
    """Whether .venv has an interpreter that is new enough, with pip."""
    try:
        answer = subprocess.run(
            [str(python), "-c", "import pip, sys; print(*sys.version_info[:2])"],
            capture_output=True,
            text=True,
            env=environment(),
        )
    except OSError:
        return False
    version = answer.stdout.split()
    return len(version) == 2 and tuple(map(int, version)) >= OLDEST


def make_environment():
    """Make .venv where there is none, or finish it; raises CannotRun for one that does not work.

    What is installed in a folder is never deleted without a word.
    """
    if VENV.exists() and any(VENV.iterdir()) and not UNFINISHED.exists():
        extras = recorded(STAMP).get("extras")
        held = f" It held corridor with the extras {', '.join(extras)}." if extras else ""
        raise CannotRun(
            f"The environment {VENV} does not work any more: the Python it was made with was "
            f"removed or replaced, or is too old.{held} Delete that folder and run this again: "
            f"it is made anew with Python {platform.python_version()}."
        )
    say(f"Making the environment {VENV}")
    VENV.mkdir(exist_ok=True)
    UNFINISHED.touch()
    made = subprocess.run(
        [sys.executable, "-m", "venv", str(VENV)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment(),
    )
    if made.returncode:
        raise CannotRun(f"The environment could not be made:\n{made.stdout.strip()}")
    UNFINISHED.unlink()


def set_up(extras=()):
    """Make .venv if needed, install corridor with extras into it; path of its Python."""
    python = python_of(VENV)
    have = installed_extras(STAMP)
    if have is not None and have >= set(extras) and works(python):
        return python
    started = time.monotonic()
    if UNFINISHED.exists() or not works(python):
        make_environment()
    wanted = sorted(set(extras) | set(recorded(STAMP).get("extras", ())))
    record(wanted, STAMP)
    target = f"{ROOT}[{','.join(wanted)}]" if wanted else str(ROOT)
    say("Installing corridor and what it needs (the first time this downloads some 200 MB)")
    install(python, ["--constraint", str(ROOT / "constraints.txt"), "--editable", target])
    record(wanted, STAMP, fingerprint())
    say(f"Installed in {time.monotonic() - started:.0f} s\n")
    return python


def install(python, arguments):
    """pip install, with one short line a package; raises CannotRun with pip's own words."""
    log = []
    with subprocess.Popen(
        [str(python), "-m", "pip", "install", "--no-input", "--progress-bar", "off", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        errors="replace",
        env=environment(),
    ) as process:
        for line in process.stdout:
            log.append(line.rstrip())
            words = line.split()
            if words[:1] in (["Collecting"], ["Processing"]):
                say(f"  {Path(words[1]).name.partition('-')[0]}")
            elif words[:2] == ["Installing", "collected"]:
                say("  unpacking")
    if process.returncode:
        tail = "\n".join(log[-15:])
        raise CannotRun(
            f"pip could not install what corridor needs. Its last lines:\n{tail}\n"
            "If the network was the reason, run the same command again."
        )


def adjust(arguments):
    """The main job: one block adjusted, with report and pictures."""
    given = bool(arguments) and not arguments[0].startswith("-")
    block = Path(arguments[0]) if given else SHIPPED_BLOCK
    options = arguments[1:] if given else list(arguments)
    asks_help = "-h" in options or "--help" in options
    if not asks_help and not any(o.startswith(("-o", "--output")) for o in options):
        # resolve(): a block given as "." still has a name.
        options += ["-o", str(ROOT / "out" / block.resolve().name)]
    python = set_up()
    command = [str(python), "-m", "corridor", "adjust", str(block), *options]
    status = subprocess.run(command, env=environment()).returncode
    if status == 0 and not asks_help:
        say(
            "\nOpen report.html of that folder in a browser: what the block comes to on the ground,"
        )
        say("and where the camera model falls short. Then try your own: python run.py YOUR_BLOCK")
        say(f"(README.md says what is in one). All commands: {python.parent / 'corridor'} --help")
    return status


def lesson(options):
    """The page of the bicycle wheel, served until Ctrl-C."""
    folders = [str(ROOT / "notebooks"), str(ROOT)]
    command = [str(set_up()), "-m", "kit.classroom", *options]
    env = {**environment(), "PYTHONPATH": os.pathsep.join(folders)}
    return subprocess.run(command, env=env).returncode


def test(options=()):
    """Everything that is checked, cheapest first; stops at the first that fails."""
    os.chdir(ROOT)
    chosen = {
        (): ("notebooks/00_quickstart.ipynb", "-m", "not slow"),
        ("--all",): ("notebooks", "-m", "not night"),
        ("--night",): ("notebooks",),
    }[tuple(options)]
    python = set_up(["dev"])
    scripts = python.parent
    for title, command in (
        ("Style", [scripts / "ruff", "check", "--quiet", "."]),
        ("Layout", [scripts / "ruff", "format", "--check", "--quiet", "."]),
        ("Import contract", [scripts / "lint-imports", "--no-logo"]),
        # One session, so that it ends on one line: the tests, then every notebook's cells
        # against the outputs stored in it.
        (
            "Tests and notebooks",
            [python, "-m", "pytest", "tests", *chosen, *NBVAL, *WORKERS],
        ),
    ):
        say(f"== {title}")
        status = subprocess.run([str(word) for word in command], env=environment()).returncode
        if status:
            say(f"FAILED: {title.lower()} (status {status})")
            return 1
    return 0


def main(arguments):
    """Exit status: 0 done, 1 the work failed, 2 wrong input, 130 interrupted."""
    try:
        check_python()
        if arguments[:1] in (["-h"], ["--help"]):
            say(__doc__.strip())
            return 0
        if arguments[:1] == ["test"] and arguments[1:] in ([], ["--all"], ["--night"]):
            return test(arguments[1:])
        if arguments[:1] == ["lesson"]:
            return lesson(arguments[1:])
        if arguments == ["site"]:
            command = [str(set_up(["docs"])), str(ROOT / "docs" / "build.py")]
            return subprocess.run(command, env=environment()).returncode
        return adjust(arguments)
    except CannotRun as reason:
        print(f"error: {reason}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("Interrupted. The same command goes on from here.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
