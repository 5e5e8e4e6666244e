"""A track with the exposures on it, and how well each of them is known."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from corridor.core.output import counted, readable, short
from corridor.interface.figures import maps, style

_REFUSED = style.dot("X", "white", 4.5, style.MIDDLE, 1.0)
_AXES = (("x", style.DARK, "-"), ("y", style.LIGHT, "--"), ("z", style.INK, ":"))


def track(
    positions: pd.DataFrame,
    exposures: pd.DataFrame,
    curve: pd.DataFrame,
    max_sigma: float | None = None,
    name: str = "track",
    note: str = "",
    north: str = "N",
) -> Figure:
    """Plan view of a track with its exposures, and the sigmas along the flight.

    positions: the epochs, time_s (s), x, y (m), optional segment: a line ends where it changes.
    exposures: time_s, x, y, sx, sy, sz (m), why ("" where the position is good).
    curve: time_s, sx, sy, sz, segment: sigmas halfway between epochs, all along the track, NaN or
        empty where unknown.
    max_sigma: m, above which positions were refused. north: letter at the arrow along y.
    """
    title = f"{short(name, 50)}: exposures on the track"
    if not len(positions):
        return style.sentence("The track has no epochs.", title)
    low, high = _span(positions, exposures)
    shown = positions[(positions["time_s"] >= low) & (positions["time_s"] <= high)]
    if not len(shown):
        shown = positions
    frame = maps.frame_through(maps.columns(shown), north)
    path = frame.place(maps.columns(shown))
    places = frame.place(maps.columns(exposures))
    good = (exposures["why"] == "").to_numpy()
    limits = maps.extent(path, places)
    # A round flight gets the left half of the sheet, a corridor its whole breadth.
    wide = (limits[1] - limits[0]) > maps.STACKED_FROM * (limits[3] - limits[2])
    if wide:
        height = maps.map_height(limits, 8.5, 4.0)
        below = 1.15 + height + 1.05 + 2.4 + 0.75
        figure = style.sheet(below + 0.3, title, note)
        plan = maps.map_panel(figure, frame, limits, 0.85, 1.15, 8.5, height)
        along = style.panel(figure, 0.85, 1.15 + height + 1.05, 8.85, 2.4)
    else:
        below = 5.75
        figure = style.sheet(below + 0.3, title, note)
        plan = maps.map_panel(figure, frame, limits, 0.85, 1.15, 3.75, 3.85)
        along = style.panel(figure, 6.0, 1.15, 3.7, 3.85)
    segment = shown["segment"].to_numpy() if "segment" in shown else np.zeros(len(shown))
    for number in np.unique(segment):
        plan.plot(*path[segment == number].T, color=style.QUIET, lw=0.7, zorder=2)
    size = float(np.clip(60 / np.sqrt(max(len(places), 1)), 1.8, 5.0))
    plan.plot(*places[good].T, zorder=4, **style.dot("o", style.DARK, size, "white", 0.3))
    plan.plot(*places[~good].T, zorder=5, **_REFUSED)
    keys = [
        style.key("track", color=style.QUIET, lw=0.9),
        style.key(_count(good, "good"), **style.dot("o", style.DARK, 4.5)),
    ]
    if (~good).any():
        keys.append(style.key(_count(~good, "refused"), **_REFUSED))
    style.legend(figure, 0.87, keys)
    keys = _sigmas(along, exposures, good, curve, max_sigma, (low, high), size)
    style.legend(figure, below, keys, left=0.85)
    return figure


def antenna(found) -> Figure:
    """The picture of antenna positions at the exposures (`corridor.gnss.Antenna`)."""
    positions = found.track.table[["time_s", "x", "y"]].copy()
    pieces = found.interpolated.segments
    positions["segment"] = np.searchsorted(
        pieces["first"].to_numpy(), np.arange(len(positions)), side="right"
    )
    placed = found.track.crs is not None or found.track.origin is not None
    return track(
        positions,
        found.interpolated.table,
        found.interpolated.curve,
        found.interpolated.max_sigma,
        name=found.track.source.name,
        note=f"method: {found.interpolated.method}",
        north="N" if placed else "y",
    )


def _count(rows: np.ndarray, word: str) -> str:
    return f"{counted(int(rows.sum()), 'exposure')}, {word}"


def _span(positions, exposures) -> tuple[float, float]:
    """Times worth showing: from the first to the last exposure, with some room."""
    start, end = positions["time_s"].min(), positions["time_s"].max()
    time = exposures["time_s"].to_numpy(dtype=float)
    inside = time[(time >= start) & (time <= end)]
    if not len(inside):
        return float(start), float(end)
    room = 0.03 * max(float(np.ptp(inside)), 10.0)
    return float(inside.min() - room), float(inside.max() + room)


def _sigmas(axes, exposures, good, curve, max_sigma, span, size) -> list[Line2D]:
    style.open_frame(axes)
    style.caption(axes, "standard deviation of the antenna")
    sigma = 1000 * maps.columns(exposures, ("sx", "sy", "sz"))
    every = 1000 * maps.columns(curve, ("sx", "sy", "sz"))
    inside = ((curve["time_s"] >= span[0]) & (curve["time_s"] <= span[1])).to_numpy()
    time = exposures["time_s"].to_numpy(dtype=float)
    values = np.concatenate([sigma.ravel(), every[inside].ravel()])
    values = values[np.isfinite(values) & (values > 0)]
    scale, unit = (60.0, "min") if span[1] - span[0] > 300 else (1.0, "s")
    shown = time[(time >= span[0]) & (time <= span[1])]
    start = float(shown.min()) if len(shown) else span[0]
    style.label(axes, f"time since {_clock(start)} ({unit})", "sigma (mm)")
    axes.set_xlim((span[0] - start) / scale, (span[1] - start) / scale)
    if not len(values):
        axes.set_yticks([])
        style.quiet(axes, "the track states no sigmas")
        return []
    keys = []
    for k, (name, colour, dash) in enumerate(_AXES):
        for number in np.unique(curve["segment"]):
            rows = inside & (curve["segment"] == number).to_numpy()
            at = (curve["time_s"].to_numpy(dtype=float)[rows] - start) / scale
            axes.plot(at, every[rows, k], color=colour, ls=dash, lw=0.8, zorder=2)
        keys.append(style.key(f"sigma {name}", color=colour, ls=dash, lw=1.2))
    keys[-1].set_label("sigma z (lines: halfway between epochs)")
    largest = np.nanmax(np.where(np.isfinite(sigma), sigma, 0.0), axis=1, initial=0.0)
    known = largest > 0
    top = max(values.max(), 1000 * max_sigma if max_sigma and (~good).any() else 0.0)
    rows = good & known
    dot = style.dot("o", style.DARK, 0.8 * size, line=0.0)
    at = (time - start) / scale
    axes.plot(at[rows], largest[rows], zorder=4, clip_on=False, **dot)
    keys.append(style.key("exposure, largest of the three", **dot | {"ms": 4.5}))
    rows = ~good & known & (time >= span[0]) & (time <= span[1])
    axes.plot(at[rows], largest[rows], zorder=4, clip_on=False, **_REFUSED)
    axes.set_yscale("log")
    axes.set_ylim(0.8 * np.percentile(values, 0.5), 1.25 * top)
    low, high = axes.get_ylim()
    range_ = high / low
    subs = range(1, 10) if range_ < 6 else (1, 2, 5) if range_ < 300 else (1,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: readable(float(value))))
    axes.yaxis.set_minor_formatter(NullFormatter())
    if max_sigma and low < 1000 * max_sigma < high:
        look = {"color": style.MIDDLE, "lw": 0.9, "ls": "-."}
        axes.axhline(1000 * max_sigma, **look)
        keys.append(style.key(f"refused above {readable(1000 * max_sigma)} mm", **look))
    return keys


def _clock(seconds: float) -> str:
    hour, rest = divmod(seconds % 86400, 3600)
    return f"{int(hour):02d}:{int(rest // 60):02d}:{rest % 60:04.1f}"
