"""Results as one line: names and numbers as they are, arrays and tables by their size."""

from collections.abc import Iterable, Mapping, Sized
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

_MOST = 60  # characters of one value
_MOST_TOGETHER = 300
Kind = TypeVar("Kind", bound=type)


def brief(kind: Kind) -> Kind:
    """Decorator above `dataclass`: a repr of one short line, whatever the fields hold."""

    def shown(self: Any) -> str:
        parts, length = [], 0
        for one in fields(self):
            if one.repr and length < _MOST_TOGETHER:
                parts.append(f"{one.name}={in_words(getattr(self, one.name))}")
                length += len(parts[-1])
        more = ", ..." if length >= _MOST_TOGETHER else ""
        return f"{type(self).__name__}({', '.join(parts)}{more})"

    kind.__repr__ = shown  # type: ignore[method-assign, assignment]
    return kind


def in_words(value: Any) -> str:
    """A value within a line: itself where it is short, else what it is and how large."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        what = "table" if hasattr(value, "columns") else "array"
        return f"<{what} {' x '.join(str(size) for size in shape)}>"
    if isinstance(value, float):
        return f"{value:.6g}"
    if is_dataclass(value) and not isinstance(value, type):
        return f"<{type(value).__name__}>"
    if isinstance(value, Mapping) or (isinstance(value, Iterable) and not isinstance(value, str)):
        # What is in it may be anything: its repr is asked for only where it is short.
        size = len(value) if isinstance(value, Sized) else None
        if size is None or size > 6 or not all(_plain(one) for one in _flat(value)):
            return f"<{type(value).__name__}{'' if size is None else f' of {size}'}>"
    text = repr(value)
    return text if len(text) <= _MOST else f"{text[: _MOST - 3]}..."


def _flat(value: Any) -> list:
    return [*value, *value.values()] if isinstance(value, Mapping) else list(value)


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)
