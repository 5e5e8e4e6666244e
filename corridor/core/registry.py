"""Where rooms and verbs stand: what is called `corridor.NAME`, and what `corridor VERB` runs.

Imports go down only, and no tool imports another. What stands above, or beside, is asked for here
by its public name when it is needed: who prints an adjustment, who draws it, another tool.
"""

import ast
import importlib
import sys
import warnings
from functools import cache
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

# Folders of rooms, the lowest first.
_FLOORS = ("core", "tools", "interface")
# Public names of rooms whose folder is called otherwise.
_FOLDERS = {"interchange": "formats", "batches": "batch"}
# Another package offers verbs by entry points of this group: NAME = "its.module".
VERBS = "corridor.verbs"
_HERE = Path(__file__).parents[1]
_ROOT = _HERE.parent
# Where the verbs of this package stand, each a file; a tool brings its own.
_VERBS = ("interface/cli/verbs/*.py", "diagnosis/verbs/*.py", "tools/*/verbs/*.py")


@cache
def home(name: str) -> str | None:
    """The module that is called `corridor.NAME`, or None where there is none."""
    if name.startswith("_") or name in _FLOORS:
        return None
    for floor in (*_FLOORS, ""):
        place = _HERE / floor / _FOLDERS.get(name, name)
        if place.with_suffix(".py").is_file() or (place / "__init__.py").is_file():
            return ".".join(place.relative_to(_ROOT).parts)
    return None


def room(name: str) -> ModuleType:
    """The room that is called `corridor.NAME`, loaded. Raises ModuleNotFoundError for no room."""
    place = home(name)
    if place is None:
        raise ModuleNotFoundError(f"corridor has no room {name!r}", name=f"corridor.{name}")
    return importlib.import_module(place)


@cache
def verbs() -> dict[str, str]:
    """Module of each verb of the command, by the verb's name; none is loaded.

    A verb is a file in the folder `verbs` of the command, of the diagnosis or of a tool, or an
    entry point of another package. `import` and other words of the language are files with a
    trailing underscore.
    """
    found = {
        path.stem.rstrip("_").replace("_", "-"): ".".join(
            path.relative_to(_ROOT).with_suffix("").parts
        )
        for place in _VERBS
        for path in _HERE.glob(place)
        if not path.name.startswith("_")
    }
    for point in entry_points(group=VERBS):
        if point.name in found:
            warnings.warn(
                f"verb {point.name} of {point.value} is left out: there is one of that name",
                stacklevel=2,
            )
        found.setdefault(point.name, point.value)
    return dict(sorted(found.items()))


def verb(name: str) -> ModuleType:
    """The module of a verb. Raises KeyError where there is none of that name."""
    return importlib.import_module(verbs()[name])


def help_of(name: str) -> str:
    """The docstring of a verb, which is its help; where it can be, without loading its room."""
    source = _ROOT.joinpath(*verbs()[name].split(".")).with_suffix(".py")
    if source.is_file():
        return ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    return verb(name).__doc__ or ""


class _Called(MetaPathFinder, Loader):
    """Imports of a public name, `from corridor.effects import ...`, as the module at its home."""

    def find_spec(self, fullname, path=None, target=None):
        package, _, rest = fullname.partition(".")
        name, _, below = rest.partition(".")
        place = home(name) if package == "corridor" and name else None
        if place is None or place == f"corridor.{name}":
            return None
        return ModuleSpec(fullname, self, origin=f"{place}.{below}".rstrip("."))

    def create_module(self, spec):
        module = importlib.import_module(spec.origin)
        # Python gives the module this spec, which is not its own: `exec_module` takes it back.
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module):
        module.__spec__ = module.__spec__.loader_state


def offered(room: dict[str, Any]) -> list[str]:
    """The names that a room's `__init__` imports for others, sorted: its `__all__` and its `dir`.

    room: its `globals()`. Modules and private names are not among them.
    """
    room["__dir__"] = lambda: room["__all__"]
    return sorted(
        name
        for name, value in room.items()
        if not (name.startswith("_") or isinstance(value, ModuleType) or value is offered)
    )


def answer_to_public_names() -> None:
    """Let `import corridor.effects` mean the room of that name, wherever it stands."""
    if not any(isinstance(one, _Called) for one in sys.meta_path):
        sys.meta_path.insert(0, _Called())
