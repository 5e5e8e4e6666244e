"""What a block must fulfil before anything is computed from it.

Every check runs over whole columns; the row is looked for only where one fails. What depends on
the adjustment (a point seen once, an image with too few points) is judged there.
"""

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from corridor.block.settings import FILE, SIGMA
from corridor.block.tables import (
    LAYOUTS,
    NAMES,
    POSE,
    QUATERNION,
    RATES,
    ROLES,
    SIGMAS,
    VELOCITY,
    arrow,
    is_among,
    some,
)
from corridor.errors import InputError

_PART = 1 << 20  # rows that are looked at together


def check(block, observed: bool = True) -> None:
    """Raise InputError, one sentence with file, row and remedy, for the first fault.

    observed: whether a block without observations is one.
    """
    _settings(block)
    for table in LAYOUTS:
        _names(block, table)
        _numbers(block, table)
    _images(block)
    if observed and not len(block.tie_points) and not len(block.marks):
        raise InputError(
            "tie_points.csv and marks.csv: neither holds an observation; add rows to one of them"
        )
    for table in ("tie_points", "marks"):
        _observations(block, table)
    _points_are_one_kind(block)
    for table in ("points", "ground"):
        _once(block, table, "point")
    _triple(block, "points", ("x", "y", "z"), "the position")
    _ground(block)
    _known_images(block, "gnss")
    _once(block, "gnss", "image")
    if "image" in block.rates:
        _known_images(block, "rates")
    _epochs(block, "rates", ("flight", "image"))
    _epochs(block, "track", ("flight",))
    _triple(block, "track", VELOCITY, "the velocity")
    _lever_arms(block)


def _fail(block, table: str, row: int, fault: str, remedy: str) -> None:
    raise InputError(f"{block.where(table, row)}: {fault}; {remedy}")


def _first(mask: np.ndarray | pd.Series) -> int | None:
    mask = np.asarray(mask)
    return int(mask.argmax()) if mask.any() else None


def _settings(block) -> None:
    if not block.cameras:
        raise InputError(
            f"{FILE}: there is no camera; add a table [camera.NAME] with width, height and f"
        )
    if not isinstance(block.name, str) or not block.name.strip():
        raise InputError(f'{FILE}: the block has no name; write name = "..."')
    for key in SIGMA:
        value = np.asarray(block.sigma[key], dtype=float)
        if not (np.isfinite(value).all() and (value > 0).all()):
            raise InputError(
                f"{FILE}: [sigma] {key} is not positive; write a standard deviation above 0"
            )
    if block.offset.shape != (3,) or not np.isfinite(block.offset).all():
        raise InputError(f"{FILE}: offset is not three numbers; write offset = [x, y, z]")


def _names(block, table: str) -> None:
    """Needed names are there, and no name has blanks around it."""
    frame, layout = getattr(block, table), LAYOUTS[table]
    if not len(frame):
        return
    for name in layout.listed:
        if name not in NAMES or name not in frame:
            continue
        column = frame[name]
        coded = isinstance(column.dtype, pd.CategoricalDtype)
        codes = column.array.codes if coded else None
        values = arrow(column.dtype.categories if coded else column)
        if name in layout.needed:
            row = _first(codes < 0 if coded else pc.is_null(values))
            if row is None and not coded:
                row = _first(pc.equal(values, ""))
            if row is not None:
                _fail(block, table, row, f"{name} is empty", "fill it in or delete the row")
        bare = pc.utf8_trim_whitespace(values)
        if not bare.equals(values):
            blank = np.asarray(pc.fill_null(pc.not_equal(bare, values), False))
            row = _first(blank[codes] & (codes >= 0) if coded else blank)
            if row is not None:
                value = f"{name} {str(column.iloc[row])!r} has blanks around it"
                _fail(block, table, row, value, "take them away")


