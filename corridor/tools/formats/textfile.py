"""Text, XML and JSON of projects: lines one after the other, values that know where they stand.

`Json` is a piece of a file as `Line` and `Xml` of `corridor.core.textfile` are.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from corridor.core.errors import InputError
from corridor.core.textfile import UTF16, Line, is_number, lines, read_bytes, unpacked


def says_number(word: str) -> bool:
    """Whether a word is a number, finite or not."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def filled(path: Path, comment: str | tuple[str, ...] = "") -> Iterator[Line]:
    """The lines that are not blank, nor begin with `comment`."""
    return Following(path, comment).rest()


class Following:
    """Lines with something on them, one after the other; the end is told with the place.

    last: number of the line that was read last. comment: what begins a line that says nothing.
    """

    def __init__(self, path: Path, comment: str | tuple[str, ...] = ""):
        self.path, self.last, self._comment, self._lines = path, 0, comment, lines(path)

    def next(self, what: str) -> Line:
        """The next line. Raises InputError where the file ends before."""
        for line in self.rest():
            return line
        raise Line(self.path, self.last, "").wrong(
            f"the file ends where {what} should follow; it is cut off or its counts are wrong"
        )

    def values(self, count: int, what: str) -> np.ndarray:
        """The `count` numbers of the next line."""
        return self.next(what).values(count, what)

    def pass_by(self, size: int, count: int) -> None:
        """Go on after that many bytes of the file, `count` lines further."""
        self.last += count
        self._lines = lines(self.path, size, self.last)

    def comments(self) -> Iterator[Line]:
        """The comments that come next."""
        for line in self._lines:
            if not line.text.startswith(self._comment):
                self._lines = chain([line], self._lines)
                return
            self.last = line.at
            yield line

    def rest(self) -> Iterator[Line]:
        """The lines that are left."""
        for line in self._lines:
            self.last = line.at
            text = line.text.lstrip()
            if text and not (self._comment and text.startswith(self._comment)):
                yield line


def opening(path: Path, size: int = 4096) -> str:
    """The first characters of a file, whatever it is, packed or not: for telling formats apart."""
    try:
        with unpacked(path) as file:
            data = file.read(size)
    except (OSError, EOFError):
        return ""
    if data.startswith(UTF16):
        return data.decode("utf-16", errors="replace").lstrip("\ufeff")
    return data.decode("utf-8-sig", errors="replace")


def beginning(path: Path, pattern: str, start: str) -> Path | None:
    """The file if it begins so, or the first such file of a folder among those of a pattern."""
    files = [path] if path.is_file() else sorted(path.glob(pattern))
    return next((file for file in files if opening(file, 64).startswith(start)), None)


def add_xml(
    parent: ElementTree.Element, tag: str, *found: str | float, **attributes: str | float
) -> ElementTree.Element:
    """A new element with text (numbers with all digits, a blank between them) and attributes."""
    shown = {key: _shown(value) for key, value in attributes.items()}
    element = ElementTree.SubElement(parent, tag, shown)
    if found:
        element.text = " ".join(map(_shown, found))
    return element


def _shown(value):
    return value if isinstance(value, str) else repr(float(value))


def write_xml(root: ElementTree.Element, path: Path) -> None:
    """Write an XML file."""
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """An object of JSON. Raises InputError where it has a name twice: one would be lost."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"{twice!r} stands twice in one object of the JSON, of which only one could be read; "
            "give each a name of its own"
        )
    return found


class Json:
    """A value of a JSON file, and where it stands."""

    __slots__ = ("value", "where")

    def __init__(self, value, where: str):
        self.value, self.where = value, where

    @classmethod
    def read(cls, path: Path) -> Json:
        """What a JSON file holds. Raises InputError naming file and line."""
        data = read_bytes(path)
        try:
            text = data.decode("utf-16" if data[:2] in UTF16 else "utf-8-sig")
            return cls(json.loads(text, object_pairs_hook=_once), path.name)
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise Line(path, line, "").wrong("not UTF-8; save the file as UTF-8") from None
        except json.JSONDecodeError as error:
            raise Line(path, error.lineno, "").wrong(
                f"the JSON is broken or ends early ({error.msg}); export the project again"
            ) from None
        except RecursionError:
            raise InputError(
                f"{path.name} is nested without end; export the project again"
            ) from None

    def wrong(self, sentence: str) -> InputError:
        """The error that names file and place before the sentence."""
        return InputError(f"{self.where} {sentence}; export the project again")

    def get(self, key: str) -> object:
        """What an object holds under a key; None where it does not, or is no object."""
        return self.value.get(key) if isinstance(self.value, dict) else None

    def at(self, key: str | int, kind: str = "") -> Json:
        """The value of a key of an object, of a row of a list."""
        name = f"{kind} {key!r}" if kind else str(key)
        return Json(self.value[key], f"{self.where}: {name}")

    def objects(self, key: str, kind: str = "") -> dict[str, Json]:
        """The members of the object under a key. Raises InputError where there is none."""
        if not isinstance(self.get(key), dict):
            raise self.wrong(f"has no {key}")
        inner = Json(self.value[key], self.where)
        return {name: inner.at(name, kind or key) for name in inner.value}

    def rows(self, key: str, kind: str) -> list[Json]:
        """The rows of the list under a key. Raises InputError where there is none."""
        found = self.get(key)
        if not isinstance(found, list):
            raise self.wrong(f"has no list of {key}")
        return [Json(row, f"{self.where}: {kind} {k}") for k, row in enumerate(found, start=1)]

    def text(self, key: str) -> str:
        """The text under a key. Raises InputError where there is none."""
        if not isinstance(self.get(key), str):
            raise self.wrong(f"has no {key}")
        return self.value[key]

    def number(self, key: str, default: float | None = None) -> float:
        """The finite number under a key. Raises InputError naming the place."""
        value = self.get(key)
        value = default if value is None and isinstance(self.value, dict) else value
        if is_number(value):
            return float(value)
        raise self.wrong(f"has no number {key}" + f" ({value!r})" * (value is not None))

    def numbers(self, key: str, count: int) -> np.ndarray:
        """The `count` finite numbers under a key, also as text or in lists of lists.

        Raises InputError naming the place.
        """
        try:
            found = np.array(self.get(key), dtype=float).ravel()
        except (TypeError, ValueError, OverflowError):
            found = np.zeros(0)
        if len(found) == count and np.isfinite(found).all():
            return found
        raise InputError(
            f"{self.where}: {key} is not {count} finite numbers; export the project again"
        )
