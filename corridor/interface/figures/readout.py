"""How a readout time was measured: photographs, what was fitted to them, and what is left over."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from corridor.core.output import rounded, short
from corridor.interface.figures import style

_MOST_SHOWN = 400  # measured points in a photograph
_LONG = 1000  # px, long side of a photograph as drawn
_MARGIN, _GAP = 0.65, 0.7  # inches


def readout_picture(readout) -> Figure:
    """Picture of one measured readout time, a `corridor.readout.Readout`.

    Star and wheel: both photographs with the straight and the bent edges or spokes that were
    fitted, the turn of every measured point against its row with the line whose slope, times the
    rows, is the turn during the readout (Zhou 2019, figures 7.7 and 7.10), and the residuals.
    LED: the photograph, the rows' light with its model, and the residuals.
    """
    return _led(readout) if readout.target == "led" else _turning(readout)


def _turning(readout):
    drawing = readout.drawing
    photos = drawing.photos
    height, width = photos[0].grey.shape
    wide = (style.WIDTH - 2 * _MARGIN - _GAP) / 2
    tall = min(wide * height / width, 1.2 * wide)
    top = 1.3
    lower = top + tall + 0.95
    figure = style.sheet(lower + 3.0, _title(readout), _note(readout))
    measured = {"color": style.MIDDLE, "linestyle": "", "marker": "."}
    keys = [
        style.key("measured", **measured, markersize=5),
        style.key("fitted", color=style.DARK, linewidth=1.2),
    ]
    style.legend(figure, 0.86, keys)
    smeared = readout.extra.get("exposure_ms") is not None
    for k, photo in enumerate(photos):
        axes = style.panel(figure, _MARGIN + k * (wide + _GAP), top, wide, tall)
        what = "straight" if k == 0 and not smeared else "bent"
        style.caption(axes, f"{short(photo.name, 40)}: {what}")
        _photo(axes, photo)
        shown = drawing.points[drawing.used & (drawing.which == k)]
        # Not all of them: the edge is to be seen between them.
        shown = shown[:: -(-len(shown) // _MOST_SHOWN) or 1]
        axes.plot(*shown.T, **measured, markersize=3.0, zorder=2)
        axes.add_collection(
            LineCollection(drawing.curves[k], colors=style.DARK, linewidths=0.6, zorder=3)
        )
    # Rows of the sensor are columns of the picture where they follow each other along x.
    along_y = readout.row_axis == "y"
    letter = "row" if along_y else "column"
    line = style.panel(figure, _MARGIN, lower, wide, 2.35)
    rate, steps = drawing.rate_deg, readout.rows - 1
    style.caption(
        line, f"slope {abs(rate):.4g}\u00b0/px, times {steps} px: {abs(rate) * steps:.4g}\u00b0"
    )
    used = drawing.used & drawing.moving
    row, turned = drawing.row[used], drawing.turned_deg[used]
    line.plot(row, turned, **measured, markersize=2.5)
    ends = np.array([row.min(), row.max()])
    line.plot(ends, rate * ends, color=style.DARK, linewidth=0.9)
    style.label(line, f"{letter} from the axis (px)", "turn (degrees)")
    style.open_frame(line)
    rest = style.panel(figure, _MARGIN + wide + _GAP, lower, wide, 2.35)
    used = drawing.used & (drawing.which == 1)
    left = drawing.residuals[used]
    style.caption(rest, f"residuals, turning: RMS {np.sqrt(np.mean(left**2)):.2g} px")
    rest.axhline(0, color=style.FAINT, linewidth=0.8)
    at = drawing.points[used][:, 1 if along_y else 0]
    rest.plot(at, left, **measured, markersize=2.5)
    style.label(rest, f"{letter} (px)", "measured minus fitted (px)")
    style.open_frame(rest)
    return figure


def _led(readout):
    drawing = readout.drawing
    photo = drawing.photo
    height, width = photo.grey.shape
    wide = 4.0
    tall = float(np.clip(wide * height / width, 2.6, 4.4))
    top = 1.3
    figure = style.sheet(top + tall + 0.65, _title(readout), _note(readout))
    keys = [
        style.key("measured", color=style.LIGHT, linewidth=2.4),
        style.key("fitted", color=style.DARK, linewidth=0.8),
    ]
    style.legend(figure, 0.86, keys)
    axes = style.panel(figure, _MARGIN, top, wide, tall)
    style.caption(axes, short(photo.name, 40))
    _photo(axes, photo, pale=False)
    left = _MARGIN + wide + _GAP + 0.15
    right = style.WIDTH - left - 0.25
    signal, model = 100 * drawing.signal, 100 * drawing.model
    rows = np.arange(len(signal))
    upper = style.panel(figure, left, top, right, 0.55 * tall)
    style.caption(upper, f"light of the rows: {readout.extra['stripes']:.2f} periods")
    upper.plot(rows, signal, color=style.LIGHT, linewidth=2.0)
    upper.plot(rows, model, color=style.DARK, linewidth=0.6)
    upper.tick_params(labelbottom=False)
    style.label(upper, None, "linear light (% of white)")
    style.open_frame(upper)
    lower = style.panel(figure, left, top + 0.68 * tall, right, 0.32 * tall)
    lower.axhline(0, color=style.FAINT, linewidth=0.8)
    lower.plot(rows, signal - model, color=style.DARK, linewidth=0.6)
    letter = "row" if readout.row_axis == "y" else "column"
    style.label(lower, f"{letter} (px)", "residual (%)")
    style.open_frame(lower)
    return figure


def _photo(axes: Axes, photo, pale=True):
    """The photograph; pale where something is drawn over it that dark parts would hide."""
    height, width = photo.grey.shape
    small, _ = photo.shrunk(_LONG)
    edge = (-0.5, width - 0.5, height - 0.5, -0.5)
    darkest = -255 if pale else 0
    axes.imshow(small, cmap="gray", vmin=darkest, vmax=255, extent=edge, interpolation="bilinear")
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal", anchor="N")
    style.label(axes, "column (px)", "row (px)")


def _title(readout):
    value, sigma = rounded(readout.readout_ms, max(readout.sigma_ms, 1e-5))
    return f"Readout time {value} \u00b1 {sigma} ms, first to last of {readout.rows} rows"


def _note(readout):
    along = readout.row_direction or f"along {readout.row_axis}"
    if readout.frequency_hz is not None:
        return f"rows {along}; LED of {readout.frequency_hz:g} Hz"
    sense = {"cw": "clockwise", "ccw": "counter-clockwise", None: "sense unknown"}
    return (
        f"rows {along}; {readout.angular_velocity_deg_s / 360:.4g} turns a second, "
        f"{sense[readout.rotation_sense]}; {readout.rotation_deg:.3g} degrees during the readout"
    )
