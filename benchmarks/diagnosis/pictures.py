"""Pictures of a benchmark: what was said of blocks against what was hidden, and how often.

They are in the style of the package's own pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from corridor.core.output import counted
from corridor.interface.figures import style
from notebooks.kit.drawings import confusion_matrix

__all__ = ["confusion_matrix", "naming_rates"]

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
    total = counted(sum(one["detected"]["count"] for one in known), "block")
    note = f"{total} with one effect that no other comes near; bars: 95 %"
    at = np.arange(len(known))
    looks = [
        {"color": colour, "marker": marker, "ms": 5.5, "lw": 1.1, "ls": "none"}
        for colour, marker in style.SERIES
    ]
    keys = [style.key(word, **look) for (_, word), look in zip(_SHOWN, looks, strict=False)]
    figure, ((axes,),) = style.charts(title, note, [3.15], keys=keys, width=7.0)
    style.label(axes, "signal-to-noise ratio (number of blocks)", "share of blocks, %")
    for k, (key, _) in enumerate(_SHOWN):
        share, low, high = (
            100 * np.array([one[key][name] for one in known]) for name in ("share", "low", "high")
        )
        bars = [share - low, high - share]
        axes.errorbar(at + 0.12 * (k - 1), share, bars, capsize=2.5, elinewidth=0.9, **looks[k])
    names = []
    for one in known:
        end = "and more" if one["to"] is None else f"to {one['to']:g}"
        names.append(f"{one['from']:g} {end}\n({one['detected']['count']})")
    axes.set_xticks(at, names, size=style.SMALL)
    axes.set(xlim=(-0.5, len(known) - 0.5), ylim=(0, 103))
    return figure
