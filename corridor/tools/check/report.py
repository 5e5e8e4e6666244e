"""A check as text and as one page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from corridor.core.output import Report, Table

if TYPE_CHECKING:
    from corridor.tools.check.checking import Checked


def report_of(checked: Checked) -> Report:
    """The answer, what is wrong, what to take back, and where the rest is."""
    tables = []
    if checked.settings:
        rows = tuple((sentence,) for sentence in checked.settings)
        notes = []
        if checked.taken_back is not None:
            notes.append(f"files: {checked.taken_back.folder}")
            notes += [f"proof: {checked.taken_back.proof}"] if checked.taken_back.proof else []
            notes += checked.taken_back.sentences
        title = f"What to take back (the project is read as {checked.form})"
        tables.append(Table(title, (), rows, "w", tuple(notes)))
    if checked.imported:
        rows = tuple((sentence,) for sentence in checked.imported)
        tables.append(Table(f"What the import said ({checked.form})", (), rows, "w"))
    pages = [("adjusted", "adjustment"), ("missing", "diagnosis")]
    where = [f"{checked.folder / name}: the whole {what}" for name, what in pages
             if (checked.folder / name / "report.html").is_file()]  # fmt: skip
    if where:
        tables.append(Table("More", notes=tuple(where)))
    return Report(
        title=f"Check of {checked.project}",
        opening=checked.sentence,
        # What the answer says already is not said twice.
        warnings=[told for told in checked.wrong if told not in checked.sentence],
        tables=tables,
        actions=checked.actions,
    )
