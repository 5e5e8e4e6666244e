"""A report on sheets of paper: a PDF file of text, tables and pictures.

The same report gives the same bytes: no date, no path and no random name goes into the file.
"""

from __future__ import annotations

import base64
import binascii
import io
import re
import textwrap
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from corridor.core.output import CODED, NOTE, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from corridor.core.output import Report, Table

# A4 in points of print, with its margins.
WIDE, HIGH, MARGIN = 595.28, 841.89, 45.0
_ROOM = WIDE - 2 * MARGIN
_HALF = (_ROOM - 18.0) / 2
_HEADING, _TEXT, _ROW, _NOTE = 13.0, 8.5, 7.2, 6.6
_LEAD = 1.35  # distance of lines over the size of their letters
_GAP = 7.0  # between the columns of a table
# Height of a picture over that of a sheet, and how much smaller it may be to fit.
_PICTURE, _SHRUNK = 0.36, 0.8
# Tables below this share of a sheet's height are never cut.
_WHOLE = 0.25
_INK, _QUIET = "#222222", "#6f6f6f"


def pdf(
    report: Report,
    pictures: Sequence[tuple[str, str, bytes]] = (),
    footer: str = "",
    keywords: str = "",
) -> bytes:
    """A report as the bytes of a PDF file of A4 sheets.

    pictures: as of `Report.page`. footer: stands on each sheet, with its number. keywords: kept in
    the file's properties, for programs.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    sheets = _Sheets()
    sheets.lines(report.title, _HEADING, weight="bold")
    sheets.gap(5)
    sheets.lines(report.opening, _TEXT + 0.5)
    if CODED.search(printable(report.page(()))):
        sheets.lines(f"On these sheets {NOTE}; the page of HTML has the letters.", _NOTE)
    for warning in report.warnings:
        sheets.lines(f"! {warning}", _TEXT, indent=10)
    for number, action in enumerate(report.actions, start=1):
        sheets.lines(f"{number}. {action}", _TEXT, indent=10)
    sheets.tables(report.tables)
    for name, caption, png in pictures:
        sheets.picture(name, caption, png)
    stream = io.BytesIO()
    properties = {"Title": report.title, "Keywords": keywords, "CreationDate": None}
    # Text stays text (42: TrueType), to be searched and copied.
    with (
        mpl.rc_context({"pdf.fonttype": 42, "font.family": ["DejaVu Sans"]}),
        PdfPages(stream, metadata=properties | {"Creator": None, "Producer": None}) as file,
    ):
        for number, figure in enumerate(sheets.figures, start=1):
            foot = f"{footer}   sheet {number} of {len(sheets.figures)}"
            _write(figure, MARGIN, HIGH - 25, foot, _NOTE, color=_QUIET)
            file.savefig(figure)
    return stream.getvalue()


def _write(figure: Figure, left: float, top: float, text: str, size: float, **look) -> None:
    place: dict[str, Any] = {"ha": "left", "va": "baseline", "parse_math": False, "color": _INK}
    figure.text(left / WIDE, 1 - top / HIGH, printable(text), size=size, **(place | look))


@lru_cache(maxsize=4096)
def _width(text: str, size: float, weight: str = "normal") -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
    return text_to_path.get_text_width_height_descent(printable(text), font, False)[0]


def _wrapped(text: str, size: float, room: float, weight: str = "normal") -> list[str]:
    """Lines no wider than the room, by the measured width of the whole."""
    text = printable(text.replace("`", ""))
    whole = _width(text, size, weight)
    if whole <= room:
        return [text]
    letters = int(len(text) * room / whole * 0.97)
    while letters > 8:
        lines = textwrap.wrap(text, letters)
        if max(_width(line, size, weight) for line in lines) <= room:
            return lines
        letters -= 2
    return [text]


class _Sheets:
    """Sheets that are filled from the top; what does not fit begins the next one."""

    def __init__(self):
        self.figures: list[Figure] = []
        self._turn()

    def _turn(self) -> None:
        from matplotlib.figure import Figure

        self.figures.append(Figure(figsize=(WIDE / 72, HIGH / 72), facecolor="white"))
        self.top = MARGIN

    def _need(self, height: float) -> None:
        if self.top + height > HIGH - MARGIN and self.top > MARGIN:
            self._turn()

    def gap(self, height: float) -> None:
        """Leaves some room."""
        self.top += height

    def lines(
        self, text: str, size: float, indent: float = 0.0, left: float = MARGIN, **look
    ) -> None:
        """A paragraph; lines but the first are indented."""
        room = look.pop("room", _ROOM)
        wrapped = _wrapped(text, size, room - indent, look.get("weight", "normal"))
        for number, line in enumerate(wrapped):
            self._need(_LEAD * size)
            self.top += _LEAD * size
            at = left + (indent if number else 0.0)
            _write(self.figures[-1], at, self.top, line, size, **look)
        self.top += 2

    def tables(self, tables: Sequence[Table]) -> None:
        """Tables one after the other; two slim ones stand side by side."""
        rest = list(tables)
        while rest:
            one = _Laid(rest.pop(0), _ROOM)
            if one.slim and rest:
                other = _Laid(rest[0], _ROOM)
                height = max(_Laid(half.table, _HALF).height for half in (one, other))
                if other.slim and height < HIGH - 2 * MARGIN:
                    rest.pop(0)
                    self._beside(one.table, other.table, height)
                    continue
            self.gap(8)
            self._need(one.height if one.height < _WHOLE * HIGH else 5 * _LEAD * _ROW)
            self._table(one, MARGIN)

    def _beside(self, one: Table, other: Table, height: float) -> None:
        self.gap(8)
        self._need(height)
        top, lowest = self.top, self.top
        for number, table in enumerate((one, other)):
            self.top = top
            self._table(_Laid(table, _HALF), MARGIN + number * (_ROOM - _HALF))
            lowest = max(lowest, self.top)
        self.top = lowest

    def _table(self, laid: _Laid, left: float) -> None:
        """A table, its heading again on each sheet."""
        table, size, widths = laid.table, laid.size, laid.widths
        if table.title:
            self.lines(table.title, _TEXT, left=left, room=laid.room, weight="bold")
        for head, cells in laid.rows:
            height = _LEAD * size * max(map(len, cells))
            before = len(self.figures)
            self._need(height + (8 if head else 0))
            if len(self.figures) > before and table.header and not head:
                heading = [[text] for text in table.header]
                self._row(heading, widths, table.align, size, left, _QUIET)
            self._row(cells, widths, table.align, size, left, _QUIET if head else _INK)
            if head:
                y, end = 1 - (self.top + 3) / HIGH, left + sum(widths) + _GAP * (len(widths) - 1)
                self.figures[-1].add_artist(_rule(left / WIDE, end / WIDE, y, self.figures[-1]))
                self.gap(3)
        for note in table.notes:
            self.lines(note, _NOTE, left=left, room=laid.room, color=_QUIET)

    def _row(self, cells, widths, align: str, size: float, left: float, color: str) -> None:
        top = self.top
        for lines, width, side in zip(cells, widths, align, strict=True):
            for number, line in enumerate(lines, start=1):
                right = side == "r"
                at = left + width if right else left
                _write(self.figures[-1], at, top + number * _LEAD * size, line, size, color=color,
                       ha="right" if right else "left")  # fmt: skip
            left += width + _GAP
        self.top += _LEAD * size * max(map(len, cells))

    def picture(self, name: str, caption: str, png: bytes) -> None:
        """A picture as wide as the sheet, or as high as it may be, with its caption."""
        from PIL import Image

        image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
        high, wide = image.shape[:2]
        scale = min(_ROOM / wide, _PICTURE * HIGH / high)
        below = 3 * _LEAD * _NOTE
        self.gap(8)
        # A little smaller rather than alone on another sheet.
        left = (HIGH - MARGIN - below - self.top) / high
        scale = left if _SHRUNK * scale < left < scale else scale
        self._need(scale * high + below)
        figure, top = self.figures[-1], self.top
        box = (MARGIN / WIDE, 1 - (top + scale * high) / HIGH, scale * wide / WIDE,
               scale * high / HIGH)  # fmt: skip
        axes = figure.add_axes(box)
        axes.set_axis_off()
        axes.imshow(image, aspect="auto", interpolation="none")
        self.top += scale * high
        self.lines(f"{name}: {caption}" if caption else name, _NOTE, color=_QUIET)


def _rule(left: float, right: float, y: float, figure: Figure):
    from matplotlib.lines import Line2D

    return Line2D([left, right], [y, y], transform=figure.transFigure, color=_QUIET, lw=0.5)


class _Laid:
    """A table as it fits into some room: size of its letters, widths of its columns, its rows."""

    def __init__(self, table: Table, room: float):
        self.table, self.room = table, room
        grid = [(False, row) for row in table.rows]
        if table.header and grid:
            grid.insert(0, (True, table.header))
        self.size, self.widths = _fitted([row for _, row in grid], table.align, room)
        self.rows = [
            (head, [
                _wrapped(text, self.size, width) if side == "w" else [text]
                for text, width, side in zip(row, self.widths, table.align, strict=True)
            ])
            for head, row in grid
        ]  # fmt: skip
        notes = sum(len(_wrapped(note, _NOTE, room)) * _LEAD * _NOTE + 2 for note in table.notes)
        lines = sum(max(map(len, cells)) for _, cells in self.rows)
        self.height = _LEAD * self.size * lines + notes + _LEAD * _TEXT + 8

    @property
    def slim(self) -> bool:
        """Whether it takes half of a sheet's width at most."""
        across = sum(self.widths) + _GAP * (len(self.widths) - 1)
        return 0 < across <= _HALF and "w" not in self.table.align


