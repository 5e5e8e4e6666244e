"""All blocks of a benchmark, each kept as soon as it is done."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import joblib

import corridor
from benchmarks.diagnosis.assess import assess
from benchmarks.diagnosis.trials import Trial
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import Progress, telling, whole_file, write_json
from corridor.core.parallel import parallel

KEPT = "blocks"


def run(
    trials: list[Trial],
    folder: str | os.PathLike,
    jobs: int = 1,
    cluster: str | None = None,
    again: bool = False,
    rivals: bool = True,
    progress: Callable[[Progress], None] | None = None,
    **options,
) -> list[dict]:
    """A row for each trial, in their order; see `assess`.

    folder: each row is kept in folder/blocks/NAME.json when it is done, so that an interrupted run
    goes on where it stopped; a row of other options, of another block of the same name or of
    another version of corridor counts as missing. again: as if nothing were there.
    jobs, cluster: processes, or a Dask scheduler. rivals: whether the baselines are run.
    progress: called with a `Progress` whose result is a row. options: of `diagnose`.

    A block that cannot be read or adjusted is a row that says so in `failed`; any other exception
    is a fault of ours and ends the run, with the rows that are done kept.
    """
    marks = {trial.name: _mark(trial, options, rivals) for trial in trials}
    if len(marks) < len(trials):
        raise InputError("two blocks have the same name: give each its own")
    kept = _kept(Path(folder))
    rows = {} if again else _read(kept, marks)
    done, say = len(rows), telling(progress)
    for row in list(rows.values()):
        say(f"{row['name']}: {row.get('verdict') or 'failed'}", done, len(trials), row)
    # Blocks are read or made here and sent: workers need neither the folder nor the generator.
    todo = (
        joblib.delayed(_one)(trial.name, _loaded(trial), options, rivals)
        for trial in trials
        if trial.name not in rows
    )
    with parallel(jobs, cluster, ordered=False) as share_out:
        for row in share_out(todo):
            rows[row["name"]] = row
            _keep(kept, row | {"of": marks[row["name"]]})
            done += 1
            say(f"{row['name']}: {row.get('verdict') or 'failed'}", done, len(trials), row)
    if all(row["failed"] for row in rows.values()):
        first = next(iter(rows.values()))
        raise AdjustmentFailed(f"no block could be diagnosed; {first['name']}: {first['failed']}")
    return [rows[trial.name] for trial in trials]


def _kept(folder: Path) -> Path:
    """Where rows are kept, made if need be; a folder that holds something else is refused."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder to write to")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / KEPT).is_dir():
        raise InputError(f"{folder} holds something, but no earlier benchmark; name a new folder")
    (folder / KEPT).mkdir(parents=True, exist_ok=True)
    return folder / KEPT


def _loaded(trial: Trial):
    try:
        return trial.load()
    except InputError as error:
        return str(error)


def _one(name: str, loaded, options: dict, rivals: bool) -> dict:
    if isinstance(loaded, str):
        return {"name": name, "kind": "unread", "hidden": "?", "failed": loaded}
    return assess(name, *loaded, options, rivals)


def _mark(trial: Trial, options: dict, rivals: bool) -> str:
    """What a kept row has to agree with."""
    text = f"{corridor.__version__} {trial.what} {sorted(options.items())!r} {rivals}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _keep(folder: Path, row: dict) -> None:
    """One file a row, whole or not at all."""
    with whole_file(folder / f"{row['name']}.json") as part:
        write_json(row, part)


def _read(folder: Path, marks: dict[str, str]) -> dict[str, dict]:
    out = {}
    for name, mark in marks.items():
        try:
            row = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if row.get("of") == mark:
            out[name] = row
    return out
