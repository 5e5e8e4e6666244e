"""A folder appears whole or not at all."""

import csv
import io
import os
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from corridor.block.settings import FILE, write_settings
from corridor.block.tables import LAYOUTS
from corridor.errors import InputError


@contextmanager
def whole_folder(
    folder: str | os.PathLike, mark: str, ours: Callable[[str], bool] = lambda name: True
) -> Iterator[Path]:
    """A folder to write into, which becomes `folder` when the `with` ends well.

    Otherwise (error, full disk, Ctrl-C) nothing of it stays and what `folder` held is untouched.
    mark: file that tells a folder of this kind; another folder that is not empty is not replaced.
    ours: names of entries that may go with the old folder; the others are kept.
    Raises InputError where `folder` is something else.
    """
    check_folder(folder, mark)
    target = Path(folder).resolve()
    made = [parent for parent in target.parents if not parent.exists()]
    token = uuid.uuid4().hex[:8]
    part, old = (target.parent / f".{target.name}.{token}.{end}" for end in ("part", "old"))
    try:
        part.mkdir(parents=True)
        yield part
        if target.exists():
            _keep(target, part, ours)
            target.rename(old)
        part.rename(target)
    except BaseException:
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(part, ignore_errors=True)
        for parent in made:
            with suppress(OSError):
                parent.rmdir()
        raise
    finally:
        if target.exists():
            shutil.rmtree(old, ignore_errors=True)


def check_folder(folder: str | os.PathLike, mark: str) -> None:
    """Raises InputError where `whole_folder` would refuse a folder: to be told before long work."""
    target = Path(folder).resolve()
    if target.exists() and not target.is_dir():
        raise InputError(f"{folder} is a file; name a folder to write to")
    if target.exists() and any(target.iterdir()) and not (target / mark).is_file():
        raise InputError(
            f"{folder} is a folder without {mark}, so it is not replaced; name a new folder"
        )


def _keep(source: Path, target: Path, ours: Callable[[str], bool]) -> None:
    for entry in source.iterdir():
        if ours(entry.name) or (target / entry.name).exists():
            continue
        if entry.is_dir() and not entry.is_symlink():
            shutil.copytree(entry, target / entry.name, symlinks=True, copy_function=_link)
        else:
            _link(entry, target / entry.name)


def _link(source: str | Path, target: str | Path) -> None:
    # A hard link costs nothing; not every file system has them.
    try:
        os.link(source, target, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(source, target, follow_symlinks=False)


def write_block(block, folder: str | os.PathLike, form: str) -> None:
    """Write the tables as `form` ("csv" or "parquet") and block.toml."""
    with whole_folder(folder, FILE, _of_a_block) as part:
        write_settings(block, part)
        for table, layout in LAYOUTS.items():
            frame = getattr(block, table)
            if len(frame) or set(frame.columns) != set(layout.needed):
                write_table(frame, part / f"{table}.{form}")


def _of_a_block(name: str) -> bool:
    return name == FILE or Path(name).stem in LAYOUTS and Path(name).suffix in (".csv", ".parquet")


def write_table(frame: pd.DataFrame, path: Path) -> None:
    """One table; numbers with the digits that give the same float64 back, unknown ones empty."""
    try:
        arrow = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path.name}: a column mixes text and numbers ({reason}); give it one type"
        ) from None
    if path.suffix == ".parquet":
        pa.parquet.write_table(arrow, path)
        return
    try:
        _write_csv(arrow, path, "none")
    except pa.ArrowInvalid:  # a comma, a quote or a line break in a text
        _write_csv(arrow, path, "needed")


def _write_csv(arrow: pa.Table, path: Path, quoting: str) -> None:
    header = io.StringIO()
    csv.writer(header, lineterminator="\n").writerow(arrow.column_names)
    with path.open("wb") as file:
        file.write(header.getvalue().encode())
        options = pa.csv.WriteOptions(include_header=False, quoting_style=quoting, batch_size=65536)
        pa.csv.write_csv(arrow, file, options)
