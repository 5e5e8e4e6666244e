"""How a readout time was measured: photographs, what was fitted to them, and what is left over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from corridor.figures import style

if TYPE_CHECKING:
    from corridor.rolling_shutter import Readout

_LONG = 1000  # px, long side of a photograph as drawn
_MARGIN, _GAP = 0.65, 0.7  # inches


def readout_picture(readout: Readout) -> Figure:
    """Picture of one measured readout time.

    Star and wheel: both photographs with the straight and the bent edges or spokes that were
    fitted, the turn of every measured point against its row with the line whose slope is the
    answer (thesis, figures 7.7 and 7.10), and the residuals along the rows. LED: the photograph,
    the rows' light with its model, and the residuals.
    """
    return _led(readout) if readout.target == "led" else _turning(readout)


def _turning(readout):
    drawing = readout.drawing
    photos = drawing["photos"]
    height, width = photos[0][1].shape
    wide = (style.WIDTH - 2 * _MARGIN - _GAP) / 2
    tall = min(wide * height / width, 1.2 * wide)
    top = 1.05
    lower = top + tall + 0.75
    figure = style.sheet(lower + 3.0, _title(readout), _note(readout))
    for k, (name, grey) in enumerate(photos):
        axes = style.panel(figure, _MARGIN + k * (wide + _GAP), top, wide, tall)
        what = "fitted straight" if k == 0 and readout.extra.get("exposure_ms") is None else "bent"
        style.caption(axes, f"{style.short(name, 40)}, {what}")
        _photo(axes, grey)
        colour = style.LIGHT
        axes.add_collection(LineCollection(drawing["curves"][k], colors=colour, linewidths=0.7))
        used = drawing["weights"][k] > 0.1
        axes.plot(*drawing["points"][k][used].T, ".", color=style.MIDDLE, markersize=0.8, zorder=3)
    line = style.panel(figure, _MARGIN, lower, wide, 2.35)
    style.caption(line, "turn against row: the slope is the answer")
    used = drawing.get("line_weights", drawing["weights"][1]) > 0.1
    row, turned = drawing["row"][used], drawing["turned_deg"][used]
    line.plot(row, turned, ".", color=style.DARK, markersize=1.5)
    ends = np.array([row.min(), row.max()])
    line.plot(ends, drawing["rate_deg"] * ends, color=style.LIGHT, linewidth=1.2)
    letter = "row" if drawing["axis"] == "y" else "column"
    style.label(line, f"{letter} from the axis (px)", "turn (degrees)")
    style.open_frame(line)
    rest = style.panel(figure, _MARGIN + wide + _GAP, lower, wide, 2.35)
    style.caption(rest, "residuals of the bent ones")
    index = 1 if drawing["axis"] == "y" else 0
    used = drawing["weights"][1] > 0.1
    rest.axhline(0, color=style.FAINT, linewidth=0.8)
    rest.plot(
        drawing["points"][1][used][:, index],
        drawing["residuals"][1][used],
        ".",
        color=style.DARK,
        markersize=1.5,
    )
    style.label(rest, f"{letter} (px)", "measured minus modelled (px)")
    style.open_frame(rest)
    return figure


def _led(readout):
    drawing = readout.drawing
    ((name, grey),) = drawing["photos"]
    height, width = grey.shape
    wide = 4.0
    tall = float(np.clip(wide * height / width, 2.2, 4.4))
    figure = style.sheet(1.05 + tall + 0.6, _title(readout), _note(readout))
    axes = style.panel(figure, _MARGIN, 1.05, wide, tall)
    style.caption(axes, style.short(name, 40))
    _photo(axes, grey)
    left = _MARGIN + wide + _GAP
    right = style.WIDTH - left - 0.25
    signal, model = drawing["signal"], drawing["model"]
    rows = np.arange(len(signal))
    upper = style.panel(figure, left, 1.05, right, 0.58 * tall)
    style.caption(upper, "light of the rows, and its model")
    upper.plot(rows, signal, color=style.DARK, linewidth=0.7)
    upper.plot(rows, model, color=style.LIGHT, linewidth=0.9)
    style.label(upper, None, "linear light")
    style.open_frame(upper)
    lower = style.panel(figure, left, 1.05 + 0.7 * tall, right, 0.3 * tall)
    lower.axhline(0, color=style.FAINT, linewidth=0.8)
    lower.plot(rows, signal - model, color=style.DARK, linewidth=0.6)
    letter = "row" if drawing["axis"] == "y" else "column"
    style.label(lower, f"{letter} (px)", "residual")
    style.open_frame(lower)
    return figure


def _photo(axes: Axes, grey):
    height, width = grey.shape
    factor = max(1.0, max(height, width) / _LONG)
    small = cv2.resize(
        grey, (round(width / factor), round(height / factor)), interpolation=cv2.INTER_AREA
    )
    edge = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.imshow(small, cmap="gray", vmin=0, vmax=255, extent=edge, interpolation="bilinear")
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")


def _title(readout):
    return (
        f"Readout time {readout.readout_ms:.4g} ± {readout.sigma_ms:.2g} ms, "
        f"first to last of {readout.rows} rows"
    )


def _note(readout):
    along = readout.row_direction or f"along {readout.row_axis}"
    if readout.frequency_hz is not None:
        return f"rows {along}; LED of {readout.frequency_hz:g} Hz"
    sense = {"cw": "clockwise", "ccw": "counter-clockwise", None: "sense unknown"}
    return (
        f"rows {along}; {readout.angular_velocity_deg_s / 360:.4g} turns a second, "
        f"{sense[readout.rotation_sense]}; {readout.rotation_deg:.3g} degrees during the readout"
    )
