"""Formats of other programs, one module or folder each, found by looking in this folder.

Another package offers its own by entry points of the group `corridor.formats`, each of which names
a module like these.

A format has NAME, TITLE, `recognise(path)`, `read(path, size)`; one that writes has WRITES (the
names it is exported by), HOLDS (the camera it holds), LOSSES (what else it cannot hold, and where
that went instead, by what a block has: the names of `exporting`) and `write(block, folder, name)`;
GRIDS = False where its coordinates are never those of a grid, DISTANCES = True where it has scale
bars between markers.
"""

import importlib
import pkgutil
import warnings
from collections.abc import Container, Iterable, Iterator
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType


@lru_cache(maxsize=1)
def formats() -> dict[str, ModuleType]:
    """Every format by its name."""
    found = [
        importlib.import_module(f"{__name__}.{module.name}")
        for module in pkgutil.iter_modules(__path__)
    ]
    own = {module.NAME: module for module in found}
    return own | {module.NAME: module for module in _of_others(own)}


def _of_others(own: Container[str]) -> Iterator[ModuleType]:
    """Formats of installed packages; one that cannot be loaded costs a warning and no more."""
    for point in entry_points(group="corridor.formats"):
        try:
            module = point.load()
            complete = callable(module.recognise) and callable(module.read) and bool(module.TITLE)
            fault = "" if complete and module.NAME not in own else f"{module.NAME} is there already"
        except Exception as error:  # what a stranger's package does is not known here
            fault = f"cannot be loaded ({error!r})"
        if fault:
            warnings.warn(f"format {point.name} of {point.value}: {fault}; left out", stacklevel=2)
        else:
            yield module


@lru_cache(maxsize=1)
def writers() -> dict[str, ModuleType]:
    """Formats that are written, by the name of each kind."""
    return {name: module for module in formats().values() for name in getattr(module, "WRITES", ())}


# Files that are looked into in a folder that is no project, and how many of them.
_TEXTS = frozenset((".txt", ".json", ".sfm", ".xml", ".out", ".nvm", ".bal", ".gz", ".bz2"))
_MOST_FILES = 100


def _recognised(places: Iterable[Path]) -> list[tuple[str, Path]]:
    return [
        (name, place)
        for place in places
        for name, module in formats().items()
        if module.recognise(place)
    ]


def candidates(path: Path, deep: int = 3) -> list[tuple[str, Path]]:
    """Names and places of the formats that recognise a file or folder, else its subfolders.

    The nearest places count; deeper ones are looked at only where nothing was found before. In a
    folder that is no project the files may be.
    """
    level = [path]
    for _ in range(deep + 1):
        found = _recognised(level) or _recognised(
            file
            for place in level
            if place.is_dir()
            for file in sorted(place.iterdir())[:_MOST_FILES]
            if file.suffix.lower() in _TEXTS and file.is_file()
        )
        if found or not path.is_dir():
            return found
        level = sorted(
            inner
            for place in level
            if place.is_dir()
            for inner in place.iterdir()
            if inner.is_dir() and not inner.name.startswith(".")
        )
    return []
