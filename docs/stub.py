"""Writes corridor/__init__.pyi: what `import corridor` offers, as type checkers and editors see it.

    python docs/stub.py

The names are loaded at their first use, and some calls take the fields of dataclasses as keywords:
neither can be read from the source. `tests/test_types.py` holds the file to what this would write.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import corridor
from corridor.core import registry

STUB = Path(corridor.__file__).with_suffix(".pyi")
# Where the types of annotations come from, beside the modules of the functions themselves.
_ANYWHERE = {
    "os": "import os",
    "np": "import numpy as np",
    "Any": "from typing import Any",
    "Path": "from pathlib import Path",
    **{
        name: f"from collections.abc import {name}"
        for name in ("Callable", "Iterable", "Mapping", "Sequence")
    },
}


def text() -> str:
    """The whole stub."""
    imports, body = {"from typing import Any"}, []
    for name in corridor.__all__:
        value = getattr(corridor, name)
        if inspect.isclass(value):
            imports.add(f"from {_public(value)} import {value.__name__} as {name}")
        elif inspect.isfunction(value):
            body.append(_function(name, value, imports))
        elif callable(value):
            call = getattr(value, name)
            kind = f"_{name.capitalize()}"
            body.append(
                f"class {kind}:\n"
                f"    {_function('__call__', call, imports, 'self')}"
                f"    def __getattr__(self, name: str) -> Any: ...\n\n{name}: {kind}\n"
            )
        else:
            floor, _, room = value.__name__.rpartition(".")
            imports.add(f"from {floor} import {room} as {name}")
    head = '"""Made by docs/stub.py; do not edit."""\n'
    return "\n".join([head, *sorted(imports), "\n__version__: str\n", *body])


def _function(name: str, value, imports: set[str], first: str = "") -> str:
    told, room = [first] if first else [], sys.modules[value.__module__]
    signature, alone = inspect.signature(value), False
    for one in signature.parameters.values():
        kind = one.annotation if isinstance(one.annotation, str) else "Any"
        _needed(kind, room, imports)
        if one.kind is one.KEYWORD_ONLY and not alone:
            told.append("*")
            alone = True
        stars = {one.VAR_KEYWORD: "**", one.VAR_POSITIONAL: "*"}.get(one.kind, "")
        default = "" if one.default is one.empty else " = ..."
        told.append(f"{stars}{one.name}: {kind}{default}")
    result = signature.return_annotation
    _needed(result, room, imports)
    return f"def {name}({', '.join(told)}) -> {result}: ...\n"


def _needed(annotation: str, room, imports: set[str]) -> None:
    """Adds the imports that an annotation needs, found where its function is at home."""
    for word in set(re.findall(r"[A-Za-z_]\w*", annotation)):
        if word in _ANYWHERE:
            imports.add(_ANYWHERE[word])
            continue
        found = vars(room).get(word) or _of_rooms(word, room.__name__.rpartition(".")[0])
        if inspect.isclass(found) and found.__module__ != "builtins":
            imports.add(f"from {_public(found)} import {word} as {word}")
        elif found is not None and not inspect.isclass(found):
            imports.add(f"from {_holder(word, room)} import {word} as {word}")


def _of_rooms(word: str, home: str):
    """A type that a function names but does not import (a field's, of a dataclass elsewhere).

    home: the room of the function, which has the first word.
    """
    near = [module for name, module in sorted(sys.modules.items()) if name.startswith(home)]
    rest = (registry.room(one) for one in ("adjustment", "effects", "block", "simulation"))
    rooms = (*near, *rest)
    return next((vars(room)[word] for room in rooms if word in vars(room)), None) or next(
        (
            vars(module)[word]
            for name, module in sorted(sys.modules.items())
            if name.startswith("corridor.") and word in vars(module)
        ),
        None,
    )


def _holder(word: str, room) -> str:
    """The module that defines what is no class (an alias of types)."""
    if word in vars(room):
        return room.__name__
    return next(
        name
        for name, module in sorted(sys.modules.items())
        if name.startswith("corridor.") and word in vars(module)
    )


def _public(kind: type) -> str:
    """The room that offers a type, or its module."""
    parts = kind.__module__.split(".")
    for n in range(2, len(parts)):
        room = sys.modules.get(".".join(parts[:n]))
        if room is not None and vars(room).get(kind.__name__) is kind:
            return room.__name__
    return kind.__module__


if __name__ == "__main__":
    STUB.write_text(text(), encoding="utf-8", newline="\n")
