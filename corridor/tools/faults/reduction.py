"""The smallest part of a block on which a command ends as it does on the whole."""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from corridor.core import __version__
from corridor.core.block import Block, read
from corridor.core.errors import InputError
from corridor.core.output import Progress, file_lines, telling, whole_folder
from corridor.core.registry import verbs
from corridor.tools.faults.anonymous import anonymous

MARK = "fault.txt"
# Images of the smallest part that is tried; each further one has twice as many.
_FEWEST = 8
# A part of which nothing is known takes so long at most, s.
_PATIENCE_S = 300.0
_LIBRARIES = ("numpy", "scipy", "pandas", "numba", "pyarrow", "matplotlib")


@dataclass(frozen=True)
class Fault:
    """What came of it. images: of the copy, of so many. status: of the command, None where it was
    stopped. said: its last lines on the copy. shown: whether the copy ends as the whole does."""

    folder: Path
    images: int
    whole: int
    status: int | None
    said: str
    shown: bool


def report(
    block: Block | str | os.PathLike,
    command: str,
    output: str | os.PathLike,
    progress: Callable[[Progress], None] | None = None,
) -> Fault:
    """Writes a small anonymous copy (`anonymous`) on which a command ends as on the whole block.

    command: a verb with its options, without the block and without an output; names of points,
    images and flights in it are replaced as those of the block are.
    Parts of neighbouring images are tried, 8 at first and each time twice as many, at the
    beginning, in the middle and at the end. Where the command ends well on the whole, nothing can
    be compared and the first 32 images are taken.
    OUT holds block/ and fault.txt, which has the command, its last lines and the versions.
    Raises InputError where the block cannot be read, or for a command that does not take one block.
    """
    block = read(block)
    words = shlex.split(command)
    if not words or words[0] not in verbs() or words[0] in ("report-bug", "change", "batch"):
        raise InputError(
            f"{command!r} does not begin with a verb that works on one block; give for instance "
            "--command 'adjust --effect gnss_bias'"
        )
    say = telling(progress)
    say(f"corridor {command}, on the whole block")
    copy, names = anonymous(block)
    status, said = _ending(copy, _translated(words, names))
    if status == 2 and said.endswith(f"; see `corridor {words[0]} --help`."):
        raise InputError(f"--command {command!r}: {said.removeprefix('error: ')}")
    chosen, shown = copy, status != 0
    if status == 0:
        chosen, names = anonymous(_part(block, 0, 32))
        status, said = _ending(chosen, _translated(words, names))
    else:
        for part in _parts(block):
            copy, own = anonymous(part)
            say(f"on {len(part.images)} images")
            ended = _ending(copy, _translated(words, own))
            if _kind(*ended) == _kind(status, said):
                chosen, names, (status, said) = copy, own, ended
                break
    with whole_folder(output, MARK) as folder:
        chosen.write(folder / "block")
        told = [
            f"corridor {shlex.join(_translated(words, names))}",
            f"status {'none, it was stopped' if status is None else status}",
            said,
            f"{len(chosen.images)} of {len(block.images)} images",
            *_versions(),
        ]
        text = "\n".join(told) + "\n" + file_lines(folder)
        (folder / MARK).write_text(text, encoding="utf-8", newline="\n")
    return Fault(Path(output), len(chosen.images), len(block.images), status, said, shown)


def _part(block: Block, start: int, count: int) -> Block:
    return block.select(images=block.images["image"].iloc[start : start + count])


def _parts(block: Block) -> Iterator[Block]:
    whole, count = len(block.images), _FEWEST
    while count < whole:
        for start in sorted({0, (whole - count) // 2, whole - count}):
            try:
                yield _part(block, start, count)
            except InputError:  # these images see nothing
                continue
        count *= 2


def _ending(block: Block, words: list[str]) -> tuple[int | None, str]:
    """Status and last lines of a command on a block; no status where it takes too long."""
    with tempfile.TemporaryDirectory() as place:
        folder, out = Path(place) / "block", Path(place) / "out"
        try:
            block.write(folder, observed=False)
        except InputError as error:
            return 2, f"error: {error}"
        run = [sys.executable, "-m", "corridor", words[0], str(folder), *words[1:]]
        if not {"-o", "--output"} & set(words):
            run += ["-o", str(out)]
        try:
            done = subprocess.run(
                run, capture_output=True, text=True, encoding="utf-8", errors="replace",
                timeout=_PATIENCE_S, stdin=subprocess.DEVNULL,
                env=os.environ | {"PYTHONIOENCODING": "utf-8"},
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return None, f"stopped after {_PATIENCE_S:.0f} s"
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        frames = [line.strip() for line in lines if line.startswith("  File ")]
        last = [*(_anonymous_path(line) for line in frames[-3:]), *lines[-1:]]
        return done.returncode, "\n".join(last).replace(str(folder), "block")


def _anonymous_path(line: str) -> str:
    """A line of a traceback with the file's name from the package on."""
    return re.sub(r'"[^"]*[/\\]([^"/\\]+[/\\][^"/\\]+)"', r'"\1"', line)


def _kind(status: int | None, said: str) -> tuple:
    """Status and sentence without numbers: what two endings have in common."""
    last = said.splitlines()[-1:] if said else [""]
    return status, re.sub(r"[-+]?\d[\d.,e+-]*", "#", last[0])


def _translated(words: list[str], names: dict[str, str]) -> list[str]:
    """The words of a command with the names of the copy."""
    out = list(words)
    for k, (option, value) in enumerate(zip(words, words[1:], strict=False), 1):
        if option in ("--control", "--check"):
            out[k] = ",".join(names.get(part, part) for part in value.split(","))
        elif option == "--effect":  # SLUG:parameter.GROUP=value
            out[k] = re.sub(r"\.([^=,]+)=", lambda m: f".{names.get(m[1], m[1])}=", value)
    return out


def _versions() -> list[str]:
    out = [f"corridor {__version__}", f"Python {platform.python_version()}, {platform.system()}"]
    for name in _LIBRARIES:
        try:
            out.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            out.append(f"{name} none")
    return out
