"""The page of a diagnosis: a heading, what it means, and the tables and pictures below it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import pandas as pd

from corridor.core import output as report
from corridor.core import registry
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.report import tables
from corridor.diagnosis.report.actions import actions
from corridor.diagnosis.report.beside import Beside
from corridor.diagnosis.report.sentence import sentence
from corridor.diagnosis.report.text import judged

_STYLE = """
body {margin: 2.2em auto; padding: 0 1.2em; max-width: 68em; color: #222; background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif}
h1 {font-size: 1.35em; font-weight: 600; margin: 0 0 .6em}
h2 {font-size: 1.1em; font-weight: 600; margin: 2.2em 0 .3em}
p {margin: .4em 0; max-width: 50em}
p.sentence {font-size: 1.3em; line-height: 1.4; border-left: 4px solid #004488;
  padding: .2em 0 .2em .8em; margin: .6em 0 1em}
p.judged {font-size: 1.15em; font-weight: 600}
ol {max-width: 50em; padding-left: 1.6em}
code {white-space: nowrap; background: #f4f4f4; padding: .05em .3em}
p.notice {border-left: 3px solid #ddaa33; padding: .1em 0 .1em .7em}
img {max-width: 100%; height: auto; display: block; margin: .8em 0}
div.wide {overflow-x: auto}
table {border-collapse: collapse; margin: .8em 0; font-size: 14px}
th, td {padding: .18em 1.2em .18em 0; text-align: right; vertical-align: top; max-width: 30em;
  white-space: nowrap; font-variant-numeric: tabular-nums}
th {font-weight: 400; color: #555; border-bottom: 1px solid #999}
.name {text-align: left; white-space: normal}
pre {background: #f4f4f4; padding: .6em .8em; overflow-x: auto}
@media print {body {margin: 0; max-width: none} img, tr {break-inside: avoid}}
""".strip()


@dataclass(frozen=True)
class Section:
    """A heading with what is shown below it: names of tables and pictures, the command.

    text: HTML. Where nothing is to be shown, the heading is left out as well.
    """

    heading: str
    shows: tuple[str, ...]
    text: str = ""


LIMITS = Section(
    "The smallest effect that would have been seen",
    ("limits", "not_separated"),
    "4.5 standard deviations, which are seen in nearly every block like this one. <em>Usual "
    "size</em> is one standard deviation of what cameras and flights are expected to have.",
)
# What was found and what it does on the ground, on the first screen.
ANSWER = (
    Section("Check points before and after", ("check_points",)),
    Section("What was found", ("found", "unknown")),
    Section(
        "The lens",
        ("lens",),
        "No polynomial describes a lens to the last tenth of a pixel. What is left is the same in "
        "all pictures; it is estimated beside everything else, so that nothing is named for it.",
    ),
    Section(
        "Data that the fit has not used",
        ("gap",),
        "Image points held out and check points are not used in the adjustment. <em>Noise alone"
        "</em> is what the simulated counterparts show, in which nothing is missing; <em>closed"
        "</em> is the share of the excess variance above it that is gone. <em>Before</em> is the "
        "model that was believed in, with ten camera parameters unless told otherwise, adjusted "
        "so that wild measurements hardly count; a plain adjustment takes eight and "
        "lets all count unless told otherwise, so its check points may differ from these.",
    ),
    Section("What would separate causes that look alike", ("separating",)),
)
EVIDENCE = (
    Section(
        "Measured beside simulated",
        ("measured_beside_simulated",),
        "The block was simulated again and again from the assumed model, with noise "
        "as large as its residuals show, and fitted each time. Where the measured curve (dark) "
        "leaves the grey band, the model cannot have produced what was measured; what sticks out "
        "has to shrink when the missing effect is added.",
    ),
    Section("Curves that leave their band", ("leaving",)),
    Section(
        "Where",
        ("where_maps", "where_axes"),
        "The same comparison over the picture and over the ground, and below along every other "
        "axis that this block has. Every cell of a map says by how many standard deviations of "
        "the counterparts the measured value lies above or below them, so that what poses and "
        "points absorb is allowed for: cells that go together are disagreement, a patchwork is "
        "noise.",
    ),
    Section(
        "Evidence of all candidates",
        ("evidence",),
        "How much more likely the data are with each candidate than without it, as natural "
        "logarithm, each alone and beside what was found. A look-alike is tall alone and gone "
        "beside the right one. Generic shapes stand for what is not in the catalogue.",
    ),
)
LAST = (
    Section(
        "What needs no catalogue",
        ("without_catalogue",),
        "<em>All tests together</em>: how probable such evidence is where nothing is missing, by "
        "scores that are resampled by runs of images. <em>Odd against even</em>: two halves of "
        "the images are adjusted apart, and their cameras and the heights of their surfaces "
        "compared with their joint covariance; p below 0.01 says that something bends the block, "
        "whether the catalogue has it or not. What both halves bend alike does not show.",
    ),
    Section("To test more, add", ("untestable",)),
    Section("Noise that is not the same everywhere", ("variance",)),
    Section("The assumed model", ("believed",)),
    Section("The rounds of the search", ("rounds",)),
    Section("How to make this page again", ("command", "versions")),
)


def make_page(
    diagnosis: Diagnosed,
    compared: Beside,
    notes: list[str],
    command: str,
    folder: Path,
) -> str:
    """The page as HTML that needs no other file; its pictures go to a folder as well.

    compared: `Beside`. notes: sentences on what did not go as usual. command: what was typed.
    """
    pieces = _tables(diagnosis, compared) | _pictures(diagnosis, compared, folder)
    if command:
        pieces["command"] = f"<pre>{escape(command)}</pre>"
    name = diagnosis.block.name
    body = [
        f"<h1>What is missing from the model of {escape(name)}?</h1>",
        *(f'<p class="judged">{_text(said)}</p>' for said in judged(diagnosis)),
        f'<p class="sentence">{_text(sentence(diagnosis))}</p>',
        report.numbered(actions(diagnosis)),
        *(f'<p class="notice">{_text(note)}</p>' for note in notes),
    ]
    nothing = diagnosis.verdict == "nothing"
    first, last = ((LIMITS,), ()) if nothing else ((), (LIMITS,))
    for section in (*first, *ANSWER, *EVIDENCE, *last, *LAST):
        body += _shown(section, pieces)
    return report.page(f"Diagnosis of {name}", body, _STYLE)


def _shown(section: Section, pieces: Mapping[str, str]) -> list[str]:
    below = [pieces[name] for name in section.shows if name in pieces]
    text = [f"<p>{section.text}</p>"] if section.text else []
    return [f"<h2>{section.heading}</h2>", *text, *below] if below else []


def _tables(diagnosis: Diagnosed, compared: Beside) -> dict[str, str]:
    before, after = compared.before, compared.after
    frames = {
        "found": tables.found(diagnosis),
        "separating": tables.separating(diagnosis),
        "unknown": tables.unknown(diagnosis),
        "lens": tables.lens(diagnosis),
        "gap": tables.gap(diagnosis, before, after),
        "leaving": tables.leaving(before, after),
        "limits": tables.limits(diagnosis),
        "not_separated": tables.not_separated(diagnosis),
        "untestable": tables.untestable(diagnosis, before),
        "without_catalogue": tables.without_catalogue(diagnosis),
        "variance": tables.variance(diagnosis),
        "rounds": tables.rounds(diagnosis),
        "believed": tables.believed(diagnosis),
        "versions": tables.versions(diagnosis, before),
    }
    return {name: html_table(frame) for name, frame in frames.items() if len(frame)}


def _pictures(diagnosis: Diagnosed, compared: Beside, folder: Path) -> dict[str, str]:
    figures = registry.room("figures")

    name = diagnosis.block.name
    drawn = {}
    if len(diagnosis.before.check_points):
        changed = diagnosis.after is not diagnosis.before
        drawn["check_points"] = (
            figures.check_points_moved(diagnosis.before, diagnosis.after)
            if changed
            else figures.check_points(diagnosis.before)
        )
    if compared.before is not None:
        cases = compared.before, compared.after
        drawn["measured_beside_simulated"] = figures.counterpart(*cases)
        drawn["where_maps"] = figures.counterpart_maps(*cases)
        drawn["where_axes"] = figures.counterpart_axes(*cases)
    threshold = diagnosis.course.last.threshold
    drawn["evidence"] = figures.evidence_bars(tables.evidence(diagnosis), threshold, name)
    out = {}
    for key, figure in drawn.items():
        code = base64.b64encode(report.write_picture(figure, folder / f"{key}.png")).decode("ascii")
        alt = key.replace("_", " ")
        out[key] = f'<img alt="{alt}" src="data:image/png;base64,{code}">'
    return out


def html_table(frame: pd.DataFrame) -> str:
    """A table of texts; columns of numbers end on the right."""
    told = frame.map(lambda text: str(text).replace("+-", "\u00b1"))
    return f'<div class="wide">{report.Table.of(told).html()}</div>'


def _text(text: object) -> str:
    return escape(str(text).replace("+-", "\u00b1"))
