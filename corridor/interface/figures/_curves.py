"""Curves of a number against another, with the range over repeated draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from corridor.interface.figures import style

DASHES = ("-", "--", "-.", ":")


@dataclass(frozen=True)
class Panel:
    """One panel of `curves`.

    x: (n,). series: name -> (n,) or (n, draws), of which the median is drawn as a line and the
    range as a band. x_label, y_label: with units. zero: the y axis begins at zero.
    known: the x between which something was measured; beyond them the panel is grey.
    joined: by lines; else dots only.
    """

    title: str
    x: np.ndarray
    series: Mapping[str, np.ndarray]
    x_label: str
    y_label: str
    zero: bool = True
    known: tuple[float, float] | None = None
    joined: bool = True


def curves(panels: Sequence[Panel], title: str, note: str = "") -> Figure:
    """Panels side by side, the same name with the same line in each, one legend."""
    names = dict.fromkeys(name for panel in panels for name in panel.series)
    looks = {
        name: {"color": colour, "marker": marker, "ls": DASHES[k % 4], "lw": 1.4}
        for k, name in enumerate(names)
        for colour, marker in [style.SERIES[k % 4]]
    }
    keys = [style.key(name, ms=4, **look) for name, look in looks.items()]
    figure, (row,) = style.charts(title, note, [3.35], len(panels), keys)
    for axes, panel in zip(row, panels, strict=True):
        style.caption(axes, panel.title)
        style.label(axes, panel.x_label, panel.y_label)
        for name, values in panel.series.items():
            values = np.asarray(values, dtype=float)
            values = values[:, None] if values.ndim == 1 else values
            look = looks[name] if panel.joined else looks[name] | {"ls": ""}
            axes.plot(panel.x, np.median(values, axis=1), ms=3.5, zorder=4, **look)
            if values.shape[1] > 1:
                ends = values.min(axis=1), values.max(axis=1)
                look = {"color": looks[name]["color"], "alpha": 0.18, "linewidth": 0}
                axes.fill_between(panel.x, *ends, zorder=2, **look)
        if panel.known is not None:
            left, right = axes.get_xlim()
            for a, b in ((left, panel.known[0]), (panel.known[1], right)):
                axes.axvspan(a, max(a, b), color=style.FAINT, alpha=0.45, lw=0, zorder=0)
            axes.set_xlim(left, right)
        if panel.zero:
            axes.set_ylim(bottom=0)
        else:
            axes.axhline(0, color=style.FAINT, lw=0.8, zorder=1)
    return figure


def estimates(
    draws: Mapping[str, np.ndarray], truth: Mapping[str, float], title: str, note: str = ""
) -> Figure:
    """Estimates of several draws, one panel a parameter, the true value as a line.

    A dot a draw, in order of size; grey is the mean and one standard deviation to either side.

    draws: "name (unit)" -> (draws,); truth: the same names.
    """
    figure, (row,) = style.charts(title, note, [2.85], len(draws))
    for axes, (name, values) in zip(row, draws.items(), strict=True):
        # A dot a draw: bars of a few draws look skewed where they are not.
        order = np.arange(1, len(values) + 1)
        mean, spread = np.mean(values), np.std(values, ddof=1)
        axes.axvspan(mean - spread, mean + spread, color=style.FAINT, alpha=0.45, lw=0, zorder=0)
        axes.axvline(mean, color=style.QUIET, lw=0.8, zorder=1)
        axes.axvline(truth[name], color=style.MIDDLE, lw=1.6, ls="--", zorder=2)
        axes.plot(np.sort(values), order, zorder=3, **style.dot("o", style.DARK, 4))
        axes.set_ylim(0, len(values) + 1)
        axes.ticklabel_format(useOffset=False)
        style.caption(axes, f"{mean:.1f} \u00b1 {spread:.1f}")
        style.label(axes, name, "draws, in order of size" if axes is row[0] else None)
    return figure
