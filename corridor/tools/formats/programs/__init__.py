"""Formats of other programs, one module or folder each, found by looking in this folder.

A format has NAME, TITLE, `recognise(path)`, `read(path, size)`; one that writes has WRITES (the
names it is exported by), HOLDS (the camera it holds), LOSSES (what else it cannot hold, and where
that went instead, by what a block has: the names of `exporting`) and `write(block, folder, name)`.
"""

import importlib
import pkgutil
from functools import lru_cache
from pathlib import Path
from types import ModuleType


@lru_cache(maxsize=1)
def formats() -> dict[str, ModuleType]:
    """Every format by its name."""
    found = [
        importlib.import_module(f"{__name__}.{module.name}")
        for module in pkgutil.iter_modules(__path__)
    ]
    return {module.NAME: module for module in found}


@lru_cache(maxsize=1)
def writers() -> dict[str, ModuleType]:
    """Formats that are written, by the name of each kind."""
    return {name: module for module in formats().values() for name in getattr(module, "WRITES", ())}


def candidates(path: Path, deep: int = 3) -> list[tuple[str, Path]]:
    """Names and places of the formats that recognise a file or folder, else its subfolders.

    The nearest places count; deeper ones are looked at only where nothing was found before.
    """
    level = [path]
    for _ in range(deep + 1):
        found = [
            (name, place)
            for place in level
            for name, module in formats().items()
            if module.recognise(place)
        ]
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
