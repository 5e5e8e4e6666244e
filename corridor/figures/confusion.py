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
