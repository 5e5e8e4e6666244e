"""Expected accuracies for a terminal, a notebook, and as a folder: the advice first."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.core import registry
from corridor.core.output import (
    DASH,
    Report,
    Table,
    counted,
    whole_folder,
    write_csv,
    write_json,
    write_picture,
)
from corridor.tools.planning.detection import columns

RESULT = "plan.json"
_FILES = (
    RESULT, "plan.csv", "control.csv", "advice.txt", "accuracy.png", "control.png",
    "detection.csv", "detection.png",
)  # fmt: skip
_MOST_POINTS = 12
_DRAWN = ("control", "xy", "z")
_ACCURACY = (
    ("horizontal", "xy", 1000, ".1f"),
    ("height", "z", 1000, ".1f"),
    ("3D", "d3", 1000, ".1f"),
    ("GNSS horizontal", "transfer_xy", 100, ".0f"),
    ("GNSS height", "transfer_z", 100, ".0f"),
)
_KNOWN = (
    ("f (px)", "sigma_f", 1, ".2f"),
    ("arm z (mm)", "sigma_arm_z", 1000, ".1f"),
    ("arm with f", "arm_f", 1, ".2f"),
    ("height with arm", "height_arm", 1, ".2f"),
    ("height with f", "height_f", 1, ".2f"),
)


def report_of(planned) -> Report:
    """The advice, where control goes, the accuracies, and what can be told apart.

    planned: `corridor.planning.Planned`.
    """
    table = planned.table.assign(
        transfer_xy=np.maximum(planned.table["transfer_x"], planned.table["transfer_y"])
    )
    accuracy = (
        "mm, RMS of check points; GNSS: per cent of a constant error of it that is on the ground"
    )
    known = (
        "standard deviations of focal length and lever arm, and their correlations with each other "
        "and with the height of the camera; nadir flights; a dash where one is held"
    )
    made = [
        _control(planned),
        _of(table, _ACCURACY, "Expected errors", (accuracy, planned.sigmas)),
        _of(table, _KNOWN, "What the flights can separate", (known,)),
    ]
    if planned.detection is not None:
        made.append(registry.room("change").detection_table(planned.detection))
    holes = dict.fromkeys(table.loc[table["open"] != "", "open"])
    names = ", ".join(dict.fromkeys(table["flights"]))
    return Report(
        title=f"Plan of {names}",
        opening=planned.advice,
        warnings=[f"{hole}." for hole in holes],
        tables=[one for one in made if one is not None],
    )


def save(planned, folder: str | os.PathLike) -> list[Path]:
    """Writes a plan's report into a folder: see `Planned.save`."""
    folder, table = Path(folder), planned.table
    with whole_folder(folder, RESULT, lambda name: name in _FILES) as part:
        write_csv(table, part / "plan.csv", digits=6)
        said = planned.advice
        (part / "advice.txt").write_text(said + "\n", encoding="utf-8", newline="\n")
        content = {
            "advice": said,
            "assumed": planned.sigmas,
            "settings": planned.settings,
            "control": planned.control.to_dict("records"),
            "rows": table.to_dict("records"),
        }
        write_json(content, part / RESULT)
        write_picture(_picture(table), part / "accuracy.png")
        if planned.chosen is not None:
            write_csv(planned.control, part / "control.csv")
            block = planned.laid_out()
            write_picture(
                registry.room("figures").control_map(block, _count(planned.chosen)),
                part / "control.png",
            )
        if planned.detection is not None:
            write_csv(columns(planned.detection), part / "detection.csv")
            write_picture(
                registry.room("figures").detection_map(planned.detection), part / "detection.png"
            )
        written = [name for name in _FILES if (part / name).is_file()]
    return [folder / name for name in sorted(written)]


def _count(row: pd.Series) -> str:
    return f"{row['flights']} with {counted(int(row['control']), 'control point')}"


def _picture(table: pd.DataFrame) -> Figure:
    """Error against number of control points, a line for each flight set."""
    series = {
        str(name): tuple(rows.sort_values("control")[key].to_numpy() for key in _DRAWN)
        for name, rows in table.groupby("flights", sort=False)
    }
    return registry.room("figures").accuracy_by_control(series)


def _control(planned) -> Table | None:
    """Where the control points of the advice are to be."""
    points = planned.control
    if not len(points):
        return None
    rows = tuple(
        (str(p.point), f"{p.x:.1f}", f"{p.y:.1f}", f"{p.z:.1f}")
        for p in points.head(_MOST_POINTS).itertuples()
    )
    notes = ["metres, as the axis of the plan; anywhere near will do, where images show it"]
    if len(points) > len(rows):
        notes.append(f"{len(points) - len(rows)} more in control.csv")
    where = f"Where to survey for {_count(planned.chosen)}"
    return Table(where, ("point", "x", "y", "z"), rows, "lrrr", tuple(notes))


def _of(table: pd.DataFrame, columns, title: str, notes: tuple[str, ...]) -> Table | None:
    """Some columns for each flight set and number of control points; None where all are unknown."""
    if table[[key for _, key, *_ in columns]].isna().all(axis=None):
        return None
    rows, before = [], None
    for row in table.to_dict("records"):
        name = str(row["flights"])
        cells = (
            format(factor * row[key], form) if np.isfinite(row[key]) else DASH
            for _, key, factor, form in columns
        )
        rows.append((name if name != before else "", str(row["control"]), *cells))
        before = name
    header = ("flights", "control", *(head for head, *_ in columns))
    return Table(title, header, tuple(rows), "l" + "r" * (len(header) - 1), notes)
