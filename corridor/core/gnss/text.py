"""Rows of text files as fields, with messages that name file, row and remedy."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from corridor.core import textfile
from corridor.core.errors import InputError


class TextRows:
    """Rows of a file as lists of fields.

    at (n,): the line of the file that each is, from 1. of: said after that number in messages.
    """

    def __init__(self, path: Path, rows: Iterable[tuple[int, list[str]]], of: str = ""):
        rows = list(rows)
        self.path, self.of = path, of
        self.at = np.array([at for at, _ in rows], dtype=int)
        self.fields = [fields for _, fields in rows]

    @classmethod
    def of_lines(
        cls,
        path: Path,
        lines: list[str],
        after: int = 0,
        skip: tuple[str, ...] = (),
        split: Callable[[str], list[str]] = str.split,
    ) -> "TextRows":
        """Of the lines after so many that are not blank, nor begin with one of `skip`."""
        every = enumerate(lines[after:], after + 1)
        filled = ((at, line) for at, line in every if line.strip() and not line.startswith(skip))
        return cls(path, ((at, split(line)) for at, line in filled))

    def __len__(self) -> int:
        return len(self.fields)

    def wrong(self, k: int, sentence: str) -> InputError:
        """The error that names file and row before the sentence."""
        return InputError(f"{self.path.name}, row {self.at[k]}{self.of}: {sentence}")

    def expect(self, width: int, whose: str, remedy: str, more: bool = False) -> None:
        """Raise InputError at the first row that has not `width` fields (more: at least)."""
        for k, fields in enumerate(self.fields):
            if len(fields) < width or (len(fields) > width and not more):
                raise self.wrong(k, f"{len(fields)} fields where {whose} has {width}; {remedy}")

    def texts(self, field: int) -> list[str]:
        """A field of every row."""
        return [fields[field] for fields in self.fields]

    def numbers(self, field: int, what: str, unknown: bool = False) -> np.ndarray:
        """(n,) of a field; unknown: NaN where a program wrote `nan`."""
        return np.array(
            [
                math.nan
                if unknown and text.lower().lstrip("+-") == "nan"
                else number(text, self.path, at, what)
                for text, at in zip(self.texts(field), self.at, strict=True)
            ]
        )

    def sigmas(self, field: int, what: str) -> np.ndarray:
        """(n,) of a field; NaN also where a program wrote a negative number for unknown."""
        found = self.numbers(field, what, unknown=True)
        return np.where(found >= 0, found, np.nan)

    def degrees(self, first: int, last: int, what: str) -> np.ndarray:
        """(n,) of one field, or of degrees, minutes and seconds in three."""
        return np.array(
            [
                degrees(fields[first:last], self.path, at, what)
                for fields, at in zip(self.fields, self.at, strict=True)
            ]
        )


def number(text: str, path: Path, row: int, what: str) -> float:
    """A finite number. Raises InputError naming file and row."""
    return textfile.number(text, path, row, what, count="row")


def degrees(parts: list[str], path: Path, row: int, what: str) -> float:
    """Degrees of one decimal number, or of degrees, minutes and perhaps seconds (the sign on the
    first)."""
    values = [number(part, path, row, what) for part in parts]
    if len(values) == 1:
        return values[0]
    if any(not 0 <= value < 60.000001 for value in values[1:]):
        raise InputError(
            f"{path.name}, row {row}: {what} = {' '.join(parts)!r} is not degrees, minutes and "
            "seconds; correct it or delete the row"
        )
    size = abs(values[0]) + sum(value / 60**k for k, value in enumerate(values[1:], 1))
    # The sign of "-0 12 30" is in the text only.
    return -size if parts[0].lstrip().startswith("-") else size
