"""What a block must fulfil before anything is computed from it.

Every check runs over whole columns; the row is looked for only where one fails. What depends on
the adjustment (a point seen once, an image with too few points) is judged there.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from corridor.core.block.attitudes import check_attitudes
from corridor.core.block.correlation import RHO, possible
from corridor.core.block.rigs import exposures_of
from corridor.core.block.settings import FILE, SIGMA
from corridor.core.block.tables import (
    ANGLE_SIGMAS,
    LAYOUTS,
    NAMES,
    POSE,
    QUATERNION,
    RATES,
    ROLES,
    SIGMAS,
    VELOCITY,
    is_among,
)
from corridor.core.errors import InputError, some

# Coordinates and offsets so large are those of a grid.
_FAR_M = 50_000.0


def check(block, observed: bool = True) -> None:
    """Raise InputError, one sentence with file, row and remedy, for the first fault.

    observed: whether a block without observations is one.
    """
    _settings(block)
    code_names(block)
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
    _whole(block, "points", ("x", "y", "z"), "the position")
    unknown, roles = ~is_among(block.ground["role"], list(ROLES)), ", ".join(ROLES)
    _refuse(block, "ground", unknown, "role {role!r} is unknown", f"write one of {roles}")
    for table in ("gnss", "attitudes"):
        _known_images(block, table)
        _once(block, table, "image")
    if len(block.attitudes):
        _whole(block, "attitudes", check_attitudes(block), "the attitude")
    _distances(block)
    exposures_of(block)
    if "image" in block.rates:
        _known_images(block, "rates")
    # Time goes on, in any order of the rows.
    for table, owners in (("rates", ("flight", "image")), ("track", ("flight",))):
        keys = [name for name in owners if name in getattr(block, table)] + ["time_s"]
        remedy = "give every row its own time or delete one of the two"
        _refuse_twice(block, table, keys, "time_s = {time_s}", remedy)
    _whole(block, "track", VELOCITY, "the velocity")
    _lever_arms(block)


def _refuse(block, table: str, wrong: Any, fault: str, remedy: str, **more: Any) -> None:
    """Raise InputError for the first row of a mask (rows,).

    fault, remedy: {NAME} in them is that row's cell of a column, or of an array of `more`.
    """
    row = _first(wrong)
    if row is not None:
        cells = getattr(block, table).iloc[row].to_dict()
        cells |= {key: v[row] if isinstance(v, np.ndarray) else v for key, v in more.items()}
        fault, remedy = fault.format_map(cells), remedy.format_map(cells)
        raise InputError(f"{block.where(table, row)}: {fault}; {remedy}")


def _refuse_twice(
    block, table: str, names: Sequence[str], fault: str, remedy: str = "delete one of the two rows"
) -> None:
    """Raise InputError for the first row that holds in some columns what an earlier one does."""
    rows = getattr(block, table)[list(names)]
    twice = rows.duplicated()
    row = _first(twice)
    if row is not None:
        cells = [(rows[name], rows[name].iloc[row]) for name in names]
        same = [column.isna() if pd.isna(cell) else column == cell for column, cell in cells]
        earlier = block.where(table, _first(np.logical_and.reduce(same)))
        fault += " stands already in {earlier}"
        _refuse(block, table, twice, fault, remedy, earlier=earlier)


def _first(mask: Any) -> int | None:
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
    _offset(block)


def _offset(block) -> None:
    """Refuse coordinates from which the offset of block.toml was plainly not subtracted."""
    for table in ("images", "gnss", "ground", "points"):
        given = block.numbers(table, "x", "y")
        given = given[np.isfinite(given).all(axis=1)]
        if not len(given):
            continue
        middle, offset = np.median(given, axis=0), block.offset[:2]
        far = (np.abs(offset) > _FAR_M).all() and (np.abs(middle) > _FAR_M).all()
        if far and (np.abs(middle - offset) < 0.05 * np.abs(offset)).all():
            shown = ", ".join(f"{value:.10g}" for value in block.offset)
            raise InputError(
                f"{FILE}: offset = [{shown}] was not subtracted from {table}.csv, whose x and y "
                "are full coordinates: subtract it in every file, or delete the line offset"
            )


def _names(block, table: str) -> None:
    """Needed names are there, and no name has blanks around it."""
    frame, layout = getattr(block, table), LAYOUTS[table]
    for name in layout.listed if len(frame) else ():
        if name not in NAMES or name not in frame:
            continue
        column = frame[name]
        coded = isinstance(column.dtype, pd.CategoricalDtype)
        codes = column.array.codes if coded else np.zeros(0, int)
        values = column.dtype.categories if coded else column
        if name in layout.needed:
            empty = codes < 0 if coded else (column == "") | column.isna()
            _refuse(block, table, empty, f"{name} is empty", "fill it in or delete the row")
        bare = values.str.strip()
        if not bare.equals(values):
            blank = np.asarray((bare != values) & values.notna())
            blank = blank[codes] & (codes >= 0) if coded else blank
            fault = f"{name} {{{name}!r}} has blanks around it"
            _refuse(block, table, blank, fault, "take them away")


def _numbers(block, table: str) -> None:
    """Needed numbers are there, all are finite, and standard deviations are positive."""
    frame, layout = getattr(block, table), LAYOUTS[table]
    for name in layout.numbers if len(frame) else ():
        if name not in frame:
            continue
        values = frame[name].to_numpy()
        _refuse(block, table, np.isinf(values), f"{name} is infinite", "write a number")
        if name in layout.needed and name not in layout.empty:
            remedy = "write a number or delete the row"
            _refuse(block, table, np.isnan(values), f"{name} is empty", remedy)
        if name == "sigma" or name in SIGMAS + ANGLE_SIGMAS:
            fault = f"{name} = {{{name}:g}} is not a standard deviation"
            remedy = "write a positive number or leave the cell empty"
            # Ground points may be exact: 0.
            wrong = values < 0 if table == "ground" else values <= 0
            _refuse(block, table, wrong, fault, remedy)
    named = [name for name in RHO if name in layout.numbers and name in frame]
    if named and len(frame):
        wrong = ~possible(block.correlation(table))
        fault = f"{', '.join(named)}: no measurement has such correlations"
        remedy = "write numbers between -1 and 1 of one covariance matrix or leave the cells empty"
        _refuse(block, table, wrong, fault, remedy)


def _images(block) -> None:
    images = block.images
    if not len(images):
        raise InputError("images.csv: it names no image; add one row for each image")
    _once(block, "images", "image")
    unknown = ~is_among(images["camera"], list(block.cameras))
    remedy = "add a table [camera.{camera}] there or correct the name ({known})"
    fault = "camera {camera!r} is not in block.toml"
    _refuse(block, "images", unknown, fault, remedy, known=some(block.cameras))
    remedy = "give x, y, z and qw, qx, qy, qz or none of them (antenna positions go into gnss.csv)"
    _whole(block, "images", POSE, "the pose", remedy)
    _whole(block, "images", VELOCITY, "the velocity")
    _whole(block, "images", RATES, "the angular rate")
    for table, frame in (("images", images), ("attitudes", block.attitudes)):
        if not set(QUATERNION) <= set(frame.columns):
            continue
        length = np.linalg.norm([frame[name].to_numpy(float) for name in QUATERNION], axis=0)
        remedy = "give a unit quaternion or leave its four cells empty"
        for wrong, shown in ((length == 0, "zero"), (np.abs(length - 1) > 0.01, "{length:.6g}")):
            fault = f"the quaternion qw, qx, qy, qz has length {shown}"
            _refuse(block, table, wrong, fault, remedy, length=length)
    # A camera does not take two images of one flight at once, whatever the other cameras do.
    time = block.column("images", "time_s")
    known = np.flatnonzero(~np.isnan(time))
    if len(known) > 1 and np.ptp(time[known]) == 0:
        still = np.zeros(len(time), dtype=bool)
        still[known] = images.iloc[known].duplicated("camera")
        fault = "time_s = {time_s:g} stands still, it is the same in every image"
        remedy = "write the times of exposure or leave the cells empty"
        _refuse(block, "images", still, fault, remedy)


def check_observations(block) -> None:
    """Raise InputError where the observations of a block that somebody has changed are not each of
    a known image, once."""
    code_names(block)
    for table in ("tie_points", "marks"):
        _observations(block, table)


def code_names(block) -> None:
    """Names in the tables of observations as categories, where somebody has put texts into a block.

    Raises InputError where such a table is no table of observations any more.
    """
    for table in ("tie_points", "marks"):
        frame = getattr(block, table)
        kinds = frame.dtypes[["point", "image"]]
        texts = [name for name, kind in kinds.items() if not isinstance(kind, pd.CategoricalDtype)]
        if texts:
            setattr(block, table, frame.astype(dict.fromkeys(texts, "category")))
            _observations(block, table)


def _observations(block, table: str) -> None:
    frame = getattr(block, table)
    if not len(frame):
        return
    _known_images(block, table)
    image = frame["image"].array
    key = frame["point"].array.codes.astype(np.int64) * len(image.categories) + image.codes
    # Most files are in order; else sorting in place takes a third of the memory of a hash table.
    if (key[1:] > key[:-1]).all():
        return
    key.sort()
    if (key[1:] == key[:-1]).any():
        _refuse_twice(block, table, ("point", "image"), "point {point!r} in image {image!r}")


def _points_are_one_kind(block) -> None:
    """One name is either a tie point or a ground point: their coordinates stand apart."""
    ties = block.tie_points["point"].dtype.categories
    for table in ("marks", "ground"):
        names = getattr(block, table)["point"]
        # Ties are many: few names are looked for first.
        if is_among(ties, names).any():
            fault = "ground point {point!r} is also a point of tie_points.csv"
            remedy = "measure ground points in marks.csv only, and name other points differently"
            _refuse(block, table, is_among(names, ties), fault, remedy)


def _known_images(block, table: str) -> None:
    names = getattr(block, table)["image"]
    strange = ~is_among(names, block.images["image"])
    if strange.any():
        remedy = "add it there, correct the name or delete the row"
        fault = "image {image!r} is not in images.csv" + _alike(block, names[strange])
        _refuse(block, table, strange & names.notna(), fault, remedy)


def _alike(block, names) -> str:
    """The image that the first of the names may mean; braces are those of `_refuse`."""
    names = names.dropna()
    if not len(names):
        return ""
    name = str(names.iloc[0])
    alike: list[str] = []
    ways = [lambda one: one.replace("\\", "/").casefold()]
    ways.append(lambda one: ways[0](one).rpartition("/")[2])
    ways.append(lambda one: ways[1](one).rpartition(".")[0] or ways[1](one))
    for way in ways:
        alike = alike or [one for one in block.images["image"] if way(one) == way(name)]
    if not alike:
        return ""
    found = alike[0].replace("{", "{{").replace("}", "}}")
    if len(alike) > 1:
        return f", which has {len(alike)} of that name (one is {found!r}): write their folders"
    if found.casefold() == name.casefold():
        return f"; it has {found!r}: only upper and lower case differ"
    return f" (did you mean {found!r}?)"


def _once(block, table: str, name: str) -> None:
    column = getattr(block, table)[name]
    measured = block.tie_points["point"].dtype.categories
    rest = column
    if table == "points" and len(measured) and column.array[: len(measured)].equals(measured.array):
        # Of a river an index of all points is as large as all their coordinates.
        rest = column.iloc[len(measured) :]
        rest = column if is_among(measured, rest).any() else rest
    if not pd.Index(rest).is_unique:
        _refuse_twice(block, table, (name,), f"{name} {{{name}!r}}")


def _whole(block, table: str, columns: tuple[str, ...], what: str, remedy: str = "") -> None:
    """Numbers that only mean something together are all given or all empty."""
    frame = getattr(block, table)
    if not len(frame) or not any(name in frame for name in columns):
        return
    known = np.isfinite(block.numbers(table, *columns))
    wrong = known.any(axis=1) & ~known.all(axis=1)
    row = _first(wrong)
    if row is not None:
        missing = [name for name, there in zip(columns, known[row], strict=True) if not there]
        verb = "is" if len(missing) == 1 else "are"
        fault = f"{what} is given in part, {', '.join(missing)} {verb} missing"
        _refuse(block, table, wrong, fault, remedy or "give all of it or leave all of it empty")


def _distances(block) -> None:
    """Distances are between two points, and positive."""
    table = block.distances
    if not len(table):
        return
    same = (table["from"] == table["to"]).to_numpy()
    remedy = "name the two ends of the distance, or delete the row"
    _refuse(block, "distances", same, "from and to are the same point {from!r}", remedy)
    length = table["distance"].to_numpy()
    remedy = "write the distance in metres, or delete the row"
    _refuse(block, "distances", ~(length > 0), "distance = {distance:g} is not positive", remedy)


def _lever_arms(block) -> None:
    flights = block.flight_names if block.lever_arm else []
    for flight, arm in block.lever_arm.items():
        if flight != "default" and flight not in flights:
            raise InputError(
                f"{FILE}: [lever_arm] names flight {flight!r}, which no image has; "
                f"use default or a flight of images.csv ({some(flights)}) with [x, y, z] in metres"
            )
        if np.shape(arm) != (3,) or not np.isfinite(np.asarray(arm, dtype=float)).all():
            raise InputError(
                f"{FILE}: [lever_arm] {flight} is not three numbers; write [x, y, z] in metres"
            )
