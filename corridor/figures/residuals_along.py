"""Where along the corridor the residuals are large, or drift."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from corridor.figures import maps, style
from corridor.figures.residual_vectors import used
from corridor.report import Adjusted, short


def residuals_along(adjustment: Adjusted) -> Figure:
    """RMS of the image residuals of each image, and the GNSS residuals x, y, z, along the block.

    The distance is that of the camera centre along the block's main axis; where a block has
    no such axis, the images stand in the order of `images.csv`. The band behind the GNSS
    residuals is the stated standard deviation (median), one scale for all three components.
    """
    block = adjustment.block
    title = f"{short(block.name, 50)}: residuals along the block"
    table = used(adjustment)
    gnss = adjustment.residuals.get("gnss")
    gnss = gnss if gnss is not None and len(gnss) else None
    if table is None and gnss is None:
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

    upper = 1.8 if table is not None else 0.0
    lower = 1.05 if gnss is not None else 0.0
    gap = 0.75 if table is not None and gnss is not None else 0.0
    figure = style.sheet(
        1.15 + upper + gap + 3 * lower + (0.3 if lower else 0.0) + 0.6, title, _note(frame)
    )
    known = where[np.isfinite(where)]
    room = 0.015 * max(float(np.ptp(known)), 1.0) if len(known) else 1.0
    limits = (known.min() - room, known.max() + room) if len(known) else (0.0, 1.0)
    distance = MaxNLocator(10, steps=[1, 2, 5, 10], integer=not frame.turned)
    if table is not None:
        axes = style.panel(figure, 0.85, 1.15, 8.85, upper)
        _image_rms(axes, table, position, limits)
        axes.xaxis.set_major_locator(distance)
        if gnss is None:
            style.label(axes, axis)
        else:
            axes.tick_params(labelbottom=False)
    if gnss is not None:
        _antenna(figure, adjustment, gnss, position, limits, 1.15 + upper + gap, lower, axis)
    return figure


def _note(frame: maps.MapFrame) -> str:
    if not frame.turned:
        return ""
    # The sheet's x axis points this way in the world: azimuth from north, clockwise.
    azimuth = np.degrees(np.arctan2(np.cos(frame.angle), np.sin(frame.angle))) % 360
    north = "north" if frame.north == "N" else "y"
    return f"distance along the block grows towards {azimuth:.0f}\u00b0 from {north}, clockwise"


def _image_rms(axes, table: pd.DataFrame, position: pd.Series, limits) -> None:
    category = table["image"].astype("category")
    codes = category.cat.codes.to_numpy()
    number = np.bincount(codes, minlength=len(category.cat.categories))
    at = position.reindex(category.cat.categories.astype(str)).to_numpy()
    size = float(np.clip(60 / np.sqrt(max(len(at), 1)), 1.8, 5.0))
    style.open_frame(axes)
    highest = 0.0
    for column, colour, marker in (("vx", style.DARK, "o"), ("vy", style.LIGHT, "^")):
        values = table[column].to_numpy(dtype=float)
        square = np.bincount(codes, weights=values**2, minlength=len(number))
        with np.errstate(invalid="ignore", divide="ignore"):
            rms = np.sqrt(square / number)
        overall = float(np.sqrt(np.mean(values**2)))
        dash, word = ("-", "line") if column == "vx" else ("--", "dashed")
        axes.axhline(overall, color=colour, lw=0.8, ls=dash, zorder=2)
        axes.plot(
            at,
            rms,
            ls="",
            marker=marker,
            ms=size,
            color=colour,
            mec="white",
            mew=0.3,
            zorder=3,
            label=f"{column[1]} in the image, all together {overall:.2f} px ({word})",
        )
        highest = max(highest, np.nanmax(rms))
    axes.set(xlim=limits, ylim=(0, 1.1 * highest if highest > 0 else 1.0))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    style.label(axes, y="RMS (px)")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=2,
        frameon=False,
        fontsize=style.TEXT,
        labelcolor=style.INK,
        borderaxespad=0.2,
        handletextpad=0.3,
    )
    style.caption(axes, "image residuals")


def _antenna(figure, adjustment, gnss, position, limits, top, height, axis) -> None:
    block = adjustment.block
    at = position.reindex(gnss["image"].astype(str)).to_numpy()
    values = maps.columns(gnss, ("vx", "vy", "vz"))
    sigma = maps.columns(gnss, ("sx", "sy", "sz"))
    outlier = (
        gnss["outlier"].to_numpy(dtype=bool) if "outlier" in gnss else np.zeros(len(gnss), bool)
    )
    band = np.array(
        [np.median(s[np.isfinite(s)]) if np.isfinite(s).any() else 0.0 for s in sigma.T]
    )
    finite = np.abs(values[~outlier])
    finite = finite[np.isfinite(finite)]
    reach = 1.15 * max(float(finite.max()) if len(finite) else 0.0, float(band.max()), 1e-6)
    unit, factor = ("mm", 1000.0) if reach < 0.3 else ("m", 1.0)
    row_of = pd.Series(np.arange(len(block.images)), index=block.images["image"].astype(str))
    rows = row_of.reindex(gnss["image"].astype(str)).to_numpy()
    keys = []
    for number, name in enumerate("xyz"):
        axes = style.panel(figure, 0.85, top + number * (height + 0.15), 8.85, height)
        style.open_frame(axes)
        axes.axhspan(-factor * band[number], factor * band[number], color="#ececec", lw=0, zorder=1)
        axes.axhline(0, color=style.QUIET, lw=0.6, zorder=2)
        for group, members, colour, marker in maps.group_styles(block):
            chosen = np.isin(rows, members)
            size = float(np.clip(50 / np.sqrt(max(chosen.sum(), 1)), 1.6, 4.0))
            axes.plot(
                at[chosen],
                np.clip(factor * values[chosen, number], -factor * reach, factor * reach),
                ls="",
                marker=marker,
                ms=size,
                color=colour,
                mec="white",
                mew=0.3,
                zorder=3,
                clip_on=False,
            )
            if number == 0:
                keys.append(Line2D([], [], ls="", marker=marker, ms=5, color=colour, label=group))
        axes.set(xlim=limits, ylim=(-factor * reach, factor * reach))
        axes.xaxis.set_major_locator(
            MaxNLocator(10, steps=[1, 2, 5, 10], integer=axis.startswith("image"))
        )
        style.label(axes, y=f"{name} ({unit})")
        if number < 2:
            axes.tick_params(labelbottom=False)
        else:
            style.label(axes, axis)
        if number == 0:
            style.caption(
                axes, "GNSS residuals" + (" (outliers at the edge)" if outlier.any() else "")
            )
            keys.append(Patch(color="#ececec", lw=0, label="stated standard deviation"))
            made = axes.legend(
                handles=keys,
                loc="lower right",
                bbox_to_anchor=(1, 1),
                ncols=len(keys),
                frameon=False,
                fontsize=style.TEXT,
                labelcolor=style.INK,
                borderaxespad=0.2,
                handletextpad=0.3,
            )
            for text in made.get_texts():
                text.set_parse_math(False)
