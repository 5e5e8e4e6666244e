"""A diagnosis for a terminal or a notebook: the sentence, what was found, and what it does."""

from __future__ import annotations

from corridor.core.output import Report, Table, millimetres
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.report import tables
from corridor.diagnosis.report.actions import actions
from corridor.diagnosis.report.sentence import sentence


def report_of(diagnosis: Diagnosed) -> Report:
    """The sentence, the notes, and short tables: what was found and what it does."""
    shown = ["slug", "class", "parameter", "value", "sigma", "unit", "log evidence"]
    gap = tables.gap(diagnosis, None, None)
    missing = tables.untestable(diagnosis, None).itertuples(index=False)
    made = [
        Table.of(tables.found(diagnosis)[shown], "What was found"),
        Table.of(tables.lens(diagnosis), "The lens beside its polynomials"),
        Table.of(
            gap.drop(columns=["noise alone", "closed"], errors="ignore"), "What it does to the data"
        ),
        Table.of(tables.without_catalogue(diagnosis), "What needs no catalogue"),
        Table.of(tables.variance(diagnosis), "Where the noise changes"),
        Table("To test more, add", notes=tuple(f"{add}: {names}" for add, names in missing)),
    ]
    return Report(
        title=f"Diagnosis of {diagnosis.block.name}",
        opening=" ".join([*judged(diagnosis), sentence(diagnosis)]),
        warnings=diagnosis.notes,
        tables=[table for table in made if table.rows or table.notes],
        actions=actions(diagnosis),
    )


def judged(diagnosis: Diagnosed) -> list[str]:
    """Whether it is good enough, and was, where somebody says what is."""
    if diagnosis.required is None:
        return []
    wanted, gap = f"{millimetres(diagnosis.required)} are required", diagnosis.gap["check_m"]
    if not gap:
        return [f"Whether it is good enough is not known: {wanted}, and there is no check point."]
    before, after = (gap[key] <= diagnosis.required for key in ("before", "after"))
    now = f"{millimetres(gap['after'])} at the check points (3D RMS), {wanted}"
    if before and after:
        return [f"Good enough: {now}."]
    if after:
        was = millimetres(gap["before"])
        return [f"Good enough once what was found is added: {now}; without it {was}."]
    return [f"Not good enough: {now}."]


def as_text(diagnosis: Diagnosed) -> str:
    """The report for a terminal."""
    return str(report_of(diagnosis))


def as_html(diagnosis: Diagnosed) -> str:
    """The same report, for a notebook."""
    return report_of(diagnosis).html()
