"""A diagnosis for a terminal or a notebook: the sentence, what was found, and what it does."""

from __future__ import annotations

from corridor.diagnosis.report import tables
from corridor.diagnosis.report.diagnosed import Diagnosed
from corridor.report import Report, Table


def report_of(diagnosis: Diagnosed) -> Report:
    """The sentence, the notes, and short tables: what was found and what it does."""
    shown = ["slug", "class", "parameter", "value", "sigma", "unit", "log evidence"]
    gap = tables.gap(diagnosis, None, None)
    missing = tables.untestable(diagnosis, None).itertuples(index=False)
    made = [
        Table.of(tables.found(diagnosis)[shown], "What was found"),
        Table.of(tables.variance(diagnosis), "Where the noise changes"),
        Table.of(
            gap.drop(columns=["noise alone", "closed"], errors="ignore"), "What it does to the data"
        ),
        Table("Not tested", notes=tuple(f"{names}: {remedy}" for names, remedy in missing)),
    ]
    return Report(
        title=f"Diagnosis of {diagnosis.block.name}",
        opening=diagnosis.sentence,
        warnings=diagnosis.notes,
        tables=[table for table in made if table.rows or table.notes],
    )


def as_text(diagnosis: Diagnosed) -> str:
    """The report for a terminal."""
    return str(report_of(diagnosis))


def as_html(diagnosis: Diagnosed) -> str:
    """The same report, for a notebook."""
    return report_of(diagnosis).html()
