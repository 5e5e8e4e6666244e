"""Which parameters the block cannot tell apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from corridor.core.output import short
from corridor.interface.figures import style

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment

MOST_PARAMETERS = 40
STRONG = 0.95
# A positive coefficient is dark, a negative one pale with an edge.
_SIGNS = (
    {"facecolor": style.DARK, "lw": 0.0},
    {"facecolor": "#f3d9a0", "edgecolor": style.INK, "lw": 0.6},
)


def correlation_matrix(adjustment: Adjustment) -> Figure:
    """Correlations of the camera, effect and lever-arm parameters.

    Lower triangle: a square whose side grows with the coefficient, full cell at 1, dark where
    it is positive, pale with an edge where it is negative (so that grey print keeps the sign).
    Upper triangle: the coefficient, where it is above 0.95. Of more than 40 parameters the 40
    with the strongest correlations are shown.
    """
    title = f"{short(adjustment.block.name, 50)}: correlations of the parameters"
    table = adjustment.correlation_matrix
    names, matrix = list(table), table.to_numpy(dtype=float)
    if len(names) < 2:
        return style.sentence("Fewer than two parameters were estimated.", title)
    total = len(names)
    note = (
        f"{total} parameters \u00b7 full cell: 1 \u00b7 the coefficient where it is above {STRONG}"
    )
    if total > MOST_PARAMETERS:
        off = np.abs(np.nan_to_num(matrix - np.diag(np.diag(matrix))))
        strongest = off.max(axis=1)
        kept = np.sort(np.argsort(-strongest, kind="stable")[:MOST_PARAMETERS])
        left_out = np.delete(strongest, kept).max()
        names, matrix = [names[k] for k in kept], matrix[np.ix_(kept, kept)]
        note = (
            f"the {MOST_PARAMETERS} of {total:,} parameters with the strongest correlations; "
            f"those left out stay within {left_out:.2f}"
        )
    names = shorter(names, list(adjustment.block.cameras))
    number = len(names)
    cell = float(np.clip(5.6 / number, 0.22, 0.5))
    keys = [
        Patch(**look, label=sign)
        for sign, look in zip(("positive", "negative"), _SIGNS, strict=True)
    ]
    figure, axes = style.matrix(title, note, names, names, cell, keys)
    boxes: tuple[list, list] = ([], [])
    digits = 3 if cell >= 0.36 else 2
    for i in range(number):
        for j in range(i):
            value = matrix[i, j]
            if not np.isfinite(value):
                continue
            half = 0.46 * min(abs(value), 1.0)
            boxes[int(value < 0)].append(Rectangle((j - half, i - half), 2 * half, 2 * half))
            if abs(value) > STRONG:
                look = {"color": style.INK, "size": style.SMALL if digits == 3 else 5.5}
                text = _coefficient(value, digits)
                axes.text(i, j, text, ha="center", va="center", **look)
    for drawn, look in zip(boxes, _SIGNS, strict=True):
        axes.add_collection(PatchCollection(drawn, zorder=2, **look))
    axes.plot([-0.5, number - 0.5], [-0.5, number - 0.5], color=style.FAINT, lw=0.8, zorder=1)
    return figure


def _coefficient(value: float, digits: int) -> str:
    """0.987 as .987 or .99; never rounded up to 1, which it is not."""
    size = min(abs(value), 1.0)
    text = f"{size:.{digits}f}"
    if text.startswith("1") and size < 1:
        text = f"{np.floor(size * 10**digits) / 10**digits:.{digits}f}+"
    return ("\u2212" if value < 0 else "") + text.lstrip("0")


def shorter(names: list[str], cameras: list[str], most: int = 30) -> list[str]:
    """Names of parameters without what they all share: one camera need not be named."""
    if len(cameras) == 1:
        names = [name.removeprefix(f"camera.{cameras[0]}.") for name in names]
    return [short(name, most) for name in names]
