"""Which effects a flight cannot tell apart."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from corridor.interface.figures import style

# Shares from which on a number is written, and those where its cell is too dark for ink.
WORTH, DARK_CELL = 0.3, 0.62


def alike(table: pd.DataFrame, name: str = "", least: float = 0.0) -> Figure:
    """Shares of a confusability table, dark where another effect explains the same.

    table: row the effect that acts, column the one that imitates it, 0 to 1
    (`corridor.diagnosis.confusability`). least: effects none of whose shares reach it are left
    out, and the note says how many.
    """
    title = f"{name}: which effects look alike" if name else "Which effects look alike"
    values = table.to_numpy(float) - np.eye(len(table))
    kept = np.maximum(values.max(axis=0, initial=0), values.max(axis=1, initial=0)) >= least
    names = [slug.replace("_", " ") for slug, keep in zip(table.index, kept, strict=True) if keep]
    if len(names) < 2:
        return style.sentence("No two effects are alike here.", title)
    values = values[np.ix_(kept, kept)]
    note = "share of the effect on the left that the one below explains"
    if len(names) < len(table):
        note += f" \u00b7 {len(table) - len(names)} effects below {least:g} left out"
    cell = float(np.clip(6.2 / len(names), 0.28, 0.45))
    figure, axes = style.matrix(title, note, names, names, cell)
    axes.imshow(values, cmap=style.COUNTS, vmin=0, vmax=1, aspect="auto")
    for row, column in np.argwhere(values >= WORTH):
        share = values[row, column]
        look = {"color": "white" if share > DARK_CELL else style.INK, "size": style.SMALL - 0.5}
        axes.text(column, row, f"{share:.2f}".lstrip("0"), ha="center", va="center", **look)
    for k in range(len(names)):
        axes.text(k, k, "\u00b7", ha="center", va="center", color=style.QUIET)
    return figure
