"""How often a hidden effect is detected and named, against how strongly it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from corridor.figures import style
from corridor.report import counted

_SHOWN = (("detected", "detected"), ("named", "named"), ("inside", "in the stated set"))


def naming_rates(
    bins: Sequence[Mapping], title: str = "Detected and named, by signal-to-noise ratio"
) -> Figure:
    """Shares with their 95 % intervals over bins of the ratio.

    bins: each with `from`, `to` (None: no end) and for `detected`, `named`, `inside` the keys
    `share`, `low`, `high`, `count`. Bins without blocks are left out.
    """
    known = [one for one in bins if one["detected"]["count"]]
    if not known:
        return style.sentence("No block with one separable effect.", title)
    total = sum(one["detected"]["count"] for one in known)
    figure = style.sheet(
        4.3, title,
        f"{counted(total, 'block')} with one effect that no other comes near; bars: 95 %",
        width=7.0,
    )  # fmt: skip
    axes = style.panel(figure, 0.8, 1.1, 5.9, 2.5)
    style.open_frame(axes)
    style.label(axes, "signal-to-noise ratio (number of blocks)", "share of blocks, %")
    at = np.arange(len(known))
    keys = []
    for k, (key, word) in enumerate(_SHOWN):
        colour, marker = style.SERIES[k]
        share, low, high = (
            100 * np.array([one[key][name] for one in known]) for name in ("share", "low", "high")
        )
        look = {"color": colour, "marker": marker, "ms": 5.5, "lw": 1.1}
        axes.errorbar(
            at + 0.12 * (k - 1), share, [share - low, high - share], capsize=2.5, elinewidth=0.9,
            ls="none", **look,
        )  # fmt: skip
        keys.append(Line2D([], [], label=word, ls="none", **look))
    names = [
        f"{one['from']:g} to {one['to']:g}"
        if one["to"] is not None
        else f"{one['from']:g} and more"
        for one in known
    ]
    names = [
        f"{name}\n({one['detected']['count']})" for name, one in zip(names, known, strict=True)
    ]
    axes.set_xticks(at, names, size=style.SMALL)
    axes.set_xlim(-0.5, len(known) - 0.5)
    axes.set_ylim(0, 103)
    style.legend(figure, 0.87, keys)
    return figure