def _numbers(block, table: str) -> None:
    """Needed numbers are there, all are finite, and standard deviations are positive."""
    frame, layout = getattr(block, table), LAYOUTS[table]
    if not len(frame):
        return
    for name in layout.numbers:
        if name not in frame:
            continue
        values = frame[name].to_numpy()
        row = _first(np.isinf(values))
        if row is not None:
            _fail(block, table, row, f"{name} is infinite", "write a number")
        if name in layout.needed and name not in layout.empty:
            row = _first(np.isnan(values))
            if row is not None:
                _fail(block, table, row, f"{name} is empty", "write a number or delete the row")
        if name == "sigma" or name in SIGMAS:
            row = _first(values <= 0)
            if row is not None:
                fault = f"{name} = {values[row]:g} is not a standard deviation"
                _fail(block, table, row, fault, "write a positive number or leave the cell empty")


def _images(block) -> None:
    images = block.images
    if not len(images):
        raise InputError("images.csv: it names no image; add one row for each image")
    _once(block, "images", "image")
    row = _first(~is_among(images["camera"], list(block.cameras)))
    if row is not None:
        name = images["camera"].iloc[row]
        _fail(
            block,
            "images",
            row,
            f"camera {name!r} is not in {FILE}",
            f"add a table [camera.{name}] there or correct the name ({some(block.cameras)})",
        )
    _triple(
        block,
        "images",
        POSE,
        "the pose",
        "give x, y, z and qw, qx, qy, qz or none of them (antenna positions go into gnss.csv)",
    )
    _triple(block, "images", VELOCITY, "the velocity")
    _triple(block, "images", RATES, "the angular rate")
    if set(QUATERNION) <= set(images.columns):
        length = np.linalg.norm([images[name].to_numpy() for name in QUATERNION], axis=0)
        row = _first(length == 0)
        if row is not None:
            fault = "the quaternion qw, qx, qy, qz has length zero"
            _fail(block, "images", row, fault, "give a unit quaternion or leave the pose empty")
        row = _first(np.abs(length - 1) > 0.01)
        if row is not None:
            fault = f"the quaternion qw, qx, qy, qz has length {length[row]:.6g}"
            _fail(block, "images", row, fault, "give a unit quaternion or leave the pose empty")
    _clock(block)


def _clock(block) -> None:
    """A camera does not take two images of one flight at once, whatever the other cameras do."""
    time = block.column("images", "time_s")
    known = np.flatnonzero(~np.isnan(time))
    if len(known) < 2 or np.ptp(time[known]) > 0:
        return
    row = _first(block.images.iloc[known].duplicated("camera"))
    if row is not None:
        _fail(
            block,
            "images",
            int(known[row]),
            f"time_s = {time[known[row]]:g} stands still, it is the same in every image",
            "write the times of exposure or leave the cells empty",
        )


def _observations(block, table: str) -> None:
    frame = getattr(block, table)
    if not len(frame):
        return
    _known_images(block, table)

    def keys(first: int = 0, last: int | None = None) -> np.ndarray:
        image = frame["image"].array
        key = frame["point"].array.codes[first:last].astype(np.int64)
        key *= len(image.categories)
        key += image.codes[first:last]
        return key

    # Most files are in order, which a part of the rows after another shows.
    parts = (keys(first, first + _PART + 1) for first in range(0, len(frame), _PART))
    if all((key[1:] > key[:-1]).all() for key in parts):
        return
    # Sorting in place takes a third of the memory of a hash table.
    key = keys()
    key.sort()
    if (key[1:] == key[:-1]).any():
        key = pd.Series(keys())
        row = _first(key.duplicated())
        earlier = block.where(table, _first(key == key[row]))
        point, image = frame["point"].iloc[row], frame["image"].iloc[row]
        fault = f"point {point!r} in image {image!r} stands already in {earlier}"
        _fail(block, table, row, fault, "delete one of the two rows")


