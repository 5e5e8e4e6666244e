"""Lines and numbers of text files, with messages that name file, row and remedy.

A row is a line of the file, the first is row 1.
"""

import gzip
import math
import re
from pathlib import Path

from corridor.errors import InputError

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def read_lines(path: Path) -> list[str]:
    """Lines of a text file without line ends; also of one packed by gzip (.gz).

    UTF-8, or UTF-16 with a byte order mark; what is neither is read as Latin-1, which can only
    happen in comments and names.
    Raises InputError where the file cannot be read or is no text.
    """
    try:
        data = path.read_bytes()
        if data.startswith(b"\x1f\x8b"):
            data = gzip.decompress(data)
    except (OSError, EOFError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path.name} cannot be read ({reason}); correct the path") from error
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        raise InputError(f"{path.name} is not a text file; name a track or image times as text")
    return re.split(r"\r\n|\n|\r", text.rstrip("\r\n"))


def number(text: str, path: Path, row: int, what: str) -> float:
    """A finite number. Raises InputError naming file, row and `what` where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isfinite(value) and "_" not in text:
        return value
    if _DECIMAL_COMMA.fullmatch(text):
        raise InputError(
            f"{path.name}, row {row}: {what} = {text!r} has a decimal comma; write numbers with a "
            "decimal point"
        )
    raise InputError(
        f"{path.name}, row {row}: {what} = {text!r} is not a number; correct it or delete the row"
    )


def sigma(text: str, path: Path, row: int, what: str) -> float:
    """A standard deviation; NaN where a program wrote `nan`, or a negative number for unknown."""
    if text.lower().lstrip("+-") == "nan":
        return math.nan
    value = number(text, path, row, what)
    return value if value >= 0 else math.nan


def degrees(parts: list[str], path: Path, row: int, what: str) -> float:
    """Degrees of one decimal number, or of degrees, minutes and seconds (the sign on the first)."""
    values = [number(part, path, row, what) for part in parts]
    if len(values) == 1:
        return values[0]
    if any(not 0 <= value < 60.000001 for value in values[1:]):
        raise InputError(
            f"{path.name}, row {row}: {what} = {' '.join(parts)!r} is not degrees, minutes and "
            "seconds; correct it or delete the row"
        )
    size = abs(values[0]) + values[1] / 60 + values[2] / 3600
    # The sign of "-0 12 30" is in the text only.
    return -size if parts[0].lstrip().startswith("-") else size
