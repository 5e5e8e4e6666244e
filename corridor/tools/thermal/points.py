"""A thermal model applied to a table of points."""

import os
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import Layout, read_columns
from corridor.core.errors import InputError
from corridor.core.output import whole_file
from corridor.tools.thermal.model import ThermalModel
from corridor.tools.thermal.series import COLDEST_C, HOTTEST_C


def apply(
    model: ThermalModel,
    points: str | os.PathLike | pd.DataFrame,
    temperature_c: float | None = None,
    inverse: bool = False,
) -> tuple[pd.DataFrame, list[str]]:
    """Shifts of points, and what is to be said of them.

    points: table or file with x, y (px) and temperature_c (C, of the optics). temperature_c: holds
        for all points instead. inverse: x, y are seen at that temperature, and dx, dy lead back
        to t0.
    Returns x, y, temperature_c, dx, dy, sigma (px an axis), extrapolated (1 outside the model's
    range), rows in the same order, and warnings. Raises InputError naming row and remedy.
    """
    where, table = "the table of points", points
    if not isinstance(points, pd.DataFrame):
        columns = Layout(("x", "y"), () if temperature_c is not None else ("temperature_c",))
        where, table = str(points), read_columns(Path(points), columns)
    if temperature_c is not None and not np.isfinite(temperature_c):
        raise InputError(f"temperature = {temperature_c} is not a number of degrees Celsius")
    if not len(table):
        raise InputError(f"{where} has no point: write a row for each")
    x, y = _column(table, "x", where), _column(table, "y", where)
    if temperature_c is None:
        if "temperature_c" not in table:
            raise InputError(f"{where} has no column temperature_c: add it or give one temperature")
        warm = _column(table, "temperature_c", where)
    else:
        if "temperature_c" in table:
            raise InputError(
                f"{where} has a column temperature_c beside the one temperature for all points: "
                "give one of the two"
            )
        warm = np.full(len(table), float(temperature_c))
    wrong = np.flatnonzero((warm < COLDEST_C) | (warm > HOTTEST_C))
    if len(wrong):
        raise InputError(
            f"{where}, row {wrong[0] + 2}: {warm[wrong[0]]:g} C is outside what a camera endures: "
            "give degrees Celsius"
        )
    dx, dy = (model.undo if inverse else model.displacement)(x, y, warm)
    at = (x + dx, y + dy) if inverse else (x, y)
    out = pd.DataFrame(
        {
            "x": x, "y": y, "temperature_c": warm, "dx": dx, "dy": dy,
            "sigma": np.broadcast_to(model.sigma(*at, warm), x.shape),
            "extrapolated": model.outside(warm).astype(int),
        }
    )  # fmt: skip
    concern = model.concern(warm) if len(out) else None
    return out, [told for told in (_beyond(model, *at), concern) if told]


def _beyond(model: ThermalModel, x: np.ndarray, y: np.ndarray) -> str:
    """What is to be said of points outside the picture that the model was fitted to."""
    out = (x < -0.5) | (x > model.width - 0.5) | (y < -0.5) | (y > model.height - 0.5)
    if len(x) > 1 and (np.abs([x, y]) <= 1).all():
        return "all points lie within one pixel: are x and y shares of the picture? Write pixels"
    if not out.any():
        return ""
    return (
        f"{int(out.sum())} of {len(x)} points lie outside the {model.width} x {model.height} px of "
        "the model's pictures: was it fitted to pictures of another size?"
    )


def _column(table, name, where):
    if name not in table:
        raise InputError(f"{where} has no column {name}: add it")
    values = pd.to_numeric(table[name], errors="coerce").to_numpy(float)
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        cell = table[name].iloc[wrong[0]]
        what = "is empty" if pd.isna(cell) else f"= {cell!r} is not a number"
        raise InputError(f"{where}, row {wrong[0] + 2}: {name} {what}: correct it")
    return values


def write_points(table: pd.DataFrame, path: str | os.PathLike) -> None:
    """Write what `apply` returned, with every digit, whole or not at all."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder: name a file to write")
    with whole_file(path) as part:
        table.to_csv(part, index=False, lineterminator="\n", float_format="%.17g")
