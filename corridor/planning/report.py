"""A table of expected accuracies for a terminal, and as a folder."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.figures import accuracy_by_control
from corridor.report import whole_folder, write_json, write_picture

_RESULT = "plan.json"
_FILES = (_RESULT, "plan.csv", "advice.txt", "accuracy.png")
_COLUMNS = (
    ("control", "control", 1, "d"),
    ("xy cm", "xy", 100, ".2f"),
    ("z cm", "z", 100, ".2f"),
    ("3D cm", "d3", 100, ".2f"),
    ("f px", "sigma_f", 1, ".2f"),
    ("arm mm", "sigma_arm_z", 1000, ".1f"),
    ("arm,f", "arm_f", 1, ".2f"),
    ("h,arm", "height_arm", 1, ".2f"),
    ("h,f", "height_f", 1, ".2f"),
    ("bias xy", "transfer_xy", 1, ".2f"),
    ("bias z", "transfer_z", 1, ".2f"),
)
_KEY = """\
xy, z, 3D: expected RMS of check points. f, arm: sigmas of focal length and lever arm z; arm,f and
so on: correlations of both and of the camera height h, nadir flights; a dash where they are held.
bias: share of a constant error of the GNSS that is on the ground."""


def as_text(table: pd.DataFrame) -> str:
    """The table of `sweep` for a terminal, 99 columns; a dash where a parameter is held."""
    table = table.assign(transfer_xy=np.maximum(table["transfer_x"], table["transfer_y"]))
    lines = ["".join(f"  {head:>7}" for head, *_ in _COLUMNS)]
    for name, rows in table.groupby("flights", sort=False):
        lines.append(str(name))
        for row in rows.to_dict("records"):
            cells = (_cell(row[key], factor, form) for _, key, factor, form in _COLUMNS)
            lines.append("".join(f"  {cell:>7}" for cell in cells))
    for text in dict.fromkeys(table.loc[table["open"] != "", "open"]):
        lines += textwrap.wrap(f"! {text}.", 99, subsequent_indent="  ")
    return "\n".join([*lines, "", _KEY])


def picture(table: pd.DataFrame) -> Figure:
    """Error against number of control points, a line for each flight set."""
    series = {
        str(name): (rows["control"].to_numpy(), rows["xy"].to_numpy(), rows["z"].to_numpy())
        for name, rows in table.sort_values("control").groupby("flights", sort=False)
    }
    return accuracy_by_control({name: series[name] for name in table["flights"].unique()})


def save(
    table: pd.DataFrame,
    said: str,
    folder: str | os.PathLike,
    settings: Mapping[str, object] | None = None,
) -> list[Path]:
    """Writes plan.csv, plan.json, advice.txt and accuracy.png, whole or not at all.

    said: the advice. settings: what was asked, kept in plan.json. Metres; NaN is null, an empty
    cell. Raises InputError where `folder` holds something else.
    """
    folder = Path(folder)
    with whole_folder(folder, _RESULT, lambda name: name in _FILES) as part:
        table.to_csv(part / "plan.csv", index=False, float_format="%.6g", lineterminator="\n")
        (part / "advice.txt").write_text(said + "\n", encoding="utf-8", newline="\n")
        rows = table.to_dict("records")
        content = {"advice": said, "settings": dict(settings or {}), "rows": rows}
        write_json(content, part / _RESULT)
        write_picture(picture(table), part / "accuracy.png")
    return [folder / name for name in sorted(_FILES)]


def _cell(value, factor: float, form: str) -> str:
    if not np.isfinite(value):
        return "\u2013"
    return format(int(value) if form == "d" else factor * value, form)
