"""Pictures of a diagnosis: how strongly the data speak for every candidate."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullLocator

from corridor.core.output import counted, short, times
from corridor.interface.figures import style

# Inches: a row, the names, the numbers, and above and below the rows.
ROW, NAMES, NUMBERS, TOP, BOTTOM = 0.235, 4.15, 0.65, 1.35, 0.65
LEAST = 1.0
PHYSICAL = {"facecolor": style.DARK, "edgecolor": style.DARK}
GENERIC = {"facecolor": "white", "edgecolor": style.QUIET, "hatch": "/////"}
FOUND = style.dot("D", style.LIGHT, 4.8, style.INK)
BESIDE = style.dot("o", "white", 4.8, style.INK)
LIMITS = {"named": ("-", "named"), "suspected": ("--", "suspected")}


def evidence_bars(
    evidence: pd.DataFrame, threshold: Mapping[str, float], name: str = "block"
) -> Figure:
    """Log evidence of every candidate as bars on a logarithmic scale, beside the thresholds.

    evidence: name, generic, found (bool), alone and beside (log evidence by itself, and beside
    what was found), a row a candidate, drawn in their order. threshold: `named` and
    `suspected`.
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
    # Between them a candidate is suspected.
    ends = (max(threshold[limit], LEAST) for limit in ("suspected", "named"))
    axes.fill_betweenx([-0.6, rows - 0.4], *ends, color=style.FAINT, alpha=0.45, lw=0, zorder=0)
    for limit, (dashes, _) in LIMITS.items():
        axes.axvline(max(threshold[limit], LEAST), color=style.INK, lw=1.0, ls=dashes, zorder=1)
    for k, row in enumerate(evidence.itertuples(index=False)):
        look = GENERIC if row.generic else PHYSICAL
        if row.alone > LEAST:
            axes.barh(k, row.alone - LEAST, 0.62, LEAST, zorder=2, linewidth=0.7, **look)
        look = FOUND if row.found else BESIDE
        axes.plot(max(row.beside, LEAST), k, zorder=4, clip_on=False, **look)
        top, weight = TOP + ROW * (k + 0.5) + 0.045, "bold" if row.found else "normal"
        style.write(figure, 0.25, top, short(row.name, 68), size=style.SMALL, weight=weight)
        number = _number(row.alone)
        style.write(figure, style.WIDTH - 0.25, top, number, size=style.SMALL, align="right")
    look = {"size": style.SMALL, "colour": style.QUIET, "align": "right"}
    style.write(figure, style.WIDTH - 0.25, TOP - 0.1, "alone", **look)
    style.label(axes, "log evidence (natural logarithm of the Bayes factor)", "")
    keys = [
        Patch(**PHYSICAL, label="physical effect, alone"),
        Patch(**GENERIC, label="generic shape, alone"),
        style.key("found", **FOUND),
        style.key("beside what was found", **BESIDE),
    ]
    keys += [
        style.key(words, color=style.INK, lw=1.0, ls=dashes) for dashes, words in LIMITS.values()
    ]
    style.legend(figure, 0.86, keys)
    return figure


def _number(value: float) -> str:
    return "below 1" if value < LEAST else times(value)
