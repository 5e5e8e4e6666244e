"""A block without what tells whose it is: names, place, day, and all that nobody here reads."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core.block import LAYOUTS, Block

_POINTS = ("tie_points", "marks", "points", "ground")


def anonymous(block: Block) -> tuple[Block, dict[str, str]]:
    """The block with other names, moved horizontally and in time; and old name -> new name.

    Names keep their order, which some results depend on in their last digits. Coordinates are moved
    by whole metres and times by whole seconds, so that the numbers stay what they are: x and y
    begin near zero, heights stay (effects know of water levels), times begin in the first
    second. Columns that are not listed, texts, offset and reference system are left out.
    """
    points = [getattr(block, table)["point"].astype(object) for table in _POINTS]
    names = {
        "image": _named("i", block.images["image"]),
        "flight": _named("F", [*block.flight_names, *_of(block, "flight")]),
        "strip": _named("s", _of(block, "strip")),
        "camera": _named("C", block.cameras),
        "point": _named("p", pd.unique(pd.concat(points))),
    }
    shift = _start(block, ("x", "y"), ("images", "gnss", "points", "ground", "track"))
    start = _start(block, ("time_s",), ("images", "rates", "track"))
    tables = {}
    for table, layout in LAYOUTS.items():
        frame = getattr(block, table)
        frame = frame[[name for name in frame.columns if name in layout.listed]].copy()
        for column in frame.columns.intersection(list(names)):
            frame[column] = frame[column].astype(object).map(names[column], na_action="ignore")
        if table not in ("tie_points", "marks"):
            for column, by in zip(("x", "y", "time_s"), (*shift, *start), strict=True):
                if column in frame:
                    frame[column] = block.column(table, column) - by
        tables[table] = frame
    cameras = {
        names["camera"][name]: replace(camera, name=names["camera"][name], extra={})
        for name, camera in block.cameras.items()
    }
    made = Block(
        name="copy",
        cameras=cameras,
        **tables,
        sigma=block.sigma,
        lever_arm={names["flight"].get(f, f): arm for f, arm in block.lever_arm.items()},
        lever_arm_fixed=block.lever_arm_fixed,
        extra={"effect": block.constants} if block.constants else {},
    )
    return made, {old: new for each in names.values() for old, new in each.items()}


def _named(letter: str, names: Iterable) -> dict[str, str]:
    """Old name -> letter and number, in the order of the old names."""
    ordered = sorted({str(name) for name in names if not pd.isna(name)})
    digits = len(str(len(ordered)))
    return {name: f"{letter}{k:0{digits}d}" for k, name in enumerate(ordered, 1)}


def _of(block: Block, column: str) -> list:
    frames = (getattr(block, table) for table in ("images", "rates", "track"))
    return [name for frame in frames if column in frame for name in frame[column].unique()]


def _start(block: Block, columns: tuple[str, ...], tables: tuple[str, ...]) -> np.ndarray:
    """The least value of each column over the tables, whole; zero where all are unknown."""
    out = []
    for column in columns:
        values = np.concatenate([block.column(table, column) for table in tables])
        known = values[np.isfinite(values)]
        out.append(np.floor(known.min()) if len(known) else 0.0)
    return np.array(out)
