"""One table of a report, already in words and digits."""

import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

import pandas as pd

WIDTH = 100  # columns of a terminal
# The last column goes on below itself where it has so much room left.
_ROOM = 24


class Link(str):
    """A text of a table that leads somewhere from a page; address: relative to the page."""

    address: str

    def __new__(cls, text: str, address: str) -> "Link":
        """The text with its address."""
        made = super().__new__(cls, text)
        made.address = address
        return made


@dataclass(frozen=True)
class Table:
    """A small table of texts; without rows, a title with notes.

    header: () for a table whose columns need no names.
    align: one letter for each column: l for texts, w for long ones (sentences, which a page sets in
    several lines), r for numbers.
    """

    title: str
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    align: str = ""
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, frame: pd.DataFrame, title: str = "", notes: Sequence[str] = ()) -> "Table":
        """The table of a frame of texts; columns in which numbers prevail end on the right."""
        rows = tuple(tuple(map(str, row)) for row in frame.itertuples(index=False))
        columns = zip(*rows, strict=True) if rows else ((),) * len(frame.columns)
        align = "".join("r" if _are_numbers(column) else "l" for column in columns)
        return cls(title, tuple(map(str, frame.columns)), rows, align, tuple(notes))

    def __str__(self) -> str:
        """Title, rows and notes for a terminal, at most `WIDTH` columns wide."""
        notes = [
            line
            for note in self.notes
            for line in textwrap.wrap(note, WIDTH, initial_indent="  ", subsequent_indent="    ")
        ]
        return "\n".join([*([self.title] if self.title else []), *self._lines(), *notes])

    def _lines(self) -> list[str]:
        if not self.rows:
            return []
        grid = [self.header, *self.rows] if self.header else list(self.rows)
        widths = [max(map(len, column)) for column in zip(*grid, strict=True)]
        begin = sum(width + 2 for width in widths[:-1])
        last = WIDTH - 2 - begin
        wraps = self.align.endswith(("l", "w")) and last >= _ROOM
        lines = []
        for row in grid:
            cells = [
                text.rjust(width) if side == "r" else text.ljust(width)
                for text, width, side in zip(row, widths, self.align, strict=True)
            ]
            more: list[str] = []
            if wraps and len(row[-1]) > last:
                cells[-1], *more = textwrap.wrap(row[-1], last)
            lines.append(("  " + "  ".join(cells)).rstrip()[:WIDTH])
            lines += ["  " + " " * begin + text for text in more]
        if self.header:
            lines.insert(1, "  " + "-" * min(sum(widths) + 2 * (len(widths) - 1), WIDTH - 2))
        return lines

    def html(self) -> str:
        """A table of HTML; the same input gives the same text."""
        lines = ["<table>"]
        if self.title:
            lines.append(f"<caption>{html.escape(self.title)}</caption>")
        if self.rows:
            if self.header:
                lines.append(f"<thead><tr>{self._cells('th', self.header)}</tr></thead>")
            rows = "\n".join(f"<tr>{self._cells('td', row)}</tr>" for row in self.rows)
            lines.append(f"<tbody>{rows}</tbody>")
        lines.append("</table>")
        lines += [f'<p class="note">{with_commands(note)}</p>' for note in self.notes]
        return "\n".join(lines)

    def _cells(self, tag: str, row: Sequence[str]) -> str:
        kinds = {"l": ' class="name"', "w": ' class="name text"', "r": ""}
        return "".join(
            f"<{tag}{kinds[side]}>{_html(text, side)}</{tag}>"
            for text, side in zip(row, self.align, strict=True)
        )


def with_commands(sentence: str) -> str:
    """HTML of a sentence, what stands between backticks set as a command that is not broken."""
    parts = sentence.split("`")
    return "".join(
        f"<code>{html.escape(part)}</code>" if odd % 2 else html.escape(part)
        for odd, part in enumerate(parts)
    )


def _html(text: str, side: str) -> str:
    said = with_commands(text) if side == "w" else html.escape(text)
    return f'<a href="{quote(text.address)}">{said}</a>' if isinstance(text, Link) else said


def _are_numbers(column: Sequence[str]) -> bool:
    """Whether numbers prevail where anything stands in a column."""
    said = [text for text in column if any(letter.isalnum() for letter in text)]
    numbers = [text for text in said if text.lstrip("+-\u00b1 ")[:1].isdigit()]
    return len(numbers) > len(said) / 2
