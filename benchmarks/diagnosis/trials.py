"""The blocks of a benchmark: a folder of them, or made by the generator of the source checkout."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.diagnosis.generator import plan_of_benchmark
from benchmarks.diagnosis.truth import Truth, read_truth, truth_of
from corridor.core.block import Block, read
from corridor.core.errors import InputError

_TRUTH = ".truth.json"
_TWINS = ("_twin", ".twin", "-twin")


@dataclass(frozen=True)
class Trial:
    """A block to be diagnosed. load: gives the block, its twin (or None) and what is true.

    what: how it came about; a result that was kept counts for the same trial only.
    """

    name: str
    what: str
    load: Callable[[], tuple[Block, Block | None, Truth]]


def of_folder(folder: Path) -> list[Trial]:
    """A trial for every NAME.truth.json that stands beside a block NAME.

    The twin is NAME_twin or NAME.twin, where there is one. Raises InputError where there is none.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder: name the one that holds blocks and their truth")
    out = []
    for file in sorted(folder.rglob(f"*{_TRUTH}")):
        block = file.with_name(file.name[: -len(_TRUTH)])
        if not (block / "block.toml").is_file():
            continue
        name = "-".join(block.relative_to(folder).parts)
        twin = next((t for t in map(block.with_name, _twins(block.name)) if t.is_dir()), None)
        out.append(Trial(name, f"folder {block.resolve()}", partial(_read, block, twin, file)))
    if not out:
        raise InputError(
            f"{folder} holds no block NAME with its NAME{_TRUTH} beside it: put both there"
        )
    return out


def _twins(name: str) -> list[str]:
    return [name + ending for ending in _TWINS]


def _read(folder: Path, twin: Path | None, truth: Path):
    return read(folder), None if twin is None else read(twin), read_truth(truth)


def of_generator(
    kinds: list[str], count: int | None = None, seed: int = 0, short: bool = False
) -> list[Trial]:
    """Trials of some kinds (null, single, together, unknown, perfect, lookalike, all).

    count: blocks of each kind, spread over its cases; default: each case once. short: half as
    many images and observations an image. Raises InputError outside a source checkout.
    """
    hidden = plan_of_benchmark
    out = []
    for kind in hidden.KINDS if "all" in kinds else kinds:
        for name, case, its_seed in hidden.plan(kind, count, seed, short):
            what = f"{case!r}, seed {its_seed}"
            out.append(Trial(name, what, partial(_generate, case, its_seed)))
    return out


def _generate(case, seed: int):
    made = plan_of_benchmark.generate(case, seed)
    return made.block, made.twin, truth_of(made.truth)
