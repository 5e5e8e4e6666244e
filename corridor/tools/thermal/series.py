"""A series of pictures of a static camera: FOLDER/series.csv and the pictures it names."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from corridor.core.block import Layout, place, read_columns
from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.photographs import FAULTS, fault, open_picture

TABLE = "series.csv"
_COLUMNS = Layout(("time_s", "reference"), ("temperature_c",), empty=("time_s", "reference"))
COLDEST_C, HOTTEST_C = -90.0, 150.0
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
                with open_picture(self.folder / name) as picture:
                    size = picture.size[::-1]
            except FAULTS as error:
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
    if folder.is_file():
        raise InputError(f"{folder} is a file; give the folder of the pictures and of {TABLE}")
    if not path.is_file():
        raise InputError(
            f"{folder} has no {TABLE}: write one with the columns picture, time_s, temperature_c, "
            "reference"
        )
    table = read_columns(path, _COLUMNS)
    if "picture" not in table:
        raise InputError(f"{path} has no column picture: add it")
    if not len(table):
        raise InputError(f"{path} has no row: write one for each picture")
    names = [text.strip() for text in table["picture"].fillna("")]
    time, reference = (table[name].to_numpy(float) for name in ("time_s", "reference"))
    warm = np.full(len(table), np.nan)
    if "temperature_c" in table:
        warm = table["temperature_c"].to_numpy(float)

    remedy = "write 1 for a picture of the reference, 0 for any other"
    checks = (
        ([not name for name in names], lambda row: f"no picture is named: name a file of {folder}"),
        (
            [names.index(name) != row for row, name in enumerate(names)],
            lambda row: f"picture {names[row]} is there twice: leave one row out",
        ),
        (
            [not (folder / name).is_file() for name in names],
            lambda row: f"there is no picture {names[row]} in {folder}: correct the name",
        ),
        (np.isnan(time), lambda row: "time_s is empty: give seconds"),
        (
            (warm < COLDEST_C) | (warm > HOTTEST_C),
            lambda row: (
                f"temperature_c = {warm[row]:g} is outside what a camera endures: give degrees "
                "Celsius"
            ),
        ),
        (np.isnan(reference), lambda row: f"reference is empty: {remedy}"),
        (~np.isin(reference, (0.0, 1.0)), lambda row: f"reference = {reference[row]:g}: {remedy}"),
    )
    for wrong, said in checks:
        if np.any(wrong):
            row = int(np.argmax(wrong))
            raise InputError(f"{folder / place(path, row)}: {said(row)}")
    if not reference.any():
        raise InputError(f"{path}: no picture is the reference: write 1 for one or more")
    return Series(folder, names, time, warm, reference == 1.0)


def read_picture(path: str | os.PathLike) -> np.ndarray:
    """Grey values (height, width) float32, 0 to 255, of a picture as it is stored.

    Raises InputError where it cannot be read, is cut off, or is too small.
    """
    try:
        with open_picture(path) as picture:
            picture.load()
            if picture.mode in ("L", "I", "F") or picture.mode.startswith("I;16"):
                grey = np.asarray(picture, dtype=np.float32)
                if picture.mode != "L" and grey.max(initial=0.0) > 255:
                    grey = grey / np.float32(257)
            else:
                colours = np.asarray(picture.convert("RGB"), dtype=np.float32)
                grey = colours @ np.array([0.299, 0.587, 0.114], dtype=np.float32)
    except FAULTS as error:
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
        f"{path} cannot be read as a picture, or is cut off ({fault(error)}): copy it again or "
        "leave its row out"
    )
