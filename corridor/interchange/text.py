"""Text files of other programs, with messages that name file, line and remedy."""

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from corridor.errors import InputError

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def lines(path: Path, size: int = 0, passed: int = 0) -> Iterator[tuple[int, str]]:
    """Number (from 1) and text of every line, without its end; CR LF, CR and LF may be mixed.

    UTF-8 with or without byte order mark, or UTF-16 with one. size, passed: the bytes and lines at
    its beginning that are left out.
    Raises InputError where the file cannot be read or is no text.
    """
    number = passed
    try:
        with path.open("rb") as file:
            start = file.read(2)
        encoding = "utf-16" if start in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        with path.open(encoding=encoding) as file:
            file.seek(size)
            for number, line in enumerate(file, start=passed + 1):
                if "\0" in line:
                    raise InputError(f"{path.name}, line {number}: this is no text; name a text")
                yield number, line.rstrip("\n")
    except UnicodeError:
        raise InputError(
            f"{path.name}, line {number + 1}: the text is not UTF-8; save the file as UTF-8"
        ) from None
    except OSError as error:
        raise missing(path, error) from error


def missing(path: Path, error: OSError) -> InputError:
    """The sentence for a file that is not there or cannot be read."""
    if isinstance(error, FileNotFoundError):
        return InputError(f"{path} is missing; put it there or name the whole project")
    return InputError(f"{path} cannot be read ({error.strerror or error}); correct the path")


def number(text: str, path: Path, line: int, what: str) -> float:
    """A finite number. Raises InputError naming file, line and what it should be."""
    try:
        value = float(text)
    except (ValueError, OverflowError):
        value = math.nan
    if math.isfinite(value) and "_" not in text:
        return value
    raise wrong_number(text, path, line, what)


def wrong_number(text: str, path: Path, line: int, what: str) -> InputError:
    """The sentence for text that is no finite number."""
    if _DECIMAL_COMMA.fullmatch(text):
        return InputError(
            f"{path.name}, line {line}: {what} = {text!r} has a decimal comma; write numbers with "
            "a decimal point"
        )
    return InputError(
        f"{path.name}, line {line}: {what} = {text[:40]!r} is not a finite number; export the "
        "project again or correct the line"
    )


def numbers(words: list[str], path: Path, line: int, what: str) -> np.ndarray:
    """float64 of words, all finite. Raises InputError naming the first that is no number."""
    try:
        values = np.array(words, dtype=float)
    except (ValueError, OverflowError):
        values = None
    if values is None or not np.isfinite(values).all() or any("_" in word for word in words):
        for word in words:
            number(word, path, line, what)
    return values


def whole(text: str, path: Path, line: int, what: str, least: int = 0) -> int:
    """A whole number from `least`. Raises InputError where it is none."""
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or "_" in text or value >= 2**63:
        raise InputError(
            f"{path.name}, line {line}: {what} = {text[:40]!r} is not a whole number from {least}; "
            "export the project again or correct the line"
        )
    return value


def opening(path: Path, size: int = 4096) -> str:
    """The first characters of a file, whatever it is: for telling formats apart."""
    try:
        with path.open("rb") as file:
            data = file.read(size)
    except OSError:
        return ""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace").lstrip("\ufeff")
    return data.decode("utf-8-sig", errors="replace")


def beginning(path: Path, pattern: str, start: str) -> Path | None:
    """The file if it begins so, or the first such file of a folder among those of a pattern."""
    files = [path] if path.is_file() else sorted(path.glob(pattern))
    return next((file for file in files if opening(file, 64).startswith(start)), None)
