"""Where along the corridor the residuals are large, or drift."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from corridor.core.output import short
from corridor.interface.figures import maps, style
from corridor.interface.figures._first_look import ROWS_AT_ONCE
from corridor.interface.figures._residual_vectors import used

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

_BAND = "#ececec"


def residuals_along(adjustment: Adjustment) -> Figure:
    """RMS of the image residuals of each image, and the GNSS residuals x, y, z, along the block.

    The distance is that of the camera centre along the block's main axis; where a block has
    no such axis, the images stand in the order of `images.csv`. The band behind the GNSS
    residuals is the stated standard deviation (median), one scale for all three components.
    """
    block = adjustment.block
    title = f"{short(block.name, 50)}: residuals along the block"
    found = used(adjustment)
    gnss = adjustment.residuals.get("gnss")
    gnss = gnss if gnss is not None and len(gnss) else None
    if found is None and gnss is None:
        return style.sentence("No residuals to show.", title)
    frame = maps.frame_of(block)
    names = block.images["image"].astype(str)
    if frame.turned:
        where = frame.place(maps.centres(block))[:, 0]
        axis = frame.labels[0]
    else:
        where = np.arange(1, len(names) + 1, dtype=float)
        axis = "image, in the order of images.csv"
    position = pd.Series(where, index=names)

    known = where[np.isfinite(where)]
    room = 0.015 * max(float(np.ptp(known)), 1.0) if len(known) else 1.0
    heights = ([2.6] if found is not None else []) + ([1.45] * 3 if gnss is not None else [])
    figure, panels = style.charts(title, _note(frame), heights, sharex=True)
    panels = list(panels[:, 0])
    panels[0].set_xlim((known.min() - room, known.max() + room) if len(known) else (0.0, 1.0))
    panels[0].xaxis.set_major_locator(
        MaxNLocator(10, steps=[1, 2, 5, 10], integer=not frame.turned)
    )
    style.label(panels[-1], axis)
    if found is not None:
        _image_rms(panels[0], *found, position)
    if gnss is not None:
        _antenna(panels[-3:], adjustment.block, gnss, position)
    return figure


def _note(frame: maps.MapFrame) -> str:
    if not frame.turned:
        return ""
    # The sheet's x axis points this way in the world: azimuth from north, clockwise.
    azimuth = np.degrees(np.arctan2(np.cos(frame.angle), np.sin(frame.angle))) % 360
    north = "north" if frame.north == "N" else "y"
    return f"distance along the block grows towards {azimuth:.0f}\u00b0 from {north}, clockwise"


def _image_rms(axes, table: pd.DataFrame, counts: np.ndarray, position: pd.Series) -> None:
    category = table["image"].astype("category")
    codes = category.array.codes
    number, *squares = _of_images(codes, counts, len(category.cat.categories), table)
    at = position.reindex(category.cat.categories.astype(str)).to_numpy()
    size = float(np.clip(60 / np.sqrt(max(len(at), 1)), 1.8, 5.0))
    keys, highest = [], 0.0
    for column, square, (colour, marker), dash, word in zip(
        ("vx", "vy"), squares, style.SERIES, ("-", "--"), ("line", "dashed"), strict=False
    ):
        with np.errstate(invalid="ignore", divide="ignore"):
            rms = np.sqrt(square / number)
        overall = float(np.sqrt(square.sum() / number.sum()))
        axes.axhline(overall, color=colour, lw=0.8, ls=dash, zorder=2)
        text = f"{column[1]} in the image, all together {overall:.2f} px ({word})"
        look = style.dot(marker, colour, size, "white", 0.3)
        keys += axes.plot(at, rms, zorder=3, label=text, **look)
        highest = max(highest, np.nanmax(rms))
    axes.set_ylim(0, 1.1 * highest if highest > 0 else 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    style.label(axes, y="RMS (px)")
    style.own_legend(axes, keys)
    style.caption(axes, "image residuals")


def _of_images(codes, counts, images: int, table: pd.DataFrame) -> np.ndarray:
    """Residuals that count of each image, and the sums of squares of vx and vy (3, images)."""
    out = np.zeros((3, images))
    values = [None, *(table[name].to_numpy(dtype=float) for name in ("vx", "vy"))]
    for first in range(0, len(codes), ROWS_AT_ONCE):
        part = slice(first, first + ROWS_AT_ONCE)
        kept = slice(None) if counts[part].all() else counts[part]
        for k, column in enumerate(values):
            square = None if column is None else column[part][kept] ** 2
            out[k] += np.bincount(codes[part][kept], square, minlength=images)
    return out


def _antenna(panels, block, gnss: pd.DataFrame, position: pd.Series) -> None:
    at = position.reindex(gnss["image"].astype(str)).to_numpy()
    values = maps.columns(gnss, ("vx", "vy", "vz"))
    sigma = maps.columns(gnss, ("sx", "sy", "sz"))
    outlier = gnss["outlier"].to_numpy(bool) if "outlier" in gnss else np.zeros(len(gnss), bool)
    known = [column[np.isfinite(column)] for column in sigma.T]
    band = np.array([np.median(column) if len(column) else 0.0 for column in known])
    sizes = np.abs(values[~outlier])
    reach = 1.15 * max(sizes[np.isfinite(sizes)].max(initial=0.0), band.max(), 1e-6)
    unit, factor = ("mm", 1000.0) if reach < 0.3 else ("m", 1.0)
    row_of = pd.Series(np.arange(len(block.images)), index=block.images["image"].astype(str))
    rows = row_of.reindex(gnss["image"].astype(str)).to_numpy()
    groups = maps.group_styles(block)
    for axes, name, column, sigma in zip(panels, "xyz", values.T, band, strict=True):
        axes.axhspan(-factor * sigma, factor * sigma, color=_BAND, lw=0, zorder=1)
        axes.axhline(0, color=style.QUIET, lw=0.6, zorder=2)
        shown = factor * np.clip(column, -reach, reach)
        for _, members, colour, marker in groups:
            chosen = np.isin(rows, members)
            size = float(np.clip(50 / np.sqrt(max(chosen.sum(), 1)), 1.6, 4.0))
            look = style.dot(marker, colour, size, "white", 0.3)
            axes.plot(at[chosen], shown[chosen], zorder=3, clip_on=False, **look)
        axes.set_ylim(-factor * reach, factor * reach)
        style.label(axes, y=f"{name} ({unit})")
    text = "GNSS residuals" + (" (outliers at the edge)" if outlier.any() else "")
    style.caption(panels[0], text)
    keys = [style.key(name, **style.dot(marker, colour)) for name, _, colour, marker in groups]
    style.own_legend(
        panels[0], [*keys, Patch(color=_BAND, lw=0, label="stated standard deviation")]
    )
