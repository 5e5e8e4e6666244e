"""What was said of blocks, against what was hidden in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from corridor.figures import style
from corridor.report import counted


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
    cell = 0.27
    left = 0.4 + 0.06 * max(map(len, names))
    top = 1.0 + 0.058 * max(map(len, said))
    wide, high = cell * len(said), cell * len(names)
    figure = style.sheet(top + high + 0.35, title, note, width=max(left + wide + 0.4, 6.0))
    axes = style.panel(figure, left, top, wide, high)
    total = np.maximum(table.sum(axis=1, keepdims=True), 1)
    axes.imshow(table / total, cmap=style.COUNTS, vmin=0, vmax=1, aspect="auto")
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(said)), said, rotation=90, size=style.SMALL)
    axes.set_yticks(range(len(names)), names, size=style.SMALL)
    axes.tick_params(length=0)
    for edge in np.arange(0.5, len(names) - 1):
        axes.axhline(edge, color="#ebebeb", lw=0.5)
    for edge in np.arange(0.5, len(said) - 1):
        axes.axvline(edge, color="#ebebeb", lw=0.5)
    for i, j in np.argwhere(table > 0):
        axes.text(
            j, i, str(table[i, j]), ha="center", va="center", size=style.SMALL,
            color="white" if table[i, j] > 0.55 * total[i, 0] else style.INK,
        )  # fmt: skip
    for i, name in enumerate(hidden):
        for j, answer in enumerate(answers):
            if name == answer:
                box = Rectangle(
                    (j - 0.5, i - 0.5), 1, 1, fill=False, ec=style.INK, lw=1.2, zorder=5
                )
                axes.add_patch(box)
    return figure
