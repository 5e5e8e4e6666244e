"""One try: the command in this process, what it printed, and whether that is what it should be."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import traceback
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from corridor.core.block import read
from corridor.interface import cli

_SAME_M = 0.002

# Of no use to anybody who is not a programmer.
_NEVER = r"Traceback|Error\(|\b(?:nan|inf) (?:m|px|mm)\b|[0-9]{9,} px|NoneType|np\.float"


@dataclass(frozen=True)
class Try:
    """number: in the newcomer's list, with a letter where it is several. words: what is typed,
    {w}: folder of the files, {o}: of the output. status: 0, 1 or 2. says, never: patterns that the
    printed text must have, and must not have. long: left out of the short form. kind: of input,
    for the table of forms. here: the block made has the flight's own ground points, to 2 mm."""

    number: str
    words: str
    status: int
    says: str = ""
    never: str = ""
    long: bool = False
    kind: str = ""
    here: bool = False


def _away(made: Path, world: Path) -> float:
    """How far, m, ground points of a block lie at most from those of the flight, in its frame."""
    found, true = (read(folder).ground for folder in (made, world / "own"))
    places = [
        table.set_index("point")[["x", "y", "z"]].astype(float).reindex(true["point"])
        for table in (found, true)
    ]
    return float(np.nan_to_num((places[0] - places[1]).abs().to_numpy(), nan=np.inf).max())


@dataclass(frozen=True)
class Judged:
    """What came of a try. fault: empty where it is good."""

    text: str
    fault: str


def judged(one: Try, world: Path, out: Path) -> Judged:
    """Run it and compare."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    words = [word.format(w=world, o=out) for word in shlex.split(one.words)]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            status = cli.main(words)
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        except Exception:
            status = -1
            printed.write(traceback.format_exc())
    text = printed.getvalue()
    flat = " ".join(text.split())
    if status != one.status:
        return Judged(text, f"status {status} in place of {one.status}")
    for pattern in one.says.split(" & ") if one.says else ():
        if not re.search(pattern, flat, re.IGNORECASE):
            return Judged(text, f"does not say {pattern!r}")
    if one.here and (away := _away(out / "b", world)) > _SAME_M:
        return Judged(text, f"puts ground points {away:g} m elsewhere")
    for pattern in (_NEVER, *(one.never.split(" & ") if one.never else ())):
        found = re.search(pattern, flat)
        if found:
            return Judged(text, f"says {found[0]!r}")
    return Judged(text, "")
