"""Numbers in rows of tracks, with messages that name file, row and remedy."""

import math
from functools import partial
from pathlib import Path

from corridor import textfile
from corridor.errors import InputError

# A row is a line of the file, the first is row 1.
number = partial(textfile.number, count="row")


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
