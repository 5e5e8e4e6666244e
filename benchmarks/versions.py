"""The command in places and with versions that nobody here has: what works, and what is said.

python -m benchmarks.versions here
python -m benchmarks.versions lowest
python -m benchmarks.versions newest

here: the environment that runs this. lowest, newest: one of its own, with the lowest or the newest
versions that pyproject.toml allows (uv finds them; the package index is asked). In each a copy of
the shipped block is looked at, adjusted and corrected: in a folder with blanks and umlauts, with
the locale C and Python's own remedies for that switched off, and from a copy of the package that
cannot be written, by a user without a home. A line for each place; status 1 where one failed.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = (
    ("summary", "{block}"),
    ("adjust", "{block}", "-o", "{out}/adjusted"),
    ("correct", "{block}", "--effect", "rolling_shutter:readout=0.02", "-o", "{out}/corrected"),
)
_NOBODY = 65534
_PATIENCE_S = 1800.0


def environment(folder: Path, resolution: str) -> Path:
    """The Python of a new environment with the lowest or newest versions."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / ("python.exe" if os.name == "nt" else "python")
    subprocess.run([python, "-m", "pip", "install", "-q", "uv"], check=True)
    way = {"lowest": "lowest-direct", "newest": "highest"}[resolution]
    subprocess.run(
        [python, "-m", "uv", "pip", "install", "-q", "--python", python, "--resolution", way, ROOT],
        check=True,
    )
    return python


def places(folder: Path) -> dict[str, dict]:
    """What is special about each place: arguments of `subprocess.run`, and where it lies."""
    ordinary = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    poor = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    out = {
        "a folder with blanks and umlauts": {"env": ordinary},
        "locale C in such a folder": {"env": ordinary | poor},
    }
    if os.name == "posix":
        bare = {k: v for k, v in ordinary.items() if k not in ("HOME", "NUMBA_CACHE_DIR")}
        bare |= {"HOME": str(folder / "no home"), "TMPDIR": str(folder / "tmp")}
        user = {"user": _NOBODY, "group": _NOBODY} if os.geteuid() == 0 else {}
        out["a package that cannot be written, no home"] = {"env": bare, **user}
    return out


def tried(python: Path, package: Path | None, folder: Path) -> Iterator[tuple[str, str]]:
    """Place and what came of it: "works", "not tried" or the last line of what failed.

    package: a folder with the package in place of the installed one.
    """
    (folder / "tmp").mkdir(mode=0o1777)
    (folder / "tmp").chmod(0o1777)
    for number, (name, special) in enumerate(places(folder).items()):
        home = folder / f"Mü ller {number}"
        block = home / "Bl öcke" / "dike"
        shutil.copytree(ROOT / "data_synthetic" / "dike", block)
        out = home / "out"
        out.mkdir()
        for path in (home, out):
            path.chmod(0o777)
        if package is not None:
            special["env"] = special["env"] | {"PYTHONPATH": str(package)}
        try:
            yield name, _failure(python, special, block, out) or "works"
        except PermissionError:
            yield name, "not tried, that user may not start this Python"


def _failure(python, special, block, out):
    for words in COMMANDS:
        words = [word.format(block=block, out=out) for word in words]
        done = subprocess.run(
            [python, "-m", "corridor", *words], cwd=out, capture_output=True, timeout=_PATIENCE_S,
            stdin=subprocess.DEVNULL, **special,
        )  # fmt: skip
        if done.returncode:
            last = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
            return f"{words[0]}: status {done.returncode}, {''.join(last)}"
    return ""


def main() -> int:
    """Print a line a place."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("which", choices=("here", "lowest", "newest"))
    which = parser.parse_args().which
    sound = True
    with tempfile.TemporaryDirectory(prefix="versions ä ") as name:
        folder = Path(name)
        folder.chmod(0o755)
        package = folder / "package"
        if which == "here":
            python = Path(sys.executable)
            shutil.copytree(ROOT / "corridor", package / "corridor")
        else:
            python = environment(folder / "environment", which)
            package = None
        # Nobody writes there: of root and of others alike, for the caches that a run would leave.
        for path in [] if package is None else package.rglob("*"):
            path.chmod(0o555 if path.is_dir() else 0o444)
        began = time.monotonic()
        for place, said in tried(python, package, folder):
            print(f"{which}: {place}: {said} ({time.monotonic() - began:.0f} s)", flush=True)
            sound &= said.startswith(("works", "not tried"))
            began = time.monotonic()
        if package is not None:
            for path in (package, *package.rglob("*")):
                path.chmod(0o755)
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
