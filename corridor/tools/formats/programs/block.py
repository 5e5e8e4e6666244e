"""A block folder of corridor itself: to convert it to another frame, or to add to it."""

from dataclasses import replace
from pathlib import Path

from corridor.core.block import is_block
from corridor.core.block import read as read_block
from corridor.tools.formats.project import Project

NAME = "block"
TITLE = "a block folder (block.toml)"


def recognise(path: Path) -> bool:
    """A folder with block.toml."""
    return path.is_dir() and is_block(path)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a folder. Raises InputError naming file and row."""
    block = read_block(path)
    # What is written elsewhere is another block.
    return Project(NAME, path, replace(block), own=True)
