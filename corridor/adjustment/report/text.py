"""The report for a terminal."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from corridor.adjustment.report.contents import tables
from corridor.adjustment.report.opening import headline
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_COLUMNS = 100


def as_text(adjustment: Adjustment) -> str:
    """The report for a terminal, at most 100 columns wide."""
    lines = textwrap.wrap(headline(adjustment), _COLUMNS)
    for warning in adjustment.warnings:
        lines += textwrap.wrap(
            str(warning), _COLUMNS, initial_indent="  ! ", subsequent_indent="    "
        )
    for table in tables(adjustment):
        lines += ["", table.title]
        lines += _text_rows(table)
        for note in table.notes:
            lines += textwrap.wrap(note, _COLUMNS, initial_indent="  ", subsequent_indent="  ")
    return "\n".join(lines)


def _text_rows(table: Table) -> list[str]:
    if not table.rows:
        return []
    grid = [table.header, *table.rows]
    widths = [max(map(len, column)) for column in zip(*grid, strict=True)]
    made = []
    for row in grid:
        cells = [
            text.ljust(width) if side == "l" else text.rjust(width)
            for text, width, side in zip(row, widths, table.align, strict=True)
        ]
        made.append(("  " + "  ".join(cells)).rstrip()[:_COLUMNS])
    made.insert(1, "  " + "-" * min(sum(widths) + 2 * (len(widths) - 1), _COLUMNS - 2))
    return made
