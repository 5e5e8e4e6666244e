"""Pictures of a diagnosis: how strongly the data speak for every candidate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullLocator

from corridor.figures import style
from corridor.report import counted, short

# Inches: a row, the names, the numbers, and above and below the rows.
ROW, NAMES, NUMBERS, TOP, BOTTOM = 0.235, 4.15, 0.65, 1.35, 0.65
LEAST = 1.0
LIMITS = {
    "named": ("-", "named"),
    "beside_noise": (":", "named (GNSS)"),
    "suspected": ("--", "suspected"),
}


def evidence_bars(
    evidence: pd.DataFrame, threshold: Mapping[str, float], name: str = "block"
) -> Figure:
    """Log evidence of every candidate as bars on a logarithmic scale, beside the thresholds.

    evidence: name, generic, found (bool), alone and beside (log evidence by itself, and beside
    what was found), a row a candidate, drawn in their order. threshold: `named`, `suspected`, and
    `beside_noise` for what is named though noise of the antenna looks like it.
    What is below one is not drawn: such a candidate explains nothing.
    """
    title = f"{short(name, 40)}: evidence of all candidates"
    if not len(evidence):
        return style.sentence("No effect could be tested in this block.", title)
    rows = len(evidence)
    note = f"{counted(rows, 'candidate')}, {int(evidence['found'].sum())} found"
    figure = style.sheet(TOP + ROW * rows + BOTTOM, title, note)
    width = style.WIDTH - NAMES - NUMBERS - 0.3
    axes = style.panel(figure, NAMES, TOP, width, ROW * rows)
    style.open_frame(axes)
    values = evidence[["alone", "beside"]].to_numpy(float)
    most = max(float(np.nanmax(values, initial=LEAST)), *threshold.values(), 10.0)
    axes.set(xscale="log", xlim=(LEAST, 1.6 * most), ylim=(rows - 0.4, -0.6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.yaxis.set_major_locator(NullLocator())
    for limit, (dashes, _) in LIMITS.items():
        axes.axvline(max(threshold[limit], LEAST), color=style.INK, lw=1.0, ls=dashes, zorder=1)
    for k, row in enumerate(evidence.itertuples(index=False)):
        if row.alone > LEAST:
            axes.barh(
                k, row.alone - LEAST, 0.62, LEAST, zorder=2, linewidth=0.7,
                **(
                    {"facecolor": "white", "edgecolor": style.QUIET, "hatch": "/////"}
                    if row.generic
                    else {"facecolor": style.DARK, "edgecolor": style.DARK}
                ),
            )  # fmt: skip
        axes.plot(
            max(row.beside, LEAST), k, ls="", marker="D" if row.found else "o", ms=4.8,
            mfc=style.LIGHT if row.found else "white", mec=style.INK, mew=0.9, zorder=4,
            clip_on=False,
        )  # fmt: skip
        top = TOP + ROW * (k + 0.5) + 0.045
        style.write(
            figure, 0.25, top, short(row.name, 68), size=style.SMALL,
            weight="bold" if row.found else "normal",
        )  # fmt: skip
        style.write(
            figure, style.WIDTH - 0.25, top, _number(row.alone), size=style.SMALL, align="right"
        )
    style.write(
        figure, style.WIDTH - 0.25, TOP - 0.1, "alone", size=style.SMALL, colour=style.QUIET,
        align="right",
    )  # fmt: skip
    style.label(axes, "log evidence (natural logarithm of the Bayes factor)", "")
    style.legend(
        figure,
        0.86,
        [
            Patch(fc=style.DARK, label="physical effect, alone"),
            Patch(fc="white", ec=style.QUIET, hatch="/////", label="generic shape, alone"),
            _marker("D", style.LIGHT, "found"),
            _marker("o", "white", "beside what was found"),
            *(
                Line2D([], [], color=style.INK, lw=1.0, ls=dashes, label=words)
                for dashes, words in LIMITS.values()
            ),
        ],
    )
    return figure


def _marker(shape: str, fill: str, text: str) -> Line2D:
    return Line2D([], [], ls="", marker=shape, ms=4.8, mfc=fill, mec=style.INK, mew=0.9, label=text)


def _number(value: float) -> str:
    if value < LEAST:
        return "below 1"
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}"
