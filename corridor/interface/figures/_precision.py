"""How precise points are, in plan and in height, with and without the datum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from corridor.core.output import millimetres
from corridor.interface.figures import maps, style

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

MOST_POINTS = 6000
_ROWS = ("plan", "height")
# The most precise is seen on white paper, too.
_SHADES = LinearSegmentedColormap.from_list("corridor_sigmas", ["#cfdcea", "#5c8ab8", "#001f45"])


def precision_maps(adjustment: Adjustment) -> Figure:
    """Maps of the standard deviations of the points, exact, of an adjustment.

    Above in plan (of the two the root of the sum of squares), below in height; on the left as
    adjusted, with what control and GNSS leave to the position of the whole; on the right among
    themselves. One scale of shades for all. Source: James, Robson and Smith 2017.
    """
    block, points = adjustment.block, adjustment.points
    absolute = pd.DataFrame(points[["point", "x", "y", "z"]])
    absolute[["sx", "sy", "sz"]] = adjustment.point_sigma
    cases = {"in the datum of the block": absolute}
    cases["among themselves, without the datum"] = adjustment.relative_precision()
    frame = maps.frame_of(block)
    ground = frame.place(maps.columns(block.ground))
    shown = {}
    for name, table in cases.items():
        sigma = maps.columns(table, ("sx", "sy", "sz"))
        table = table.iloc[np.flatnonzero(np.isfinite(sigma).all(axis=1))]
        step = max(-(-len(table) // MOST_POINTS), 1)
        table = table.iloc[::step]
        sigma = maps.columns(table, ("sx", "sy", "sz"))
        shown[name] = (
            frame.place(maps.columns(table)), (np.hypot(sigma[:, 0], sigma[:, 1]), sigma[:, 2])
        )  # fmt: skip
    places = np.vstack([maps.body(place) for place, _ in shown.values()])
    limits = maps.extent(places, ground)
    every = np.concatenate([np.concatenate(values) for _, values in shown.values()])
    if not len(every) or not (every > 0).any():
        return style.sentence("no point has a standard deviation", "Precision of the points")
    low, high = np.percentile(every[every > 0], [2.0, 98.0])
    norm = LogNorm(low, max(high, 3.0 * low), clip=True)
    plan = millimetres(float(np.median(shown["in the datum of the block"][1][0])))
    up = millimetres(float(np.median(shown["in the datum of the block"][1][1])))
    title = f"Half of the points are better than {plan} horizontally and {up} in height"
    width = 3.9
    height = maps.map_height(limits, width, 3.2)
    note = "standard deviation of each point (one sigma), exact \u00b7 one scale of shades"
    figure = style.sheet(1.15 + 2 * (height + 0.75), title, note)
    for column, (name, (place, values)) in enumerate(shown.items()):
        for row, (kind, sigma) in enumerate(zip(_ROWS, values, strict=True)):
            axes = style.panel(
                figure, 0.75 + column * (width + 0.45), 1.1 + row * (height + 0.75), width, height
            )
            maps.at_one_scale(axes, limits, width, height)
            order = np.argsort(sigma, kind="stable")
            image = axes.scatter(
                *place[order].T, c=sigma[order], s=3.0, cmap=_SHADES, norm=norm, linewidths=0
            )
            style.caption(axes, f"{kind}, {name}")
            labels = frame.labels
            style.label(axes, labels[0] if row else None, None if column else labels[1])
            control = block.ground["role"].astype(str).to_numpy() == "control"
            if control.any():
                axes.plot(*ground[control].T, zorder=6, **style.dot("^", "white", 5.0, style.INK))
    bar = style.panel(figure, 9.05, 1.1, 0.1, 2 * height + 0.75)
    figure.colorbar(image, cax=bar)
    bar.yaxis.set_major_locator(LogLocator(10.0, (1.0, 2.0, 5.0)))
    bar.yaxis.set_minor_formatter(NullFormatter())
    bar.yaxis.set_major_formatter(FuncFormatter(lambda sigma, _: millimetres(sigma)))
    return figure
