"""By how much, and where to, the points of a picture move: arrows over the picture."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.core.output import nice, readable
from corridor.interface.figures import style
from corridor.interface.figures._residual_vectors import arrows, stated_arrow


def image_shift(
    shifts: pd.DataFrame, width: int, height: int, title: str, note: str = ""
) -> Figure:
    """The picture with an arrow a point, drawn at the scale that the arrow above it states.

    shifts: x, y (px, where a point lies), dx, dy (px, where it moves to). width, height: of the
        picture, px.
    """
    across = 6.0
    high = across * height / width
    figure = style.sheet(high + 1.75, title, note, width=across + 1.2)
    axes = style.panel(figure, 0.8, 1.15, across, high)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    style.label(axes, "x (px)", "y (px)")
    longest = float(np.hypot(shifts["dx"], shifts["dy"]).max()) if len(shifts) else 0.0
    if longest == 0:
        style.quiet(axes, "no point of the picture moves")
        return figure
    per_px = across / width
    exaggeration = 0.45 / (per_px * longest)
    arrows(axes, *(shifts[c].to_numpy() for c in ("x", "y", "dx", "dy")), exaggeration, style.DARK)
    axes.plot(shifts["x"], shifts["y"], **style.dot("o", style.QUIET, 1.5))
    length = nice(longest)
    stated_arrow(figure, 0.8, 0.9, length * exaggeration * per_px, f"{readable(length)} px")
    return figure
