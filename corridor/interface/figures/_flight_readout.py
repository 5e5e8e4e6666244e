"""The readout time from a flight: what each strip says of it, and where the flight was slow."""

import numpy as np
from matplotlib.figure import Figure

from corridor.core.output import rounded, short
from corridor.interface.figures import style

_NAMES, _ROW = 2.35, 0.27  # inches
_OUTSIDE = 6.0  # of the usual spread: what lies further off is cut
_RING = style.dot("o", "none", 10.0, edge=style.MIDDLE, line=1.4)


def flight_readout(found, published: tuple[float, float, str] | None) -> Figure:
    """Picture of a readout time from a flight.

    found: `corridor.readout.FlightReadout`. published: readout, its sigma (s) and whose it is;
    None where none is known. Left: values with bars of one sigma. Right: the flight from above,
    coloured by speed.
    """
    rows = _rows(found, published)
    tall = max(_ROW * len(rows), 2.4)
    value, sigma = rounded(1000 * found.readout, 1000 * found.sigma)
    said = f"{value} \u00b1 {sigma} ms, first to last of {found.rows} rows"
    title = (
        f"Readout time {said}" if found.told else "This flight does not determine the readout time"
    )
    turns = ", turns from rates.csv" if found.turns else ""
    note = f"velocities {found.motion.source}{turns}; bars are one sigma"
    note = note if found.told else f"the adjustment says {said}; {note}"
    figure = style.sheet(tall + 1.9, title, note)
    keys = [
        style.key("by the flight", **style.dot("o", style.DARK)),
        style.key("without one strip", **style.dot("o", "white", edge=style.DARK)),
        style.key("other values", **style.dot("s", style.MIDDLE)),
    ]
    if found.advises:
        keys.append(style.key("to be taken again", **_RING))
    style.legend(figure, 0.86, keys)
    _values(style.panel(figure, _NAMES, 1.2, 3.1, tall), rows)
    _from_above(figure, found, _NAMES + 3.95, 1.2, style.WIDTH - _NAMES - 4.95, tall)
    return figure


def _rows(found, published):
    """Name, value and sigma in ms, look."""
    plain = style.dot("o", style.DARK, 6.0)
    left = style.dot("o", "white", 4.5, edge=style.DARK)
    other = style.dot("s", style.MIDDLE, 5.0)
    rows = [("all images", found.readout, found.sigma, plain)]
    rows += [(f"without {short(o.strip, 26)}", o.readout, o.sigma, left) for o in found.left]
    rows.append(("eight camera parameters", found.eight, found.eight_sigma, other))
    if published is not None:
        rows.append((published[2], published[0], published[1], other))
    return [(name, 1000 * value, 1000 * sigma, look) for name, value, sigma, look in rows]


def _values(axes, rows):
    at = np.arange(len(rows))[::-1]
    name, value, sigma, look = zip(*rows, strict=True)
    for y, v, s, one in zip(at, value, sigma, look, strict=True):
        axes.plot([v - s, v + s], [y, y], color=one["mec"], linewidth=2.2 if y == at[0] else 0.9)
        axes.plot([v], [y], **one)
    axes.axvline(value[0], color=style.FAINT, linewidth=0.8, zorder=0.5)
    axes.axvline(0.0, color=style.QUIET, linewidth=0.6, linestyle=":", zorder=0.5)
    axes.set_yticks(at, name, size=style.SMALL, parse_math=False)
    axes.set_ylim(-0.7, len(rows) - 0.3)
    spread = _OUTSIDE * max(np.median(sigma), sigma[0])
    low = max(min(v - s for v, s in zip(value, sigma, strict=True)), value[0] - spread)
    high = min(max(v + s for v, s in zip(value, sigma, strict=True)), value[0] + spread)
    room = 0.06 * (high - low)
    axes.set_xlim(low - room, high + room)
    for y, v in zip(at, value, strict=True):
        if not low - room < v < high + room:
            edge, side = (1.0, "right") if v > high else (0.0, "left")
            axes.text(
                edge, y, f"{v:.1f}", transform=axes.get_yaxis_transform(), ha=side, va="center",
                size=style.SMALL, color=style.MIDDLE,
            )  # fmt: skip
    style.label(axes, "readout time (ms)")
    style.open_frame(axes)


def _from_above(figure, found, left, top, width, tall):
    axes = style.panel(figure, left, top, width, tall)
    style.caption(axes, "the flight from above")
    speed = np.linalg.norm(found.motion.velocity, axis=1)
    order = np.argsort(found.place[:, 0], kind="stable")
    shown = axes.scatter(
        *found.place[order, :2].T, c=speed[order], cmap=style.COUNTS, s=16, linewidths=0.4,
        edgecolors=style.DARK, vmin=0.0, vmax=max(speed.max(), 0.1),
    )  # fmt: skip
    if found.advises:
        again = np.isin(found.names, found.advice.images)
        axes.plot(*found.place[again, :2].T, **_RING)
    axes.set_aspect("equal", adjustable="datalim")
    style.label(axes, "east (m)", "north (m)")
    style.open_frame(axes)
    style.shade_bar(figure, shown, left + width + 0.15, top, tall, "speed (m/s)")
