"""One table of a report, already in words and digits."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A small table of texts; without rows, a title with notes.

    align: one letter for each column: l for texts, r for numbers.
    """

    title: str
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    align: str = ""
    notes: tuple[str, ...] = ()