def _points_are_one_kind(block) -> None:
    """One name is either a tie point or a ground point: their coordinates stand apart."""
    ties = block.tie_points["point"].dtype.categories
    for table in ("marks", "ground"):
        names = getattr(block, table)["point"]
        # Ties are many: few names are looked for first.
        if not is_among(ties, names).any():
            continue
        row = _first(is_among(names, ties))
        if row is not None:
            _fail(
                block,
                table,
                row,
                f"ground point {str(names.iloc[row])!r} is also a point of tie_points.csv",
                "measure ground points in marks.csv only, and name other points differently",
            )


def _ground(block) -> None:
    role = block.ground["role"]
    row = _first(~is_among(role, list(ROLES)))
    if row is not None:
        fault = f"role {role.iloc[row]!r} is unknown"
        _fail(block, "ground", row, fault, f"write one of {', '.join(ROLES)}")


def _known_images(block, table: str) -> None:
    names = getattr(block, table)["image"]
    images = block.images["image"]
    strange = ~is_among(names, images)
    row = _first(strange & names.notna()) if strange.any() else None
    if row is not None:
        _fail(
            block,
            table,
            row,
            f"image {str(names.iloc[row])!r} is not in images.csv",
            "add it there, correct the name or delete the row",
        )


def _once(block, table: str, name: str) -> None:
    column = getattr(block, table)[name]
    measured = block.tie_points["point"].dtype.categories
    rest = column
    if (
        table == "points"
        and len(measured)
        and arrow(column.iloc[: len(measured)]).equals(arrow(measured))
    ):
        # Of a river an index of all points is as large as all their coordinates.
        rest = column.iloc[len(measured) :]
        rest = column if is_among(measured, rest).any() else rest
    if not pd.Index(rest).is_unique:
        row = _first(column.duplicated())
        earlier = block.where(table, _first(column == column.iloc[row]))
        fault = f"{name} {column.iloc[row]!r} stands already in {earlier}"
        _fail(block, table, row, fault, "delete one of the two rows")


def _triple(block, table: str, columns: tuple[str, ...], what: str, remedy: str = "") -> None:
    """Numbers that only mean something together are all given or all empty."""
    frame = getattr(block, table)
    if not len(frame) or not any(name in frame for name in columns):
        return
    known = np.column_stack([~np.isnan(block.column(table, name)) for name in columns])
    row = _first(known.any(axis=1) & ~known.all(axis=1))
    if row is not None:
        missing = [name for name, there in zip(columns, known[row], strict=True) if not there]
        verb = "is" if len(missing) == 1 else "are"
        fault = f"{what} is given in part, {', '.join(missing)} {verb} missing"
        _fail(block, table, row, fault, remedy or "give all of it or leave all of it empty")


def _epochs(block, table: str, groups: tuple[str, ...]) -> None:
    """Time goes on: no two rows of one flight (or image) have the same time. Any row order."""
    frame = getattr(block, table)
    if not len(frame):
        return
    keys = [name for name in groups if name in frame] + ["time_s"]
    row = _first(frame.duplicated(keys))
    if row is not None:
        same = (frame[keys] == frame[keys].iloc[row]) | frame[keys].isna()
        earlier = block.where(table, _first(same.all(axis=1)))
        time = float(frame["time_s"].iloc[row])
        fault = f"time_s = {time!r} stands already in {earlier}"
        _fail(block, table, row, fault, "give every row its own time or delete one of the two")


def _lever_arms(block) -> None:
    flights = block.flight_names if block.lever_arm else []
    for flight, arm in block.lever_arm.items():
        if flight != "default" and flight not in flights:
            raise InputError(
                f"{FILE}: [lever_arm] names flight {flight!r}, which no image has; "
                f"use default or a flight of images.csv ({some(flights)})"
            )
        if np.shape(arm) != (3,) or not np.isfinite(np.asarray(arm, dtype=float)).all():
            raise InputError(
                f"{FILE}: [lever_arm] {flight} is not three numbers; write [x, y, z] in metres"
            )