def _fitted(rows: Sequence[Sequence[str]], align: str, room: float) -> tuple[float, list[float]]:
    """Size of the letters and widths of the columns with which rows fit into some room."""
    if not rows:
        return _ROW, []
    room -= _GAP * (len(rows[0]) - 1)
    size = _ROW
    while True:
        # The widest text of a column is one of its longest.
        longest = [sorted(column, key=len)[-4:] for column in zip(*rows, strict=True)]
        widths = [max(_width(text, size) for text in texts) for texts in longest]
        over = sum(widths) - room
        if over <= 0:
            return size, widths
        long = [k for k, side in enumerate(align) if side == "w"]
        if long and widths[long[-1]] - over > 0.25 * room:
            widths[long[-1]] -= over
            return size, widths
        if size < 4.0:
            return size, [width * room / sum(widths) for width in widths]
        size -= 0.3


def embedded(record: str, mark: str) -> str:
    """A record as keywords of a file: what programs find there again by its mark."""
    return mark + base64.b64encode(record.encode("utf-8")).decode("ascii")


def taken_from(content: bytes, mark: str) -> str | None:
    """The record that `embedded` put into a file, None where there is none."""
    found = re.search(re.escape(mark.encode()) + rb"([A-Za-z0-9+/=]+)", content)
    if found is None:
        return None
    try:
        return base64.b64decode(found[1], validate=True).decode("utf-8")
    except (binascii.Error, UnicodeDecodeError):
        return None
