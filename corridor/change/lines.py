"""Lines and polygons from a table."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.errors import InputError


def read_line(path: str | os.PathLike) -> np.ndarray:
    """Corners (n, 2), m, of a CSV file with the columns x and y, in its order.

    Raises InputError where the file is missing or is no such table.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give a CSV table with x and y")
    try:
        table = pd.read_csv(path)
        corners = table[["x", "y"]].to_numpy(float)
    except (KeyError, ValueError, pd.errors.ParserError):
        raise InputError(f"{path}: no table with the columns x and y, numbers in metres") from None
    wrong = np.flatnonzero(~np.isfinite(corners).all(axis=1))
    if len(wrong):
        raise InputError(f"{path}, row {wrong[0] + 2}: x and y have to be numbers")
    if len(corners) < 2:
        raise InputError(f"{path}: {len(corners)} corners are no line; give two or more")
    return corners
