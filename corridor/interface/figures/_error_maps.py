"""Errors of many check points, a row a case: horizontal as arrows, height as bars."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.core.output import nice, readable
from corridor.interface.figures import maps, style
from corridor.interface.figures._residual_vectors import arrows, stated_arrow

MOST_ARROWS = 160


def error_maps(cases: Mapping[str, pd.DataFrame], title: str = "errors on the ground") -> Figure:
    """Maps of check-point errors, a row a case: planimetry on the left, altimetry on the right.

    cases: name -> table with x, y (m, where the point was given) and dx, dy, dz (m, adjusted minus
        given), such as `lay_on_control(...).check_points`.
    Both maps of a row share one scale, stated in the row; height is drawn as a bar, up and dark
    (blue) where the point came out too high, down and light (yellow) where too low. Of many points
    an even choice is drawn; RMS are of all, in one unit for the whole figure.
    """
    every = np.vstack([maps.columns(table) for table in cases.values()])
    frame = maps.frame_through(every, "y")
    # Room for the longest arrow of a point on the border.
    limits = maps.extent(frame.place(every), margin=0.15)
    width = 4.25
    height = maps.map_height(limits, width, 3.0)
    step = height + 0.92
    note = (
        "adjusted minus given \u00b7 one scale a row \u00b7 height: upwards (blue) too high, "
        "downwards (yellow) too low"
    )
    figure = style.sheet(1.0 + step * len(cases) + 0.1, title, note)
    worst = max(
        float(np.sqrt(np.nanmean((maps.columns(t, ("dx", "dy", "dz")) ** 2).sum(axis=1))))
        for t in cases.values()
    )
    unit = _unit(worst)
    metres_per_inch = max((limits[1] - limits[0]) / width, (limits[3] - limits[2]) / height)
    for row, (name, table) in enumerate(cases.items()):
        top = 1.15 + row * step
        shown = table.iloc[_even(frame.place(maps.columns(table)))]
        places = frame.place(maps.columns(shown))
        plan = frame.turn(maps.columns(shown, ("dx", "dy")))
        up = maps.columns(shown, ("dz",))[:, 0]
        longest = max(float(np.abs(plan).max(initial=0)), float(np.abs(up).max(initial=0)))
        # The longest takes a third of an inch: rows of arrows stay apart.
        scale = 0.34 * metres_per_inch / longest if longest > 0 else 1.0
        errors = maps.columns(table, ("dx", "dy", "dz"))
        texts = (
            f"{name}: horizontal, RMS "
            f"{_length(np.sqrt(np.mean((errors[:, :2] ** 2).sum(axis=1))), unit)}",
            f"height, RMS {_length(np.sqrt(np.mean(errors[:, 2] ** 2)), unit)}",
        )
        for column, text in enumerate(texts):
            left = 0.65 + column * (width + 0.45)
            axes = style.panel(figure, left, top, width, height)
            maps.at_one_scale(axes, limits, width, height)
            style.caption(axes, text)
            x_name, y_name = frame.labels
            last = row == len(cases) - 1
            style.label(axes, x_name if last else None, y_name if column == 0 else None)
            if column == 0:
                arrows(axes, *places.T, *plan.T, scale, style.DARK)
                continue
            axes.plot(*places.T, ls="", marker=".", ms=1.5, color=style.QUIET, zorder=3)
            for colour, some in ((style.DARK, up > 0), (style.LIGHT, up <= 0)):
                arrows(axes, *places[some].T, 0 * up[some], up[some], scale, colour)
        length = nice(0.5 * metres_per_inch / scale)
        stated_arrow(
            figure, 0.65 + 2 * width - 0.75, top - 0.12, length * scale / metres_per_inch,
            _length(length, unit),
        )  # fmt: skip
    return figure


def _even(places: np.ndarray) -> np.ndarray:
    """Rows of an even choice of at most `MOST_ARROWS` places: the first of each square."""
    if len(places) <= MOST_ARROWS:
        return np.arange(len(places))
    low, span = places.min(axis=0), np.ptp(places, axis=0)
    side = np.sqrt(np.prod(np.maximum(span, 1e-9)) / MOST_ARROWS) * 1.02
    square = np.floor((places - low) / side).astype(int)
    # The point nearest the middle of its square, so that arrows stand in rows.
    off = np.abs((places - low) / side - square - 0.5).max(axis=1)
    key = square[:, 0] * 100_000 + square[:, 1]
    order = np.lexsort((off, key))
    first = np.concatenate([[True], np.diff(key[order]) != 0])
    return np.sort(order[first])


def _unit(metres: float) -> tuple[float, str]:
    """Factor and name of the unit that a person would use for such a length."""
    for factor, unit in ((1.0, "m"), (1e2, "cm"), (1e3, "mm"), (1e6, "\u00b5m")):
        if metres == 0 or metres * factor >= (1.0 if unit != "cm" else 0.5):
            return factor, unit
    return 1e9, "nm"


def _length(metres: float, unit: tuple[float, str]) -> str:
    """A length in a unit, two digits: 1.4 cm, 0.3 mm, 650 m."""
    factor, name = unit
    return f"{readable(float(f'{metres * factor:.2g}'))} {name}"
