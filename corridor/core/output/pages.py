"""A report as text, as a piece of HTML for a notebook, and as a page that needs no other file."""

import base64
import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from corridor.core.output.table import WIDTH, Table, with_commands

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
.corridor-report ol {margin: .6em 0; padding-left: 1.6em; max-width: 46em}
.corridor-report code {white-space: nowrap}
.corridor-report p.note {opacity: .65; margin-top: 0; font-size: 12px}
""".strip()

_PAGE_STYLE = """
body {margin: 2.2em auto; padding: 0 1.2em; max-width: 62em; color: #222; background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif}
h1 {font-size: 1.35em; font-weight: 600; margin: 0 0 .6em}
figure {margin: 1.6em 0}
figure img {max-width: 100%; height: auto; display: block}
figcaption {color: #555; font-size: .9em; max-width: 46em}
.corridor-report > p:first-of-type {font-size: 1.12em}
.corridor-report td {vertical-align: top}
body .corridor-report {max-width: none; overflow-x: auto}
.corridor-report td.text {white-space: normal; min-width: 10em; overflow-wrap: anywhere}
body .corridor-report code {white-space: normal; overflow-wrap: anywhere}
@media (max-width: 30em) {body .corridor-report :is(th, td) {font-size: 12px; padding-right: .5em}
  body .corridor-report caption {white-space: normal}}
@media print {body {margin: 0; max-width: none} figure, table {break-inside: avoid}}
""".strip()


@dataclass(frozen=True)
class Report:
    """What is said of a result: is it good enough, what is wrong, what to do, and the evidence.

    opening: the first sentences, for a reader who reads nothing else. warnings: a sentence each.
    actions: at most three sentences on what to do next, the first one first, with the command.
    """

    title: str
    opening: str
    warnings: Sequence[str] = ()
    tables: Sequence[Table] = ()
    actions: Sequence[str] = ()

    def __str__(self) -> str:
        """The report for a terminal, at most `WIDTH` columns wide."""
        lines = textwrap.wrap(self.opening, WIDTH)
        for warning in self.warnings:
            lines += textwrap.wrap(
                str(warning), WIDTH, initial_indent="  ! ", subsequent_indent="    "
            )
        for number, action in enumerate(self.actions, start=1):
            lines += _wrapped(action, f"  {number}. ")
        for table in self.tables:
            lines += ["", str(table)]
        return "\n".join(lines)

    def html(self) -> str:
        """The same report as a piece of HTML; the same input gives the same text."""
        parts = [f"<style>{_STYLE}</style>", '<div class="corridor-report">']
        parts.append(f"<p>{html.escape(self.opening)}</p>")
        parts += [f'<p class="warning">{with_commands(str(w))}</p>' for w in self.warnings]
        parts += [numbered(self.actions)] if self.actions else []
        parts += [table.html() for table in self.tables]
        parts.append("</div>")
        return "\n".join(parts)

    def page(self, pictures: Sequence[tuple[str, str, bytes]] = ()) -> str:
        """The report as one page that needs no other file.

        pictures: (what it shows in a few words, how to read it, PNG bytes), in order.
        """
        heading = f"<h1>{html.escape(self.title)}</h1>"
        shown = [_figure(*picture) for picture in pictures]
        return page(self.title, [heading, self.html(), *shown], _PAGE_STYLE)


def _wrapped(action: str, number: str) -> list[str]:
    """Lines of a numbered sentence; what stands between backticks stays on one of them."""
    parts = action.split("`")
    parts[1::2] = [part.replace(" ", "\0") for part in parts[1::2]]
    lines = textwrap.wrap(
        "`".join(parts),
        WIDTH,
        initial_indent=number,
        subsequent_indent=" " * len(number),
        break_on_hyphens=False,
        break_long_words=False,
    )
    return [line.replace("\0", " ") for line in lines]


def numbered(actions: Sequence[str]) -> str:
    """A numbered list of HTML; what stands between backticks is a command."""
    return f"<ol>{''.join(f'<li>{with_commands(action)}</li>' for action in actions)}</ol>"


def page(title: str, body: Sequence[str], style: str) -> str:
    """A page of HTML that needs no other file; body: pieces of HTML, in order."""
    content = "".join(f"{piece}\n" for piece in body)
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<style>{style}</style></head>
<body>
{content}</body></html>
"""


def _figure(name: str, caption: str, png: bytes) -> str:
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{html.escape(name)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )
