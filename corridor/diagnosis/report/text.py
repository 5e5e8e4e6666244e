"""A diagnosis for a terminal: the sentence, what was found, and what it does."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import pandas as pd

from corridor.diagnosis.report import tables

if TYPE_CHECKING:
    from corridor.diagnosis.diagnose import Diagnosis

WIDTH = 100


def as_text(diagnosis: Diagnosis) -> str:
    """The sentence and short tables, as plain text."""
    parts = [textwrap.fill(diagnosis.sentence, WIDTH)]
    shown = ["slug", "class", "parameter", "value", "sigma", "unit", "log evidence"]
    parts += [_table(tables.found(diagnosis)[shown]), _table(tables.variance(diagnosis))]
    gap = tables.gap(diagnosis, None, None)
    parts.append(_table(gap.drop(columns=["noise alone", "closed"], errors="ignore")))
    missing = tables.untestable(diagnosis, None)
    if len(missing):
        parts.append(
            "Not tested:\n"
            + "\n".join(
                textwrap.fill(
                    f"{row[0]}: {row[1]}", WIDTH, initial_indent="  ", subsequent_indent="    "
                )
                for row in missing.itertuples(index=False)
            )
        )
    parts += [textwrap.fill(note, WIDTH) for note in diagnosis.notes]
    return "\n\n".join(part for part in parts if part)


def _table(frame: pd.DataFrame) -> str:
    """Columns beside each other; the first ones, which are words, from the left."""
    if not len(frame):
        return ""
    cells = [list(map(str, frame.columns)), *(list(map(str, row)) for row in frame.to_numpy())]
    widths = [max(len(row[k]) for row in cells) for k in range(len(frame.columns))]
    lines = [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
    return "\n".join("  " + line for line in lines)
