"""How accurate a flight will be, against what is surveyed on the ground."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from corridor.core.block import Block
from corridor.core.output import readable, short
from corridor.interface.figures import maps, style

_DASHES = ("-", (0, (5, 2)), (0, (1, 1.6)), (0, (5, 1.5, 1, 1.5)))
_STEPS = np.array([s * 10.0**k for k in range(-3, 5) for s in (1, 2, 5)])
_ROW = 3  # keys beside each other


def accuracy_by_control(
    series: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]],
    title: str = "How accurate with how many control points",
    note: str = "expected RMS of check points",
) -> Figure:
    """Error against number of control points: a line a flight set, plan and height beside.

    series: flight set -> numbers of control points (n,), errors horizontal and in height (n,),
    metres; NaN where the flight set cannot be adjusted. Logarithmic, so that one look tells
    factors; flight sets that lie on each other are drawn one inside the other.
    """
    names = list(series)
    known = [values[np.isfinite(values)] for _, *both in series.values() for values in both]
    values = 1000 * np.concatenate([np.zeros(0), *known])
    if not len(values):
        return style.sentence("None of these flight sets can be adjusted.", title)
    looks = {name: _look(k, len(names)) for k, name in enumerate(names)}
    rows = -(-len(names) // _ROW)
    # Room for the rows of keys stands above the panels.
    figure, (panels,) = style.charts(title, note, [3.65], 2, head=0.95 + 0.22 * rows)
    for k, name in enumerate(names):
        row, column = divmod(k, _ROW)
        keys = [style.key(short(name, 40), **looks[name])]
        style.legend(figure, 0.83 + 0.22 * row, keys, left=0.25 + 3.15 * column)
    counts = np.unique(np.concatenate([np.asarray(count) for count, *_ in series.values()]))
    low, high = values.min() / 1.25, values.max() * 1.25
    ticks = _STEPS[(low <= _STEPS) & (high >= _STEPS)]
    span = max(float(np.ptp(counts)), 1.0)
    for k, (axes, caption) in enumerate(
        zip(panels, ("horizontal (x and y together)", "height"), strict=True)
    ):
        style.caption(axes, caption)
        style.label(axes, "control points", "mm" if k == 0 else None)
        axes.set(yscale="log", ylim=(low, high))
        axes.yaxis.set_major_locator(FixedLocator(ticks))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: readable(value)))
        axes.yaxis.set_minor_locator(FixedLocator([]))
        for tick in ticks:
            axes.axhline(tick, color=style.FAINT, lw=0.5, zorder=1)
        axes.xaxis.set_major_locator(FixedLocator(counts))
        axes.set_xlim(counts.min() - 0.06 * span, counts.max() + 0.06 * span)
        for name, (count, *both) in series.items():
            axes.plot(count, 1000 * np.asarray(both[k]), zorder=4, **looks[name])
    return figure


def control_map(block: Block, title: str) -> Figure:
    """Where a planned flight takes its images, and where its control and check points lie.

    block: images with poses, ground points with roles. Metres, of the plan.
    """
    frame = maps.frame_of(block)
    limits = maps.extent(
        frame.place(maps.centres(block)), frame.place(maps.columns(block.ground)), margin=0.06
    )
    height = maps.map_height(limits, 8.5, 6.0)
    note = "where to survey; check points are those that the expected errors are about"
    figure = style.sheet(1.15 + height + 0.7, title, note)
    axes = maps.map_panel(figure, frame, limits, 0.8, 1.15, 8.5, height)
    keys = maps.draw_cameras(axes, frame, block)
    style.legend(figure, 0.87, [*keys, *maps.draw_ground(axes, frame, block)])
    return figure


def _look(k: int, count: int) -> dict:
    """Lines that lie on each other differ in width: the first is the widest."""
    colour, marker = style.SERIES[k % 4]
    hollow = k >= 4
    return {
        "color": colour,
        "marker": marker,
        "ls": _DASHES[(k // 4 + k) % 4],
        "lw": 1.3,
        "ms": 6.5 - 3.0 * k / max(count - 1, 1),
        "mfc": "white" if hollow else colour,
        "mew": 1.2,
    }
