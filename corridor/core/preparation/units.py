"""The unit of coordinates, of one axis alone too, as where the same points are seen shows it."""

from collections.abc import Callable

import numpy as np

from corridor.core.errors import InputError
from corridor.core.geometry import similarity

# Units that lengths are given in by mistake, m; a ratio this near to theirs is taken for it.
UNITS_M = {"feet": 0.3048, "centimetres": 1e-2, "millimetres": 1e-3, "kilometres": 1e3}
_OF_UNIT = 0.02
# A decimal point that is moved by one place; only a shape tells it from another height system.
_BY_SHAPE_M = UNITS_M | {"decimetres": 0.1, "tens of metres": 10.0}
LARGE_UNITS = "kilometres", "tens of metres"
# What is read in a unit; the most usual first, where two fit.
_READ = {"{} is in {}": "xyz", "Heights of {} are in {}": "z", "x of {} is in {}": "x",
         "y of {} is in {}": "y", "x and y of {} are in {}": "xy"}  # fmt: skip


def unit_of(ratio: float) -> str:
    """The unit whose numbers are so many times those in metres; empty where it is none."""
    return next((unit for unit, m in UNITS_M.items() if abs(ratio * m - 1.0) < _OF_UNIT), "")


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """How far points (n, 3) lie (median) from others, but for one vector."""
    away = one - other
    return float(np.median(np.linalg.norm(away - np.median(away, axis=0), axis=1)))


def apart_in_shape(one: np.ndarray, other: np.ndarray) -> float:
    """How far points (n, 3) lie (median) from others, but for a similarity, as a share of how far
    they lie from their middle; inf of a line."""
    try:
        off = similarity(other, one).apply(other) - one
    except InputError:
        return np.inf
    wide = np.median(np.linalg.norm(one - np.median(one, axis=0), axis=1))
    return float(np.median(np.linalg.norm(off, axis=1)) / wide) if wide else np.inf


def other_unit(
    file: str, given: np.ndarray, seen: np.ndarray, share: float, left: Callable = apart,
    of_nothing: float | None = None,
) -> str:  # fmt: skip
    """Which axes of points (n, 3) of a file are in which unit, beside where they are seen, (n, 3)
    in metres; empty where they are in metres.

    share: read so, they lie apart by less than this share of what they do as they are given, and of
    what is left where these axes say nothing: a small unit leaves hardly anything of them, which
    is as near to points of any kind (of_nothing: another share of it). left: `apart`, or
    `apart_in_shape` where the points are seen in a frame of any place and scale.
    """
    most, found = share * left(given, seen), ""
    # In a frame of any scale, one axis in small units is the same as the others in large ones, and
    # what a large one makes long and thin fits any other line.
    one_axis = left is apart_in_shape
    for words, names in _READ.items():
        if one_axis and len(names) > 1:
            continue
        axes = np.array([name in names for name in "xyz"])
        nothing = np.where(axes, np.median(given, axis=0), given)
        limit = min(most, (share if of_nothing is None else of_nothing) * left(nothing, seen))
        for unit, metres in _BY_SHAPE_M.items():
            if one_axis and unit in LARGE_UNITS:
                continue
            read = left(np.where(axes, metres, 1.0) * given, seen)
            if read < limit:
                most = limit = read
                found = words.format(file, unit)
    return found
