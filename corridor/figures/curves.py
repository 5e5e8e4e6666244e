"""Curves of a number against another, with the range over repeated draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from corridor.figures import style

DASHES = ("-", "--", "-.", ":")


@dataclass(frozen=True)
class Panel:
    """One panel of `curves`.

    x: (n,). series: name -> (n,) or (n, draws), of which the median is drawn as a line and the
    range as a band. x_label, y_label: with units. zero: the y axis begins at zero.
    known: the x between which something was measured; beyond them the panel is grey.
    """

    title: str
    x: np.ndarray
    series: Mapping[str, np.ndarray]
    x_label: str
    y_label: str
    zero: bool = True
    known: tuple[float, float] | None = None


def curves(panels: Sequence[Panel], title: str, note: str = "") -> Figure:
    """Panels side by side, the same name with the same line in each, one legend."""
    gap, height = 0.85, 2.6
    width = (style.WIDTH - 0.35 - gap * len(panels)) / len(panels)
    figure = style.sheet(1.25 + height + 0.65, title, note)
    names = list(dict.fromkeys(name for panel in panels for name in panel.series))
    looks = {
        name: {
            "color": style.SERIES[k % 4][0],
            "marker": style.SERIES[k % 4][1],
            "ls": DASHES[k % 4],
        }
        for k, name in enumerate(names)
    }
    for k, panel in enumerate(panels):
        axes = style.panel(figure, gap + k * (width + gap), 1.35, width, height)
        style.open_frame(axes)
        style.caption(axes, panel.title)
        style.label(axes, panel.x_label, panel.y_label)
        for name, values in panel.series.items():
            values = np.asarray(values, dtype=float)
            values = values[:, None] if values.ndim == 1 else values
            middle = np.median(values, axis=1)
            axes.plot(panel.x, middle, lw=1.4, ms=3.5, zorder=4, **looks[name])
            if values.shape[1] > 1:
                axes.fill_between(
                    panel.x, values.min(axis=1), values.max(axis=1),
                    color=looks[name]["color"], alpha=0.18, linewidth=0, zorder=2,
                )  # fmt: skip
        if panel.known is not None:
            left, right = axes.get_xlim()
            for a, b in ((left, panel.known[0]), (panel.known[1], right)):
                axes.axvspan(a, max(a, b), color=style.FAINT, alpha=0.45, lw=0, zorder=0)
            axes.set_xlim(left, right)
        if panel.zero:
            axes.set_ylim(bottom=0)
        else:
            axes.axhline(0, color=style.FAINT, lw=0.8, zorder=1)
    keys = [Line2D([], [], lw=1.4, ms=4, label=name, **look) for name, look in looks.items()]
    style.legend(figure, 0.87, keys)
    return figure


def histograms(
    draws: Mapping[str, np.ndarray], truth: Mapping[str, float], title: str, note: str = ""
) -> Figure:
    """Estimates of several draws, one panel a parameter, the true value as a line.

    draws: "name (unit)" -> (draws,); truth: the same names.
    """
    gap, height, count = 0.75, 2.0, len(draws)
    width = (style.WIDTH - 0.35 - gap * count) / count
    figure = style.sheet(1.0 + height + 0.65, title, note)
    for k, (name, values) in enumerate(draws.items()):
        axes = style.panel(figure, gap + k * (width + gap), 1.0, width, height)
        style.open_frame(axes)
        axes.hist(values, bins=max(6, len(values) // 4), color=style.DARK, rwidth=0.92)
        axes.axvline(truth[name], color=style.MIDDLE, lw=1.6, ls="--")
        axes.ticklabel_format(useOffset=False)
        style.caption(axes, f"{np.mean(values):.1f} \u00b1 {np.std(values, ddof=1):.1f}")
        style.label(axes, name, "draws" if k == 0 else None)
    return figure
