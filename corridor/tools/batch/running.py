"""All blocks of a batch shared out among workers; what is done is kept, block by block."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import joblib

from corridor.core.adjustment import Model
from corridor.core.block import is_block
from corridor.core.errors import InputError, WorkFailed
from corridor.core.options import made
from corridor.core.output import Progress, check_folder, check_gis, sole, telling
from corridor.core.parallel import WorkerDied, parallel
from corridor.tools.batch.result import BatchResult
from corridor.tools.batch.row import NOT_RUN, Row
from corridor.tools.batch.work import MARK, RESULTS, Asked, Task, call_of, share_of_machine, work

_COUNTERPARTS = 20


def batch(
    verb: str,
    blocks: str | os.PathLike | Iterable[str | os.PathLike],
    output: str | os.PathLike,
    jobs: int | None = None,
    cluster: str | None = None,
    memory_gb: float | None = None,
    progress: Callable[[Progress], None] | None = None,
    **options: Any,
) -> BatchResult:
    """Adjusts or diagnoses many blocks: each its own result, and one table and page for all.

    verb: `adjust` or `diagnose`. blocks: folders of blocks, or folders that hold such folders.
    output: folder with blocks/NAME (what the verb writes), batch.csv, report.html, batch.json.
        What it holds of the same blocks, options and version is not done again; failures are.
    jobs: processes; default: as many as the machine has cores for. cluster: address of a Dask
        scheduler (extra `cluster`) in their place; its workers have corridor, and find blocks and
        output under the same paths.
    memory_gb: that each worker may use, GB (Linux); default: its share of the machine, or what a
        Dask worker was started with.
    progress: called with a `Progress` for each block, whose result is its row.
    options: of `corridor.adjust` or `corridor.diagnose`; required: see `Adjustment.required`;
        counterparts: of a diagnosis; gis: also files for a GIS; command: what was typed, with
        BLOCKS for the blocks.

    A block that fails is a row that says why. One whose worker dies is done again with nothing else
    running; if that worker dies too, it has failed. Results are those of one block at a time, bit
    for bit. Raises InputError where nothing can be begun, or another batch is writing to output.
    """
    asked = _asked(verb, options, memory_gb)
    if jobs is None and cluster is None:
        # As many as there are cores for the threads of each.
        jobs = max(joblib.cpu_count() // asked.options.get("threads", 1), 1)
    jobs = jobs or 1
    if cluster is None and memory_gb is None:
        asked = replace(asked, memory_gb=share_of_machine(jobs))
    output = Path(output).absolute()
    folders = _named(blocks)
    _check_output(output, verb)
    (output / "rows").mkdir(parents=True, exist_ok=True)
    with sole(output / "batch.lock") as ours:
        if not ours:
            raise InputError(
                f"{output}: another batch is writing there; wait until it is done, or name another "
                "folder"
            )
        tasks = [Task.of(name, folder, output, asked) for name, folder in folders.items()]
        rows = {task.name: Row(task.name, str(task.folder), NOT_RUN) for task in tasks}

        def so_far() -> BatchResult:
            ordered = tuple(sorted(rows.values(), key=lambda row: row.order))
            return BatchResult(verb, ordered, output, asked.required)

        so_far().write()
        done, say = 0, telling(progress)
        try:
            for row in _worked(tasks, jobs, cluster):
                rows[row.block], done = row, done + 1
                so_far().write()
                say(f"{row.block}: {row.verdict}", done, len(tasks), row)
        finally:
            for task in tasks:
                task.forget()
        return so_far()


def _worked(tasks: list[Task], jobs: int, cluster: str | None) -> Iterator[Row]:
    """The row of every task, as they come; those that are kept first, the large blocks next."""
    waiting = {}
    for task in tasks:
        row = task.kept()
        if row is None:
            waiting[task.name] = task
        else:
            yield row
    # The largest first, so that no worker is left over with it at the end.
    waiting = dict(sorted(waiting.items(), key=lambda item: -item[1].size))
    while True:
        # What was under way when a worker died waits for its turn alone: one of them is the cause.
        together = [task for task in waiting.values() if not task.begun]
        if not together:
            break
        before = len(waiting), len(together)
        try:
            with parallel(jobs, cluster, ordered=False) as share_out:
                for row in share_out(joblib.delayed(work)(task) for task in together):
                    del waiting[row.block]
                    yield row
        except WorkerDied as died:
            left = [task for task in waiting.values() if not task.begun]
            if before == (len(waiting), len(left)):
                raise WorkFailed(
                    f"workers die before they begin with a block ({died}); what is done is kept"
                ) from None
    for task in waiting.values():
        yield _alone(task, cluster)


def _alone(task: Task, cluster: str | None) -> Row:
    """The row of a task whose worker died, from a worker of its own with nothing else running."""
    try:
        # Two, since one is this process, which shall not die.
        with parallel(2, cluster) as share_out:
            return next(iter(share_out([joblib.delayed(work)(task)])))
    except WorkerDied:
        return task.failed(
            "The worker died, and another one with nothing else running: give it a machine with "
            "more memory, or look at the block with `corridor summary`."
        )


def _asked(verb: str, options: dict[str, Any], memory_gb: float | None) -> Asked:
    """What is asked of every block, checked before the first is begun."""
    if verb not in RESULTS:
        raise InputError(f"{verb!r} is nothing to do with many blocks: use adjust or diagnose")
    if memory_gb is not None and not memory_gb > 0:
        raise InputError(f"{memory_gb} GB of memory are not above 0")
    required, command = options.pop("required", None), options.pop("command", "")
    counterparts, gis = options.pop("counterparts", _COUNTERPARTS), options.pop("gis", False)
    if gis:
        check_gis(None)
    told = {one.name: options.pop(one.name) for one in fields(Model) if one.name in options}
    model = made(Model, options.pop("model", None), told, "model")
    unknown = set(options) - set(inspect.signature(call_of(verb)).parameters)
    if unknown:
        raise TypeError(f"{verb} of many blocks takes no {', '.join(sorted(unknown))}")
    return Asked(verb, model, options, required, counterparts, memory_gb, command, gis)


def _named(blocks: str | os.PathLike | Iterable[str | os.PathLike]) -> dict[str, Path]:
    """Folders of blocks by their names in the batch, which are as much of a path as it takes."""
    given = [blocks] if isinstance(blocks, str | os.PathLike) else list(blocks)
    folders = [inner for folder in given for inner in _within(Path(folder).absolute())]
    folders = list(dict.fromkeys(Path(os.path.normpath(folder)) for folder in folders))
    if not folders:
        raise InputError("no block is named: give the folders of one or more")
    if not any(map(is_block, folders)):
        more = f" nor do {len(folders) - 1} more" if len(folders) > 1 else ""
        raise InputError(
            f"{folders[0]} holds no block{more}: there is no block.toml in it, nor in the folders "
            "in it. Give the folder of a block, or one that holds blocks; `corridor import` makes "
            "blocks of projects"
        )
    for count in range(1, max(len(folder.parts) for folder in folders) + 1):
        names = ["-".join(folder.parts[1:][-count:]) for folder in folders]
        # Some disks take two names that differ in capitals for one.
        if len({name.lower() for name in names}) == len(names):
            return dict(zip(names, folders, strict=True))
    raise InputError(f"{folders[0]} has a name that another block has too: rename one")


def _within(folder: Path) -> list[Path]:
    """The folder, or the blocks in it where it is none itself."""
    if not folder.is_dir():
        what = "is a file; give" if folder.exists() else "is not there: give"
        raise InputError(f"{folder} {what} the folder of a block, or one that holds blocks")
    if is_block(folder):
        return [folder]
    if not any(folder.iterdir()):
        raise InputError(f"{folder} is empty: give the folder of a block, or one that holds blocks")
    return sorted(inner for inner in folder.iterdir() if is_block(inner)) or [folder]


def _check_output(output: Path, verb: str) -> None:
    """Raises InputError where a folder holds something else than batches of this verb."""
    check_folder(output, MARK)
    try:
        other = json.loads((output / MARK).read_text(encoding="utf-8"))["verb"]
    except (OSError, ValueError, KeyError, TypeError):
        return
    if other != verb:
        raise InputError(
            f"{output} holds what `corridor batch {other}` wrote; name another folder for {verb}"
        )
