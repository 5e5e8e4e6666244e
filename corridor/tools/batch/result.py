"""The result of a batch as a table, a text and a page, the most urgent block first."""

import math
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.output import (
    Link,
    Report,
    Table,
    counted,
    fixed,
    metre_digits,
    millimetres,
    short,
    whole_files,
    write_csv,
    write_json,
)
from corridor.tools.batch.row import IN_DOUBT, NOT_RUN, NOT_TESTED, URGENCY, Row
from corridor.tools.batch.work import MARK

TABLE, PAGE = "batch.csv", "report.html"
_DONE = {"adjust": "adjusted", "diagnose": "diagnosed"}
_MEANING = {
    IN_DOUBT: "check points or residuals are larger than their standard deviations say",
    NOT_TESTED: "no check point shows how far off it is",
    NOT_RUN: "the same command goes on with it",
}
_RMS = ("check_rms_xy_m", "check_rms_z_m", "check_rms_3d_m")
_MOST_LINES = 20  # of a terminal
_COLUMNS = [
    *("block", "verdict", "found", "images", "sigma0", "check_points"),
    *(*_RMS, "attention", "seconds", "folder"),
]


@dataclass(frozen=True)
class BatchResult:
    """Many blocks with one question. rows: the most urgent first. output: where it is kept.

    verb: `adjust` or `diagnose`. required: 3D RMS of check points that is good enough, m.
    """

    verb: str
    rows: tuple[Row, ...]
    output: Path
    required: float | None = None

    @property
    def failed(self) -> list[Row]:
        """Blocks without a result."""
        return [row for row in self.rows if row.failed]

    @property
    def table(self) -> pd.DataFrame:
        """A row a block: RMS in metres; report: its page, from the folder of the batch."""
        frame = pd.DataFrame(list(self.rows))[_COLUMNS]
        return frame.assign(report=[_address(row) for row in self.rows])

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"BatchResult: {self.verb} {len(self.rows)} blocks{failed}, in {self.output}"

    def __str__(self) -> str:
        return str(self.report(_MOST_LINES))

    def _repr_html_(self) -> str:
        return self.report().html()

    def report(self, most: int | None = None) -> Report:
        """Opening, what needs attention and the table; most: lines of a terminal."""
        opening = f"{_counts(self)} {_accuracy(self)}".strip()
        title = f"{counted(len(self.rows), 'block')} {_DONE[self.verb]}"
        if most is None:
            return Report(title, opening, tables=[_table(self.rows, wide=True)])
        urgent = [row for row in self.rows if row.attention]
        told = [f"{row.block}: {row.attention}" for row in urgent[:most]]
        if len(urgent) > most:
            told.append(f"{counted(len(urgent) - most, 'more block')}: see {PAGE}")
        shown = _table(self.rows[:most], wide=False, left_out=len(self.rows[most:]))
        return Report(title, opening, told, [shown])

    def write(self) -> list[Path]:
        """Writes batch.csv, report.html and batch.json into `output`; returns the paths."""
        paths = tuple(self.output / name for name in (TABLE, PAGE, MARK))
        with whole_files(*paths) as (table, page, mark):
            write_csv(self.table, table)
            page.write_text(self.report().page(), encoding="utf-8", newline="\n")
            content = {"verb": self.verb, "required": self.required}
            write_json(content | {"rows": [asdict(row) for row in self.rows]}, mark)
        return list(paths)


def _address(row: Row) -> str:
    """Where the page of a block lies, from the folder of the batch; empty without a result."""
    return "" if row.failed or row.verdict == NOT_RUN else f"blocks/{row.block}/{PAGE}"


def _counts(result: BatchResult) -> str:
    """How many blocks have which verdict."""
    found = Counter(row.verdict for row in result.rows)
    parts = [f"{found[verdict]:,} {verdict}" for verdict in URGENCY if found[verdict]]
    missed = sum(row.missed for row in result.rows)
    if missed and result.verb == "diagnose":
        parts.append(f"{missed:,} not good enough with what was found")
    wanted = result.required
    asked = f" ({millimetres(wanted)} are required)" if wanted is not None else ""
    blocks = counted(len(result.rows), "block")
    return f"{blocks} {_DONE[result.verb]}{asked}: {', '.join(parts)}."


def _accuracy(result: BatchResult) -> str:
    """How far off check points are, in the usual block and in the worst."""
    rows = [row for row in result.rows if math.isfinite(row.check_rms_3d_m)]
    if not rows:
        return ""
    worst = max(rows, key=lambda row: row.check_rms_3d_m)
    usual = float(np.median([row.check_rms_3d_m for row in rows]))
    if len(rows) == 1:
        return f"Check points of {short(worst.block)} are off by {millimetres(usual)} (3D RMS)."
    return (
        f"Check points are off by {millimetres(usual)} in the median block (3D RMS), by "
        f"{millimetres(worst.check_rms_3d_m)} in the worst, {short(worst.block)}."
    )


def _table(rows: tuple[Row, ...], wide: bool, left_out: int = 0) -> Table:
    """A line a block; wide: for a page, with links and what to do."""
    sizes = np.array([[getattr(row, name) for name in _RMS] for row in rows], dtype=float)
    digits = max(metre_digits(sizes) - 3, 0)
    effects = any(row.found for row in rows)
    lines = []
    for row, size in zip(rows, 1e3 * sizes.reshape(-1, 3), strict=True):
        name, address = short(row.block, 40 if wide else 20), _address(row)
        numbers = [fixed(row.sigma0, 3), *(fixed(value, digits) for value in size)]
        found = [row.found if wide else short(row.found, 16)] if effects else []
        todo = [row.attention] if wide else []
        label = Link(name, address) if wide and address else name
        lines.append((label, row.verdict, *found, *todo, *numbers))
    header = ["block", "verdict", *(["found"] if effects else []), *(["to do first"] * wide)]
    header += ["sigma naught", "RMS xy (mm)", "z (mm)", "3D (mm)"]
    notes = ["RMS: of the check points, about zero, horizontally, in height and in space"]
    seen = {row.verdict for row in rows}
    notes += [f"{verdict}: {said}" for verdict, said in _MEANING.items() if verdict in seen]
    if left_out:
        notes.append(f"{counted(left_out, 'more block')}, which are less urgent: see {TABLE}")
    align = "ll" + ("w" if effects else "") + ("w" if wide else "") + "rrrr"
    return Table("What needs attention first", tuple(header), tuple(lines), align, tuple(notes))
