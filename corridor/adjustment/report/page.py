"""The report as HTML: a piece for a notebook, a page by itself."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from corridor.adjustment.report.contents import tables
from corridor.adjustment.report.opening import headline
from corridor.adjustment.report.table import Table

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

_STYLE = """
.corridor-report {font: 13px/1.45 system-ui, -apple-system, "Segoe UI", sans-serif;
  max-width: 60em}
.corridor-report p {margin: .4em 0; max-width: 46em}
.corridor-report p.warning {border-left: 3px solid #ddaa33; padding: .1em 0 .1em .7em}
.corridor-report table {border-collapse: collapse; margin: 1.1em 0 .2em; font-size: inherit;
  border: none}
.corridor-report caption {text-align: left; font-weight: 600; padding-bottom: .25em;
  caption-side: top; color: inherit; white-space: nowrap}
.corridor-report th, .corridor-report td {padding: .12em 1.1em .12em 0; text-align: right;
  border: none; background: none; white-space: nowrap; font-variant-numeric: tabular-nums}
.corridor-report th {font-weight: 400; opacity: .65; border-bottom: 1px solid #999}
.corridor-report .name {text-align: left}
.corridor-report p.note {opacity: .65; margin-top: 0; font-size: 12px}
""".strip()

_PAGE_STYLE = """
body {margin: 2.2em auto; padding: 0 1.2em; max-width: 62em; color: #222; background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif}
h1 {font-size: 1.35em; font-weight: 600; margin: 0 0 .6em}
figure {margin: 1.6em 0}
figure img {max-width: 100%; height: auto; display: block}
figcaption {color: #555; font-size: .9em; max-width: 46em}
.corridor-report {font-size: 14px; max-width: none; overflow-x: auto}
.corridor-report > p:first-of-type {font-size: 1.12em}
@media print {body {margin: 0; max-width: none} figure, table {break-inside: avoid}}
""".strip()


def as_html(adjustment: Adjustment) -> str:
    """The same report as a piece of HTML, for a notebook; the same input gives the same text."""
    parts = [f"<style>{_STYLE}</style>", '<div class="corridor-report">']
    parts.append(f"<p>{_escape(headline(adjustment))}</p>")
    parts += [f'<p class="warning">{_escape(w)}</p>' for w in adjustment.warnings]
    parts += [_html_table(table) for table in tables(adjustment)]
    parts.append("</div>")
    return "\n".join(parts)


def as_page(adjustment: Adjustment, pictures: Sequence[tuple[str, str, bytes]] = ()) -> str:
    """The report as one page that needs no other file.

    pictures: (what it shows in a few words, how to read it, PNG bytes), in order.
    """
    title = _escape(f"Adjustment of {adjustment.block.name}")
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        '<head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title>",
        f"<style>{_PAGE_STYLE}</style></head>",
        f"<body><h1>{title}</h1>",
        as_html(adjustment),
    ]
    for name, caption, png in pictures:
        data = base64.b64encode(png).decode("ascii")
        parts.append(
            f'<figure><img alt="{_escape(name)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{_escape(caption)}</figcaption></figure>"
        )
    parts.append("</body></html>\n")
    return "\n".join(parts)


def _html_table(table: Table) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        kinds = {"l": ' class="name"', "r": ""}
        return "".join(
            f"<{tag}{kinds[side]}>{_escape(text)}</{tag}>"
            for text, side in zip(row, table.align, strict=True)
        )

    lines = ["<table>", f"<caption>{_escape(table.title)}</caption>"]
    if table.rows:
        lines.append(f"<thead><tr>{cells('th', table.header)}</tr></thead>")
        rows = "\n".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
        lines.append(f"<tbody>{rows}</tbody>")
    lines.append("</table>")
    lines += [f'<p class="note">{_escape(note)}</p>' for note in table.notes]
    return "\n".join(lines)


def _escape(text: object) -> str:
    return html.escape(str(text))
