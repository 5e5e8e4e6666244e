"""Pictures of a benchmark: what was said of blocks against what was hidden, and how often.

They are in the style of the package's own pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from corridor.core.output import counted
from corridor.interface.figures import style

_SHOWN = (("detected", "detected"), ("named", "named"), ("inside", "in the stated set"))


def confusion_matrix(
    hidden: Sequence[str],
    answers: Sequence[str],
    counts: Sequence[Sequence[int]],
    title: str = "What was hidden, and what was said",
) -> Figure:
    """A row for each hidden effect, a column for each answer, the number of blocks in the cell.

    counts: (hidden, answers). Cells are shaded by the share of their row; right names are framed.
    """
    table = np.asarray(counts, dtype=int).reshape(len(hidden), len(answers))
    if not table.size:
        return style.sentence("No block with one effect or none.", title)
    blocks = counted(int(table.sum()), "block")
    note = f"{blocks}; shade: share of the row; framed: the right name"
    names = [str(name).replace("_", " ") for name in hidden]
    said = [str(name).replace("_", " ") for name in answers]
    figure, axes = style.matrix(title, note, names, said, 0.27, above=True)
    total = np.maximum(table.sum(axis=1, keepdims=True), 1)
    axes.imshow(table / total, cmap=style.COUNTS, vmin=0, vmax=1, aspect="auto")
    for i, j in np.argwhere(table > 0):
        colour = "white" if table[i, j] > 0.55 * total[i, 0] else style.INK
        look = {"color": colour, "size": style.SMALL, "ha": "center", "va": "center"}
        axes.text(j, i, str(table[i, j]), **look)
    for i, name in enumerate(hidden):
        for j, answer in enumerate(answers):
            if name == answer:
                look = {"fill": False, "ec": style.INK, "lw": 1.2, "zorder": 5}
                axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, **look))
    return figure


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
