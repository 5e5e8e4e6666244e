"""Sets corridor up and runs it, from nothing but Python 3.11 or newer.

python run.py                    adjust the shipped block; results under out/dike
python run.py BLOCK              the same with your own block folder
python run.py BLOCK -o OUT ...   anything after BLOCK goes to `corridor adjust`
python run.py test               style, import contract, tests and the first notebook
python run.py test --all         the long tests and every notebook as well

The first run makes the folder .venv beside this file and installs into it the versions
named in constraints.txt; later runs use it again until those or pyproject.toml change.
To start afresh, delete .venv.
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
SHIPPED_BLOCK = ROOT / "data_synthetic" / "dike"
OLDEST = (3, 11)
NBVAL = ("--nbval", "--nbval-current-env", "--nbval-cell-timeout", "1800")
# A file is one worker's: what its tests share is made once.
WORKERS = ("-n", "2", "--dist", "loadfile")


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
    """Variables for the programs we start: nothing from outside may reach into .venv."""
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    return {**kept, "PYTHONUTF8": "1", "PIP_USER": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def fingerprint(root=ROOT):
    """Changes when the environment has to be installed again."""
    digest = hashlib.sha256()
    for name in ("pyproject.toml", "constraints.txt"):
        digest.update((root / name).read_bytes().replace(b"\r\n", b"\n"))
    digest.update(f"{root} {platform.python_version()} {platform.machine()}".encode())
    return digest.hexdigest()


def installed_extras(stamp=STAMP, root=ROOT):
    """Extras that .venv holds in today's versions; None if it has to be installed."""
    try:
        found = json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return set(found["extras"]) if found.get("fingerprint") == fingerprint(root) else None


def works(python):
    """Whether .venv has an interpreter of this very version with pip."""
    try:
        answer = subprocess.run(
            [str(python), "-c", "import pip, platform; print(platform.python_version())"],
            capture_output=True,
            text=True,
            env=environment(),
        )
    except OSError:
        return False
    return answer.stdout.strip() == platform.python_version()


def set_up(extras=()):
    """Make .venv if needed, install corridor with extras into it; path of its Python."""
    python = python_of(VENV)
    have = installed_extras()
    if have is not None and have >= set(extras) and works(python):
        return python
    started = time.monotonic()
    if not works(python):
        say(f"Making the environment {VENV}")
        made = subprocess.run(
            [sys.executable, "-m", "venv", "--clear", str(VENV)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment(),
        )
        if made.returncode:
            raise CannotRun(f"The environment could not be made:\n{made.stdout.strip()}")
    wanted = sorted(set(extras) | (have or set()))
    STAMP.unlink(missing_ok=True)
    target = f"{ROOT}[{','.join(wanted)}]" if wanted else str(ROOT)
    say("Installing corridor and what it needs (the first time this downloads some 200 MB)")
    install(python, ["--constraint", str(ROOT / "constraints.txt"), "--editable", target])
    STAMP.write_text(
        json.dumps({"fingerprint": fingerprint(), "extras": wanted}) + "\n", encoding="utf-8"
    )
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


def test(options=()):
    """Everything that is checked, cheapest first; stops at the first that fails."""
    os.chdir(ROOT)
    whole = "--all" in options
    chosen = ("notebooks",) if whole else ("notebooks/00_quickstart.ipynb", "-m", "not slow")
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
        if arguments[:1] == ["test"] and set(arguments[1:]) <= {"--all"}:
            return test(arguments[1:])
        return adjust(arguments)
    except CannotRun as reason:
        print(f"error: {reason}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("Interrupted. The same command goes on from here.", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
