"""Formats of tracks and image times, one a file.

A module of this folder that has `recognise(head)` is a format: it tells its files by their first
lines, and `read(path)` returns a Track or Exposures.
"""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from corridor.errors import InputError
from corridor.gnss.exposures import Exposures
from corridor.gnss.formats import block_table, exif
from corridor.gnss.text import read_lines
from corridor.gnss.track import Track

_HEAD_LINES = 80


def formats() -> list:
    """The modules of this folder that are formats of text files."""
    found = [import_module(f"{__name__}.{info.name}") for info in iter_modules(__path__)]
    return [module for module in found if hasattr(module, "recognise")]


def read(path: Path) -> Track | Exposures:
    """What is in a file of any format.

    Raises InputError where no format recognises it.
    """
    if not path.exists():
        raise InputError(f"{path.name} does not exist; correct the path")
    if path.suffix == ".parquet":
        return block_table.read(path)
    head = "\n".join(read_lines(path)[:_HEAD_LINES])
    if not head.strip():
        raise InputError(f"{path.name} is empty; write the file again")
    for module in formats():
        if module.recognise(head):
            return module.read(path)
    titles = ", ".join(module.TITLE for module in formats())
    raise InputError(
        f"{path.name} is in no format that is known, or its header is missing; give {titles}"
    )


def has_table(folder: Path, name: str) -> bool:
    """Whether a folder holds that table of a block."""
    return any((folder / f"{name}{suffix}").is_file() for suffix in (".csv", ".parquet"))


def table_in(folder: Path, name: str) -> Path:
    """The file of a table in a block folder. Raises InputError where it is not there."""
    for suffix in (".csv", ".parquet"):
        if (folder / f"{name}{suffix}").is_file():
            return folder / f"{name}{suffix}"
    raise InputError(f"{folder.name} holds no {name}.csv; name the file of the {name}")


__all__ = ["exif", "formats", "has_table", "read", "table_in"]
