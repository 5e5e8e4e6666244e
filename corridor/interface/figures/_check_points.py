"""How far the adjusted check points lie from where they were surveyed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.core.output import counted, millimetres, nice, readable, short
from corridor.interface.figures import maps, style
from corridor.interface.figures._residual_vectors import arrows, stated_arrow

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

NONE = "No check points: nothing independent of the adjustment tests it."
MOST_NAMES = 40
_CONTROL = style.dot("^", style.INK, 6.5)
_CHECK = style.dot("o", "white", 4.5, style.INK)


def check_points(adjustment: Adjustment) -> Figure:
    """Map of the check-point differences, adjusted minus given.

    Horizontal as arrows, height as a bar up (too high) or down (too low), both at one stated scale.
    """
    return _maps([adjustment], [""])


def compare_check_points(
    a: Adjustment, b: Adjustment, labels: tuple[str, str] = ("first", "second")
) -> Figure:
    """The check-point differences of two adjustments of one block, at one stated scale."""
    return _maps([a, b], list(labels))


def check_points_moved(before: Adjustment, after: Adjustment) -> Figure:
    """The check-point differences before (grey) and after (in colour) on one map."""
    return _maps([before, after], ["before", "after"], one_map=True)


def _maps(results: list[Adjustment], labels: list[str], one_map: bool = False) -> Figure:
    title = f"{short(results[0].block.name, 50)}: check points, adjusted minus given"
    if not any(len(result.check_points) for result in results):
        return style.sentence(NONE, title)
    frame = maps.frame_of(results[0].block)
    tables = [_table(result, frame) for result in results]
    places = [maps.centres(r.block) for r in results] + [
        maps.columns(r.block.ground) for r in results
    ]
    inner = maps.extent(*(frame.place(p) for p in places))
    long = (inner[1] - inner[0]) > maps.STACKED_FROM * (inner[3] - inner[2])
    beside = len(results) > 1 and not long and not one_map
    width = 8.5 if not beside else 4.0
    # The longest difference takes an eighth of the sheet's width, whatever the block's.
    longest = max(
        float(np.nanmax(np.abs(t[["px", "py", "dz"]].to_numpy()), initial=0.0)) for t in tables
    )
    metres_per_inch = (inner[1] - inner[0]) / width
    exaggeration = nice(1.1 * metres_per_inch / max(longest, 1e-9))
    tips = [t[["x", "y"]].to_numpy() + exaggeration * t[["px", "py"]].to_numpy() for t in tables]
    bars = [np.column_stack([t["x"], t["y"] + exaggeration * t["dz"]]) for t in tables]
    limits = maps.extent(np.array(inner).reshape(2, 2).T, *tips, *bars, margin=0.02)
    height = maps.map_height(limits, width, 4.2 if beside else 5.5)

    head, gap = 1.5, 0.85
    rows = 1 if beside or one_map else len(results)
    figure = style.sheet(
        head + rows * (height + gap) - 0.15,
        title,
        f"horizontal and height exaggerated {readable(exaggeration)} times",
    )
    keys: list = []
    if one_map:
        axes = maps.map_panel(figure, frame, limits, 0.8, head, width, height)
        _draw_earlier(axes, tables[0], exaggeration)
        keys = _draw(axes, frame, results[1], tables[1], exaggeration, keys)
        keys.append(style.key("before", color=style.QUIET, marker=">", ms=5, lw=1.2))
        told = zip(labels, results, strict=True)
        style.caption(axes, "; ".join(f"{word}: {_numbers(one, True)}" for word, one in told))
    panels = [] if one_map else list(zip(results, tables, labels, strict=True))
    for number, (result, table, label) in enumerate(panels):
        left = 0.8 + (number * 4.8 if beside else 0.0)
        top = head + (0.0 if beside else number * (height + gap))
        axes = maps.map_panel(figure, frame, limits, left, top, width, height)
        keys = _draw(axes, frame, result, table, exaggeration, keys)
        text = ": ".join(part for part in (short(label, 30), _numbers(result, beside)) if part)
        style.caption(axes, text)
    span = np.ptp(axes.get_xlim())
    length = nice(1.0 * span / width / exaggeration)
    style.legend(figure, 0.87, keys)
    inches = length * exaggeration * width / span
    stated_arrow(figure, 9.7 - inches - 0.75, 0.52, inches, f"{readable(length)} m")
    return figure


def _table(result: Adjustment, frame: maps.MapFrame) -> pd.DataFrame:
    """Place and differences of each check point on the sheet, metres."""
    ground = pd.DataFrame(
        maps.columns(result.block.ground), index=result.block.ground["point"].astype(str)
    )
    ground = ground[~ground.index.duplicated()]
    names = result.check_points["point"].astype(str).to_numpy() if len(result.check_points) else []
    place = frame.place(ground.reindex(names).to_numpy())
    moved = frame.turn(maps.columns(result.check_points, ("dx", "dy")))
    table = pd.DataFrame({"point": names})
    table[["x", "y"]], table[["px", "py"]] = place, moved
    return table.assign(dz=maps.columns(result.check_points, ("dz",))[:, 0])


def _draw(axes, frame, result, table, exaggeration, keys) -> list:
    keys = list(keys) or _keys(result)
    maps.draw_cameras(axes, frame, result.block, faint=True)
    ground = result.block.ground
    control = ground["role"].astype(str).to_numpy() == "control"
    places = frame.place(maps.columns(ground))[control]
    axes.plot(*places.T, zorder=5, **_CONTROL)
    if not len(table):
        style.quiet(axes, "no check points")
        return keys
    x, y = table["x"].to_numpy(), table["y"].to_numpy()
    rise = exaggeration * table["dz"].to_numpy()
    axes.vlines(x, y, y + rise, color=style.LIGHT, lw=4.0, zorder=4)
    axes.plot(x, y, zorder=5, **_CHECK)
    arrows(axes, x, y, table["px"], table["py"], exaggeration, style.DARK, 6)
    if len(table) + control.sum() <= MOST_NAMES:
        here = np.column_stack([x, y])
        along = exaggeration * table[["px", "py"]].to_numpy()
        upright = np.column_stack([0 * x, rise])
        clear = [here + s * way for s in np.linspace(0.0, 1.0, 12) for way in (along, upright)]
        names = [*table["point"], *ground["point"].astype(str).to_numpy()[control]]
        style.name_points(axes, np.vstack([here, places]), names, np.vstack(clear))
    return keys


def _draw_earlier(axes, table, exaggeration) -> None:
    """Arrows and bars of another adjustment, grey, below those to come; bars stand to the left."""
    x, y = table["x"].to_numpy(), table["y"].to_numpy()
    left = x - 0.006 * np.ptp(axes.get_xlim())
    rise = y + exaggeration * table["dz"].to_numpy()
    axes.vlines(left, y, rise, color=style.FAINT, lw=4.0, zorder=3)
    arrows(axes, x, y, table["px"], table["py"], exaggeration, style.QUIET, 3)


def _keys(result: Adjustment) -> list:
    keys = [
        style.key("horizontal", color=style.DARK, marker=">", ms=5, lw=1.2),
        style.key("height (up: too high)", color=style.LIGHT, lw=4),
        style.key("check point", **_CHECK),
    ]
    if (result.block.ground["role"].astype(str) == "control").any():
        keys.append(style.key("control point", **_CONTROL))
    return [*keys, style.key("image", **style.dot(".", style.FAINT))]


def _numbers(result: Adjustment, brief: bool) -> str:
    """RMS of the check points, as the table has it."""
    if not len(result.check_points):
        return ""
    rms = result.check_rms
    text = f"RMS horizontal {millimetres(rms.xy)}, height {millimetres(rms.z)}"
    if not brief:
        text += f", 3D {millimetres(rms.d3)} at {counted(len(result.check_points), 'check point')}"
    return text
