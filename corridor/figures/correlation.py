"""Which parameters the block cannot tell apart."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from corridor.figures import style
from corridor.report import Adjusted, short

MOST = 40
STRONG = 0.95


def correlation_matrix(adjustment: Adjusted) -> Figure:
    """Correlations of the camera, effect and lever-arm parameters.

    Lower triangle: a square whose side grows with the coefficient, full cell at 1, dark where
    it is positive, pale with an edge where it is negative (so that grey print keeps the sign).
    Upper triangle: the coefficient, where it is above 0.95. Of more than 40 parameters the 40
    with the strongest correlations are shown.
    """
    title = f"{short(adjustment.block.name, 50)}: correlations of the parameters"
    names, matrix = adjustment.correlation_matrix
    names, matrix = list(names), np.array(matrix, dtype=float).reshape(len(names), len(names))
    if len(names) < 2:
        return style.sentence("Fewer than two parameters were estimated.", title)
    total = len(names)
    note = (
        f"{total} parameters \u00b7 full cell: 1 \u00b7 the coefficient where it is above {STRONG}"
    )
    if total > MOST:
        off = np.abs(np.nan_to_num(matrix - np.diag(np.diag(matrix))))
        strongest = off.max(axis=1)
        kept = np.sort(np.argsort(-strongest, kind="stable")[:MOST])
        left_out = np.delete(strongest, kept).max()
        names, matrix = [names[k] for k in kept], matrix[np.ix_(kept, kept)]
        note = (
            f"the {MOST} of {total:,} parameters with the strongest correlations; "
            f"those left out stay within {left_out:.2f}"
        )
    names = shorter(names, list(adjustment.block.cameras))
    number = len(names)
    cell = float(np.clip(5.6 / number, 0.22, 0.5))
    side = cell * number
    margin = 0.3 + 0.06 * max(len(name) for name in names)
    width = max(margin + side + 0.4, 6.2)
    figure = style.sheet(1.25 + side + margin, title, note, width=width)
    axes = style.panel(figure, margin, 1.2, side, side)
    axes.set(xlim=(-0.5, number - 0.5), ylim=(number - 0.5, -0.5))
    axes.set_xticks(range(number), names, rotation=90, size=style.SMALL)
    axes.set_yticks(range(number), names, size=style.SMALL)
    for text in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        text.set_parse_math(False)
    axes.tick_params(length=0)
    for edge in np.arange(0.5, number - 1):
        axes.axhline(edge, color="#ebebeb", lw=0.5, zorder=0)
        axes.axvline(edge, color="#ebebeb", lw=0.5, zorder=0)
    boxes: dict[bool, list[Rectangle]] = {True: [], False: []}
    digits = 3 if cell >= 0.36 else 2
    for i in range(number):
        for j in range(i):
            value = matrix[i, j]
            if not np.isfinite(value):
                continue
            half = 0.46 * min(abs(value), 1.0)
            boxes[bool(value >= 0)].append(Rectangle((j - half, i - half), 2 * half, 2 * half))
            if abs(value) > STRONG:
                axes.text(
                    i,
                    j,
                    _coefficient(value, digits),
                    ha="center",
                    va="center",
                    color=style.INK,
                    size=style.SMALL if digits == 3 else 5.5,
                )
    axes.add_collection(PatchCollection(boxes[True], facecolor=style.DARK, lw=0, zorder=2))
    axes.add_collection(
        PatchCollection(boxes[False], facecolor="#f3d9a0", edgecolor=style.INK, lw=0.6, zorder=2)
    )
    axes.plot([-0.5, number - 0.5], [-0.5, number - 0.5], color=style.FAINT, lw=0.8, zorder=1)
    style.legend(
        figure,
        0.87,
        [
            Patch(color=style.DARK, lw=0, label="positive"),
            Patch(facecolor="#f3d9a0", edgecolor=style.INK, lw=0.6, label="negative"),
        ],
    )
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
        prefix = f"camera.{cameras[0]}."
        names = [name[len(prefix) :] if name.startswith(prefix) else name for name in names]
    return [short(name, most) for name in names]
