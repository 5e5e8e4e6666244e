"""A diagnosis for a terminal or a notebook: the sentence, what was found, and what it does."""

from __future__ import annotations

import textwrap
from html import escape

import pandas as pd

from corridor.diagnosis.report import tables
from corridor.diagnosis.report.diagnosed import Diagnosed

WIDTH = 100


def as_text(diagnosis: Diagnosed) -> str:
    """The sentence and short tables, as plain text."""
    parts = [textwrap.fill(diagnosis.sentence, WIDTH)]
    parts += [_table(frame) for frame in _short(diagnosis)]
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


def as_html(diagnosis: Diagnosed) -> str:
    """The sentence and the same tables, for a notebook."""
    parts = [frame.to_html(index=False, border=0) for frame in _short(diagnosis) if len(frame)]
    return f"<p><b>{escape(diagnosis.sentence)}</b></p>" + "".join(parts)


def _short(diagnosis: Diagnosed) -> list[pd.DataFrame]:
    """What was found, where the noise changes, and the gap."""
    shown = ["slug", "class", "parameter", "value", "sigma", "unit", "log evidence"]
    gap = tables.gap(diagnosis, None, None)
    return [
        tables.found(diagnosis)[shown],
        tables.variance(diagnosis),
        gap.drop(columns=["noise alone", "closed"], errors="ignore"),
    ]


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
