"""What the camera model leaves over, by position in the image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from corridor.core.output import nice, readable, short
from corridor.interface.figures import style
from corridor.interface.figures._first_look import camera_of, cells, in_cells

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

MOST_CAMERAS = 4
PANEL_OVER_IMAGE = 1.08  # the panel over the image, for arrows that leave it
_ARROW = {
    "units": "inches", "width": 0.016, "headwidth": 4.5, "headlength": 5,
    "headaxislength": 4.5, "minlength": 0.5,
}  # fmt: skip
LEAST_RESIDUALS = 3  # residuals a cell needs before it gets an arrow


def residual_vectors(adjustment: Adjustment, camera: str | None = None) -> Figure:
    """Mean residual (measured minus modelled) in each cell of the image, as an arrow.

    adjustment: its tie points, or its marks where it has no tie points; outliers left out.
    camera: one camera; default all, at most four, those with most residuals, at one scale.
    Dark arrows are more than two standard errors of their mean long, pale ones may be chance.
    """
    block = adjustment.block
    title = f"{short(block.name, 50)}: mean residuals in the image"
    found = used(adjustment)
    if found is None:
        return style.sentence("No image residuals to show.", title)
    table, counts = found
    owner = camera_of(block, table)
    names = [camera] if camera is not None else list(block.cameras)
    mine = {name: counts & np.asarray(owner == name) for name in names}
    number = {name: int(np.count_nonzero(rows)) for name, rows in mine.items()}
    shown = sorted((n for n in names if number[n]), key=lambda n: -number[n])[:MOST_CAMERAS]
    if not shown:
        return style.sentence("No image residuals to show.", title)
    across = 1 if len(shown) == 1 else 2
    box = (8.1, 5.6) if across == 1 else (3.95, 3.4)
    cameras = [block.cameras[name] for name in shown]
    inch_per_px = min(min(box[0] / one.width, box[1] / one.height) for one in cameras)
    fields = [_Field(block.cameras[name], table, mine[name], inch_per_px) for name in shown]
    exaggeration = nice(min(field.step for field in fields) / max(_longest(fields), 1e-12))

    sizes = [(inch_per_px * field.width, inch_per_px * field.height) for field in fields]
    row_height = max(height for _, height in sizes) + 0.85
    bar_left = 0.85 + (sizes[0][0] if across == 1 else 2 * box[0] + 0.7) + 0.12
    figure = style.sheet(
        1.0 + (0.2 if len(block.cameras) > 1 else 0.0) + -(-len(fields) // across) * row_height,
        title,
        f"{sum(number[n] for n in shown):,} residuals \u00b7 arrows exaggerated "
        f"{readable(exaggeration)} times \u00b7 pale: within two standard errors of zero",
        width=max(bar_left + 0.9, 6.5),
    )
    most = max(field.count.max() for field in fields)
    head = 1.3 if len(block.cameras) > 1 else 1.1
    for index, (name, field) in enumerate(zip(shown, fields, strict=True)):
        left = 0.85 + (index % across) * (box[0] + 0.7)
        axes = style.panel(figure, left, head + (index // across) * row_height, *sizes[index])
        shades = field.draw(axes, exaggeration, most)
        if len(block.cameras) > 1:
            style.caption(axes, f"camera {short(name, 24)}")
        if index == 0:
            scale = inch_per_px / PANEL_OVER_IMAGE
            length = nice(1.2 / (scale * exaggeration))
            inches = length * exaggeration * scale
            stated_arrow(figure, left, 0.83, inches, f"{readable(length)} px")
    style.shade_bar(figure, shades, bar_left, head, sizes[0][1], "residuals a cell", True)
    return figure


def used(adjustment: Adjustment) -> tuple[pd.DataFrame, np.ndarray] | None:
    """Image residuals, of tie points, else of marks, and which took part; None without any."""
    for kind in ("tie", "mark"):
        table = adjustment.residuals.get(kind)
        if table is not None and len(table):
            left_out = np.zeros(len(table), dtype=bool)
            for flag in ("outlier", "gross"):
                if flag in table:
                    left_out |= table[flag].to_numpy(dtype=bool)
            kept = ~left_out & np.isfinite(table["vx"].to_numpy(dtype=float))
            if kept.any():
                return table, kept
    return None


class _Field:
    """Mean residual, its standard error and the count in each cell of one camera's image."""

    def __init__(self, camera, table: pd.DataFrame, mine: np.ndarray, inch_per_px: float):
        self.width, self.height = camera.width, camera.height
        most = max(4, int(inch_per_px * camera.width / 0.33))
        number = int(np.count_nonzero(mine))
        self.edges_x, self.edges_y = cells(camera.width, camera.height, number, most)
        totals = in_cells(table, mine, self.edges_x, self.edges_y, "vx", "vy")
        self.count = totals[0]
        divisor = np.where(self.count >= LEAST_RESIDUALS, self.count, np.nan)
        self.mean = totals[[1, 3]] / divisor
        spread = totals[[2, 4]] / divisor - self.mean**2
        error = np.sqrt(np.clip(spread.sum(axis=0), 0, None) / divisor)
        self.length = np.hypot(*self.mean)
        self.real = self.length > 2 * error
        self.step = self.edges_x[1] - self.edges_x[0]

    def draw(self, axes: Axes, exaggeration: float, most: float):
        shades = axes.pcolormesh(
            self.edges_x, self.edges_y, self.count, cmap=style.SHADES, vmin=0, vmax=max(most, 1)
        )
        x, y = np.meshgrid(
            (self.edges_x[:-1] + self.edges_x[1:]) / 2, (self.edges_y[:-1] + self.edges_y[1:]) / 2
        )
        known = np.isfinite(self.length)
        for rows, colour, order in (
            (known & ~self.real, "#8fa9c4", 3),
            (known & self.real, style.DARK, 4),
        ):
            arrows(axes, x[rows], y[rows], *self.mean[:, rows], exaggeration, colour, order)
        style.in_pixels(axes, self, (PANEL_OVER_IMAGE - 1) / 2, outlined=True)
        axes.set_aspect("equal", adjustable="box")
        return shades


def arrows(axes: Axes, x, y, dx, dy, exaggeration: float, colour: str, order: int = 4) -> None:
    """Arrows from (x, y) by (dx, dy) times `exaggeration`, all in the units of the axes."""
    if np.size(x):
        scale = {"angles": "xy", "scale_units": "xy", "scale": 1 / exaggeration}
        axes.quiver(x, y, dx, dy, color=colour, zorder=order, **scale, **_ARROW)


def _longest(fields: list[_Field]) -> float:
    every = np.concatenate([field.length[np.isfinite(field.length)] for field in fields])
    return float(np.percentile(every, 95)) if len(every) else 0.0


def stated_arrow(figure: Figure, left: float, top: float, length: float, text: str) -> None:
    """An arrow `length` inches long with what it stands for written beside it."""
    key = style.panel(figure, left, top - 0.1, length + 0.02, 0.2)
    key.set_axis_off()
    key.set(xlim=(0, length + 0.02), ylim=(-1, 1))
    arrows(key, 0.0, 0.0, length, 0.0, 1.0, style.INK)
    style.write(figure, left + length + 0.12, top + 0.04, text)
