"""A series of pictures of a static camera: FOLDER/series.csv and the pictures it names."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from corridor.brief import brief
from corridor.errors import InputError

TABLE = "series.csv"
_COLDEST_C, _HOTTEST_C = -90.0, 150.0
_LEAST = 160  # px: a smaller picture has no room for windows


@brief
@dataclass(frozen=True)
class Series:
    """Pictures with their times and temperatures, rows as in series.csv.

    picture: names. time_s: s. temperature_c: C, NaN where unknown. reference: bool.
    """

    folder: Path
    picture: list[str]
    time_s: np.ndarray
    temperature_c: np.ndarray
    reference: np.ndarray

    def read(self, row: int) -> np.ndarray:
        """The picture of a row (height, width), grey values 0 to 255, float32, as stored.

        Raises InputError where it cannot be read whole.
        """
        return read_picture(self.folder / self.picture[row])

    def check_sizes(self) -> None:
        """Raises InputError where a picture is not of the first one's size, or is none at all."""
        first = None
        for name in self.picture:
            try:
                with Image.open(self.folder / name) as picture:
                    size = picture.size[::-1]
            except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
                raise _unreadable(self.folder / name, error) from error
            first = size if first is None else first
            if size != first:
                raise another_size(self.folder / name, size, first)

    def fingerprint(self) -> str:
        """What tells this series from another, or from itself after a change."""
        mark = hashlib.sha256((self.folder / TABLE).read_bytes())
        for name in self.picture:
            facts = (self.folder / name).stat()
            mark.update(f"{name} {facts.st_size} {facts.st_mtime_ns}\n".encode())
        return mark.hexdigest()


def read_series(folder: str | os.PathLike) -> Series:
    """The table of a series; its pictures are read when they are needed.

    Raises InputError, one sentence naming row and remedy.
    """
    folder = Path(folder)
    path = folder / TABLE
    if not path.is_file():
        raise InputError(
            f"{folder} has no {TABLE}: write one with the columns picture, time_s, temperature_c, "
            "reference"
        )
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig")
    except (ValueError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not a table that can be read: {error}") from error
    table.columns = [str(name).strip() for name in table.columns]
    for column in ("picture", "time_s", "reference"):
        if column not in table:
            raise InputError(f"{path} has no column {column}: add it")
    if not len(table):
        raise InputError(f"{path} has no row: write one for each picture")
    names = [text.strip() for text in table["picture"]]
    for row, name in enumerate(names):
        if not name:
            raise InputError(f"{path}, row {row + 2}: no picture is named: name a file of {folder}")
        if names.index(name) != row:
            raise InputError(
                f"{path}, row {row + 2}: picture {name} is there twice: leave one row out"
            )
        if not (folder / name).is_file():
            raise InputError(
                f"{path}, row {row + 2}: there is no picture {name} in {folder}: correct the name"
            )
    time = _numbers(table["time_s"], path, "time_s")
    if np.isnan(time).any():
        row = int(np.flatnonzero(np.isnan(time))[0])
        raise InputError(f"{path}, row {row + 2}: time_s is empty: give seconds")
    warm = np.full(len(table), np.nan)
    if "temperature_c" in table:
        warm = _numbers(table["temperature_c"], path, "temperature_c")
        wrong = np.flatnonzero((warm < _COLDEST_C) | (warm > _HOTTEST_C))
        if len(wrong):
            raise InputError(
                f"{path}, row {wrong[0] + 2}: temperature_c = {warm[wrong[0]]:g} is none that a "
                "camera stands: give degrees Celsius"
            )
    reference = _numbers(table["reference"], path, "reference")
    wrong = np.flatnonzero(~np.isin(reference, (0.0, 1.0)) & ~np.isnan(reference))
    if len(wrong):
        raise InputError(
            f"{path}, row {wrong[0] + 2}: reference = {table['reference'].iloc[wrong[0]]}: "
            "write 1 for a picture of the reference, 0 for any other"
        )
    if np.isnan(reference).any():
        row = int(np.flatnonzero(np.isnan(reference))[0])
        raise InputError(
            f"{path}, row {row + 2}: reference is empty: write 1 for a picture of the reference, 0 "
            "for any other"
        )
    reference = reference == 1.0
    if not reference.any():
        raise InputError(f"{path}: no picture is the reference: write 1 for one or more")
    return Series(folder, names, time, warm, reference)


def _numbers(column, path, name):
    out = np.full(len(column), np.nan)
    for row, text in enumerate(column):
        if not text.strip():
            continue
        try:
            out[row] = float(text)
        except ValueError:
            out[row] = np.inf
        if not np.isfinite(out[row]):
            if text.strip().lower() == "nan":
                out[row] = np.nan
                continue
            raise InputError(f"{path}, row {row + 2}: {name} = {text} is not a number: correct it")
    return out


def read_picture(path: str | os.PathLike) -> np.ndarray:
    """Grey values (height, width) float32, 0 to 255, of a picture as it is stored.

    Raises InputError where it cannot be read, is cut off, or is too small.
    """
    try:
        with Image.open(path) as picture:
            picture.load()
            if picture.mode in ("L", "I", "F") or picture.mode.startswith("I;16"):
                grey = np.asarray(picture, dtype=np.float32)
                if picture.mode != "L" and grey.max(initial=0.0) > 255:
                    grey = grey / np.float32(257)
            else:
                colours = np.asarray(picture.convert("RGB"), dtype=np.float32)
                grey = colours @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise _unreadable(path, error) from error
    if min(grey.shape) < _LEAST:
        raise InputError(
            f"{path} has {grey.shape[1]} x {grey.shape[0]} pixels, too few for windows: give "
            f"pictures of {_LEAST} x {_LEAST} or more"
        )
    return grey


def another_size(name: object, size: tuple[int, int], first: tuple[int, int]) -> InputError:
    """What to say of a picture (height, width) that is not of the others' size."""
    return InputError(
        f"{name} has {size[1]} x {size[0]} pixels, the others {first[1]} x {first[0]}: pictures of "
        "a series have one size, leave its row out"
    )


def _unreadable(path, error):
    return InputError(
        f"{path} cannot be read as a picture, or is cut off ({error}): copy it again or leave its "
        "row out"
    )
