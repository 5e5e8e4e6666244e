"""What an adjustment found, for a terminal, a notebook, another program and a folder.

`as_text` and `as_html` show the same tables: neither holds a time, a path or an address, and
every number is rounded to what its standard deviation justifies, so that a notebook can be
compared with an earlier run. `as_dict` holds full numbers (design, section 7).
"""

from __future__ import annotations

import base64
import html
import io
import json
import math
import os
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from corridor.block import whole_folder

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

RESULT = "adjustment.json"
COLUMNS = 100
STRONG = 0.95
MOST_CORRELATIONS = 12
MOST_CHECK_POINTS = 20
MOST_GROUPS = 8  # groups of one effect parameter listed in the tables
MOST_GROUPS_IN_JSON = 50
KINDS = {"tie": "tie points", "mark": "marks", "gnss": "GNSS", "control": "control"}
UNITS = {"f": "px", "cx": "px", "cy": "px"}
DASH = "\u2013"


# ---------------------------------------------------------------------------------------------
# Numbers


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Value and standard deviation as text, the last digit being the second of the sigma.

    (8187.1432, 2.876) -> ("8187.1", "2.9"). A sigma of zero is a value held fixed; where sigma is
    unknown (NaN) the value has six digits.
    """
    value, sigma = float(value), float(sigma)
    if not math.isfinite(value):
        return DASH, DASH
    if not math.isfinite(sigma):
        return f"{value:.6g}", "unknown"
    if sigma <= 0:
        return f"{value:.6g}", "held"
    power = math.floor(math.log10(float(f"{sigma:.1e}")))
    if power < -7 or power > 6:
        leading = math.floor(math.log10(abs(value))) if value else power
        return f"{value:.{max(leading - power + 1, 1)}e}", f"{sigma:.1e}"
    digits = max(1 - power, 0)
    return _unsigned_zero(f"{value:.{digits}f}"), f"{sigma:.{digits}f}"


def _unsigned_zero(text: str) -> str:
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def _fixed(value: float, digits: int) -> str:
    value = float(value)
    return _unsigned_zero(f"{value:.{digits}f}") if math.isfinite(value) else DASH


def _metre_digits(values) -> int:
    """Decimals for differences in metres: to the millimetre, finer only where all are finer."""
    sizes = np.abs(np.asarray(values, dtype=float))
    sizes = sizes[np.isfinite(sizes)]
    if not len(sizes) or sizes.max() >= 0.01 or sizes.max() == 0:
        return 3
    return int(min(9, 2 - math.floor(math.log10(sizes.max()))))


def _counted(number: int, noun: str, plural: str | None = None) -> str:
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def _short(name: object, most: int = 24) -> str:
    text = str(name)
    if len(text) <= most:
        return text
    tail = (most - 1) // 2
    return text[: most - 1 - tail] + "\u2026" + text[len(text) - tail :]


# ---------------------------------------------------------------------------------------------
# Tables


@dataclass(frozen=True)
class Table:
    """A small table of texts: the first `names` columns are names, the others numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    names: int = 1
    notes: tuple[str, ...] = ()
    rule_before: tuple[int, ...] = field(default=())


def headline(adjustment: Adjustment) -> str:
    """The first sentences of a report, for a surveyor who reads nothing else."""
    block = adjustment.block
    name = _short(block.name, 50)
    steps = _counted(adjustment.iterations, "iteration")
    images = _counted(len(block.images), "image")
    if not adjustment.converged:
        return (
            f"The adjustment of {name} ({images}) did not converge in {steps}: "
            "its numbers are not a result."
        )
    parts = [f"The adjustment of {name} ({images}) converged in {steps}."]
    sigma0 = float(adjustment.sigma0)
    if math.isfinite(sigma0):
        parts.append(f"Sigma naught is {sigma0:.3f}: the residuals are {_compared(sigma0)}.")
    number = len(adjustment.check_points)
    if number:
        rms = adjustment.check_rms
        digits = _metre_digits([rms.xy, rms.z])
        parts.append(
            f"At {_counted(number, 'check point')} it is off by {_fixed(rms.xy, digits)} m in plan "
            f"and {_fixed(rms.z, digits)} m in height (RMS)."
        )
    else:
        parts.append("There are no check points, so nothing independent tests it.")
    return " ".join(parts)


def _compared(sigma0: float) -> str:
    percent = round(100 * (sigma0 - 1))
    if abs(percent) <= 5:
        return "as large as the stated standard deviations say"
    if percent > 100:
        return f"{sigma0:.1f} times as large as the stated standard deviations say"
    word = "larger" if percent > 0 else "smaller"
    return f"{abs(percent)} % {word} than the stated standard deviations say"


def tables(adjustment: Adjustment) -> list[Table]:
    """Every table of the report, in order; those with nothing to say are left out."""
    made = [
        _observations(adjustment),
        _camera(adjustment),
        _effects(adjustment),
        _lever_arms(adjustment),
        _check_points(adjustment),
        _check_statistics(adjustment),
        _correlations(adjustment),
        _high_correlations(adjustment),
    ]
    return [table for table in made if table is not None]


def _observations(adjustment: Adjustment) -> Table | None:
    rows = []
    for kind, found in adjustment.observations.items():
        if not found or not found.get("count"):
            continue
        rms = np.ravel(np.asarray(_plain_rms(found.get("rms")), dtype=float))
        if len(rms) == 3:
            digits = _metre_digits(rms)
            text = "  ".join(_fixed(value, digits) for value in rms) + " m (x, y, z)"
        else:
            text = f"{_fixed(rms[0], 3) if len(rms) else DASH} px an axis"
        naught = found.get("sigma0")
        rows.append(
            (
                KINDS.get(kind, kind),
                f"{int(found['count']):,}",
                f"{int(found.get('outliers') or 0):,}",
                text,
                DASH if naught is None else _fixed(naught, 3),
            )
        )
    if not rows:
        return None
    header = ("residuals", "count", "outliers", "RMS without outliers", "sigma naught")
    if all(row[-1] == DASH for row in rows):
        rows, header = [row[:-1] for row in rows], header[:-1]
    note = f"all together: sigma naught {_fixed(adjustment.sigma0, 4)}, "
    note += f"redundancy {int(adjustment.redundancy):,}"
    return Table("Observations", header, tuple(rows), notes=(note,))


def _plain_rms(rms: Any) -> Any:
    if rms is None:
        return []
    return list(rms.values()) if isinstance(rms, Mapping) else rms


def _camera(adjustment: Adjustment) -> Table | None:
    frame = adjustment.camera
    several = frame["camera"].nunique() > 1 if len(frame) else False
    rows, doubtful = [], []
    for row in frame.itertuples(index=False):
        if row.sigma <= 0 and row.value == 0:
            continue  # a coefficient this camera does not have
        value, sigma = rounded(row.value, row.sigma)
        name = (_short(row.camera),) if several else ()
        rows.append((*name, row.parameter, value, sigma, UNITS.get(row.parameter, "")))
        if row.parameter not in UNITS and row.sigma > 0 and abs(row.value) < 2 * row.sigma:
            doubtful.append(f"{_short(row.camera)} {row.parameter}" if several else row.parameter)
    if not rows:
        return None
    notes = []
    if doubtful:
        verb = "differs" if len(doubtful) == 1 else "differ"
        number = "by less than two standard deviations"
        notes.append(f"{', '.join(doubtful)} {verb} from zero {number}")
    names = ("camera", "parameter") if several else ("parameter",)
    title = "Cameras" if several else f"Camera {_short(frame['camera'].iloc[0])}"
    header = (*names, "value", "sigma", "unit")
    return Table(title, header, tuple(rows), names=len(names), notes=tuple(notes))


def _effects(adjustment: Adjustment) -> Table | None:
    frame = adjustment.effects
    if not len(frame):
        return None
    rows, notes = [], []
    for (slug, parameter), part in frame.groupby(["slug", "parameter"], sort=False):
        unit = str(part["unit"].iloc[0])
        listed = part if len(part) <= MOST_GROUPS else part.iloc[:0]
        for row in listed.itertuples(index=False):
            value, sigma = rounded(row.value, row.sigma)
            ratio = abs(row.value) / row.sigma if row.sigma > 0 else math.nan
            rows.append(
                (_short(slug), parameter, _short(row.group, 16), value, sigma, unit, _times(ratio))
            )
        if len(part) > MOST_GROUPS:
            values = part["value"].to_numpy(dtype=float)
            typical = float(np.nanmedian(part["sigma"].to_numpy(dtype=float)))
            value, sigma = rounded(float(np.nanmean(values)), typical)
            low, high = (rounded(v, typical)[0] for v in (np.nanmin(values), np.nanmax(values)))
            rows.append(
                (_short(slug), parameter, f"{len(part):,} groups", value, sigma, unit, DASH)
            )
            notes.append(
                f"{_short(slug)} {parameter}: mean of the groups and median of their sigmas; "
                f"values from {low} to {high} {unit}".rstrip()
            )
    header = ("effect", "parameter", "of", "value", "sigma", "unit", "value/sigma")
    return Table("Effects", header, tuple(rows), names=3, notes=tuple(notes))


def _times(ratio: float) -> str:
    if not math.isfinite(ratio):
        return DASH
    return f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}"


def _lever_arms(adjustment: Adjustment) -> Table | None:
    frame = adjustment.lever_arm
    if not len(frame):
        return None
    rows = []
    for row in frame.itertuples(index=False):
        held = bool(getattr(row, "fixed", False))
        pairs = [
            rounded(value, 0.0 if held else sigma)
            for value, sigma in ((row.x, row.sx), (row.y, row.sy), (row.z, row.sz))
        ]
        rows.append((_short(row.flight), *(text for pair in pairs for text in pair)))
    header = ("flight", "x", "sigma", "y", "sigma", "z", "sigma")
    note = "metres, camera frame (x right, y down, z forward), camera to antenna"
    return Table("Lever arm of the GNSS antenna", header, tuple(rows), notes=(note,))


def _check_points(adjustment: Adjustment) -> Table | None:
    frame = adjustment.check_points
    if not len(frame):
        return None
    values = frame[["dx", "dy", "dz"]].to_numpy(dtype=float)
    digits = _metre_digits(values)
    size = np.linalg.norm(np.nan_to_num(values), axis=1)
    shown = np.arange(len(frame))
    notes = ["metres, adjusted minus given; sigma of the adjusted point"]
    if len(frame) > MOST_CHECK_POINTS:
        shown = np.sort(np.argsort(-size, kind="stable")[:MOST_CHECK_POINTS])
        left_out = len(frame) - MOST_CHECK_POINTS
        notes.append(
            f"the {MOST_CHECK_POINTS} largest; {_counted(left_out, 'smaller one')} left out"
        )
    rows = []
    for row in frame.iloc[shown].itertuples(index=False):
        sigmas = [getattr(row, name, math.nan) for name in ("sx", "sy", "sz")]
        rays = getattr(row, "rays", None)
        rows.append(
            (
                _short(row.point),
                *(_fixed(value, digits) for value in (row.dx, row.dy, row.dz)),
                *(_fixed(value, digits) for value in sigmas),
                DASH if rays is None or pd.isna(rays) else f"{int(rays):,}",
            )
        )
    header = ("check point", "dx", "dy", "dz", "sigma x", "sigma y", "sigma z", "images")
    return Table("Check points", header, tuple(rows), notes=tuple(notes))


def _check_statistics(adjustment: Adjustment) -> Table | None:
    if not len(adjustment.check_points):
        return None
    values = adjustment.check_points[["dx", "dy", "dz"]].to_numpy(dtype=float)
    digits = _metre_digits(values)
    rows = []
    for name, found in (
        ("RMS", adjustment.check_rms),
        ("mean", adjustment.check_mean),
        ("STD", adjustment.check_std),
    ):
        rows.append((name, *(_fixed(v, digits) for v in (found.xy, found.z, found.d3))))
    note = "metres; RMS about zero, STD about the mean"
    title = (
        f"{_counted(len(values), 'check point')} together" if len(values) > 1 else "The check point"
    )
    return Table(title, ("", "xy", "z", "3D"), tuple(rows), notes=(note,))


def _correlations(adjustment: Adjustment) -> Table | None:
    rows = tuple(
        (_short(c["a"], 34), _short(c["b"], 34), _coefficient(c["mean"]), _fixed(c["std"], 3))
        for c in adjustment.correlations
    )
    if not rows:
        return None
    header = ("of", "with", "mean", "STD")
    note = "over all images or points the second name stands for"
    return Table("Correlations with position", header, rows, names=2, notes=(note,))


def _high_correlations(adjustment: Adjustment) -> Table | None:
    pairs = sorted(adjustment.high_correlations, key=lambda c: -abs(c["value"]))
    names, _ = adjustment.correlation_matrix
    if not pairs:
        if len(names) < 2:
            return None
        note = f"none of the {len(names):,} parameters' correlations is above {STRONG}"
        return Table("Strong correlations", (), (), notes=(note,))
    shown = pairs[:MOST_CORRELATIONS]
    rows = tuple((_short(c["a"], 38), _short(c["b"], 38), _coefficient(c["value"])) for c in shown)
    notes = [f"between parameters, above {STRONG} in size"]
    if len(pairs) > len(shown):
        notes.append(f"{_counted(len(pairs) - len(shown), 'further pair')} above it left out")
    return Table(
        "Strong correlations", ("of", "with", "correlation"), rows, names=2, notes=tuple(notes)
    )


def _coefficient(value: float) -> str:
    """Three decimals; more where the coefficient is so near to one that three would hide it."""
    value = float(value)
    if not math.isfinite(value):
        return DASH
    rest = 1 - abs(value)
    digits = 3 if rest >= 0.0005 else min(6, 1 - math.floor(math.log10(max(rest, 1e-6))))
    return _unsigned_zero(f"{value:.{digits}f}")


# ---------------------------------------------------------------------------------------------
# Text and HTML


def as_text(adjustment: Adjustment) -> str:
    """The report for a terminal, at most 100 columns wide."""
    lines = textwrap.wrap(headline(adjustment), COLUMNS)
    for warning in adjustment.warnings:
        lines += textwrap.wrap(
            str(warning), COLUMNS, initial_indent="  ! ", subsequent_indent="    "
        )
    for table in tables(adjustment):
        lines += ["", table.title]
        lines += _text_rows(table)
        for note in table.notes:
            lines += textwrap.wrap(note, COLUMNS, initial_indent="  ", subsequent_indent="  ")
    return "\n".join(lines)


def _text_rows(table: Table) -> list[str]:
    if not table.rows:
        return []
    grid = [table.header, *table.rows]
    widths = [max(len(row[k]) for row in grid) for k in range(len(table.header))]
    made = []
    for row in grid:
        fields = [
            text.ljust(width) if k < table.names or _is_unit(table, k) else text.rjust(width)
            for k, (text, width) in enumerate(zip(row, widths, strict=True))
        ]
        made.append(("  " + "  ".join(fields)).rstrip()[:COLUMNS])
    made.insert(1, "  " + "-" * min(sum(widths) + 2 * (len(widths) - 1), COLUMNS - 2))
    return made


def _is_unit(table: Table, column: int) -> bool:
    return table.header[column] in ("unit", "RMS without outliers")


STYLE = """
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


def as_html(adjustment: Adjustment) -> str:
    """The same report as a piece of HTML, for a notebook; the same input gives the same text."""
    parts = [f"<style>{STYLE}</style>", '<div class="corridor-report">']
    parts.append(f"<p>{_escape(headline(adjustment))}</p>")
    parts += [f'<p class="warning">{_escape(w)}</p>' for w in adjustment.warnings]
    parts += [_html_table(table) for table in tables(adjustment)]
    parts.append("</div>")
    return "\n".join(parts)


def _html_table(table: Table) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        made = []
        for k, text in enumerate(row):
            kind = ' class="name"' if k < table.names or _is_unit(table, k) else ""
            made.append(f"<{tag}{kind}>{_escape(text)}</{tag}>")
        return "<tr>" + "".join(made) + "</tr>"

    lines = ["<table>", f"<caption>{_escape(table.title)}</caption>"]
    if table.rows:
        lines.append(f"<thead>{cells('th', table.header)}</thead>")
        lines.append("<tbody>" + "\n".join(cells("td", row) for row in table.rows) + "</tbody>")
    lines.append("</table>")
    lines += [f'<p class="note">{_escape(note)}</p>' for note in table.notes]
    return "\n".join(lines)


def _escape(text: object) -> str:
    return html.escape(str(text))


PAGE_STYLE = """
body {margin: 2.2em auto; padding: 0 1.2em; max-width: 62em; color: #222; background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif}
h1 {font-size: 1.35em; font-weight: 600; margin: 0 0 .6em}
h2 {font-size: 1.05em; font-weight: 600; margin: 2.2em 0 .2em}
figure {margin: 1.6em 0}
figure img {max-width: 100%; height: auto; display: block}
figcaption {color: #555; font-size: .9em; max-width: 46em}
.corridor-report {font-size: 14px; max-width: none; overflow-x: auto}
.corridor-report > p:first-of-type {font-size: 1.12em}
@media print {body {margin: 0; max-width: none} figure, table {break-inside: avoid}}
""".strip()


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
        f"<style>{PAGE_STYLE}</style></head>",
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


# ---------------------------------------------------------------------------------------------
# For other programs


def as_dict(adjustment: Adjustment) -> dict[str, Any]:
    """The content of `adjustment.json` (design, section 7): finite numbers or None.

    An effect with one group is {parameter: {value, sigma, unit}}, with several
    {group: {parameter: ...}}; of more than 50 groups there is a summary for each parameter
    and, in a saved folder, a table `effect_SLUG.csv`.
    """
    observations: dict[str, Any] = {kind: {} for kind in KINDS}
    for kind, found in adjustment.observations.items():
        observations[kind] = dict(found)
    check = {
        name: {"xy": found.xy, "z": found.z, "3d": found.d3}
        for name, found in (
            ("rms", adjustment.check_rms),
            ("mean", adjustment.check_mean),
            ("std", adjustment.check_std),
        )
    }
    camera: dict[str, dict] = {}
    for row in adjustment.camera.itertuples(index=False):
        camera.setdefault(str(row.camera), {})[str(row.parameter)] = {
            "value": row.value,
            "sigma": row.sigma,
        }
    lever_arm = {
        str(row.flight): {
            axis: {"value": getattr(row, axis), "sigma": getattr(row, f"s{axis}")} for axis in "xyz"
        }
        for row in adjustment.lever_arm.itertuples(index=False)
    }
    names, _ = adjustment.correlation_matrix
    return _clean(
        {
            "block": adjustment.block.name,
            "converged": bool(adjustment.converged),
            "iterations": adjustment.iterations,
            "seconds": adjustment.seconds,
            "sigma0": adjustment.sigma0,
            "redundancy": adjustment.redundancy,
            "observations": observations,
            "camera": camera,
            "effects": _effects_dict(adjustment.effects),
            "lever_arm": lever_arm,
            "check_points": {
                "rows": adjustment.check_points.to_dict(orient="records"),
                **check,
            },
            "correlations": list(adjustment.correlations),
            "high_correlations": list(adjustment.high_correlations),
            "parameters": len(names),
            "warnings": [str(warning) for warning in adjustment.warnings],
        }
    )


def _effects_dict(frame: pd.DataFrame) -> dict[str, Any]:
    made: dict[str, Any] = {}
    for slug, effect in frame.groupby("slug", sort=False) if len(frame) else ():
        groups = effect["group"].astype(str).nunique()
        if groups > MOST_GROUPS_IN_JSON:
            made[str(slug)] = {
                str(name): {
                    "groups": len(part),
                    "mean": part["value"].mean(),
                    "std": part["value"].std(),
                    "min": part["value"].min(),
                    "max": part["value"].max(),
                    "sigma": part["sigma"].median(),
                    "unit": str(part["unit"].iloc[0]),
                    "table": effect_table(str(slug)),
                }
                for name, part in effect.groupby("parameter", sort=False)
            }
            continue
        by_group: dict[str, dict] = {}
        for row in effect.itertuples(index=False):
            by_group.setdefault(str(row.group), {})[str(row.parameter)] = {
                "value": row.value,
                "sigma": row.sigma,
                "unit": str(row.unit),
            }
        made[str(slug)] = next(iter(by_group.values())) if groups == 1 else by_group
    return made


def effect_table(slug: str) -> str:
    """Name of the table of an effect with many groups."""
    return f"effect_{slug}.csv"


def _clean(value: Any) -> Any:
    """Plain Python values that JSON can hold; None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _clean(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _clean(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_clean(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if value is None or value is pd.NA:
        return None
    return str(value)


# ---------------------------------------------------------------------------------------------
# A folder


def save(
    adjustment: Adjustment,
    folder: str | os.PathLike,
    pictures: Mapping[str, Any] | None = None,
    captions: Mapping[str, str] | None = None,
) -> list[Path]:
    """Writes the result into `folder`, whole or not at all; returns the paths, sorted.

    adjustment.json, report.html (one page, pictures inside), block/ (the adjusted block), one
    PNG for each picture, check_points.csv, poses.csv, outliers.csv (image measurements held to be
    wrong) and effect_SLUG.csv for an effect of more than 50 groups.
    pictures: matplotlib figures by name; captions: one sentence for each, for the page.
    An earlier result in `folder` is replaced; what else lies there stays. Raises InputError where
    `folder` is a file, or holds something but no earlier result.
    """
    folder = Path(folder)
    earlier = _earlier(folder)
    with whole_folder(folder, RESULT, lambda name: name in earlier) as part:
        _write(adjustment, part, pictures or {}, captions or {})
        written = _files(part)
    return [folder / name for name in written]


def _earlier(folder: Path) -> set[str]:
    """Entries of `folder` that an earlier adjustment wrote, as its own list has them."""
    try:
        files = json.loads((folder / RESULT).read_text(encoding="utf-8"))["files"]
        return {RESULT, *(str(name).split("/")[0] for name in files)}
    except (OSError, ValueError, KeyError, TypeError):
        return {RESULT}


def _write(
    adjustment: Adjustment, folder: Path, pictures: Mapping[str, Any], captions: Mapping[str, str]
) -> None:
    adjustment.block.write(folder / "block")
    shown = []
    for name, figure in pictures.items():
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=144, metadata={"Software": None})
        (folder / f"{name}.png").write_bytes(stream.getvalue())
        shown.append((name.replace("_", " "), captions.get(name, ""), stream.getvalue()))
    (folder / "report.html").write_text(as_page(adjustment, shown), encoding="utf-8")
    if len(adjustment.check_points):
        _write_csv(adjustment.check_points, folder / "check_points.csv")
    _write_csv(adjustment.poses, folder / "poses.csv")
    outliers = _outliers(adjustment)
    if len(outliers):
        _write_csv(outliers, folder / "outliers.csv")
    if len(adjustment.effects):
        for slug, part in adjustment.effects.groupby("slug", sort=False):
            if part["group"].astype(str).nunique() > MOST_GROUPS_IN_JSON:
                _write_csv(part.drop(columns="slug"), folder / effect_table(str(slug)))
    content = as_dict(adjustment)
    content["pictures"] = [f"{name}.png" for name in pictures]
    content["files"] = sorted([RESULT, *_files(folder)])
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / RESULT).write_text(text + "\n", encoding="utf-8")


def _outliers(adjustment: Adjustment) -> pd.DataFrame:
    """Image measurements flagged as outlier or gross error, largest first."""
    parts = []
    for kind in ("tie", "mark"):
        table = adjustment.residuals.get(kind)
        if table is None or not len(table):
            continue
        flagged = np.zeros(len(table), dtype=bool)
        for flag in ("outlier", "gross"):
            if flag in table:
                flagged |= table[flag].to_numpy(dtype=bool)
        part = table.loc[flagged, ["point", "image", "x", "y", "vx", "vy", "sigma"]]
        part = part.astype({"point": str, "image": str})
        parts.append(part.assign(kind=kind))
    if not parts:
        return pd.DataFrame()
    every = pd.concat(parts, ignore_index=True)
    size = np.hypot(every["vx"], every["vy"]) / every["sigma"]
    return every.iloc[np.argsort(-size.to_numpy(), kind="stable")]


def _write_csv(frame: pd.DataFrame, path: Path) -> None:
    frame.to_csv(path, index=False, float_format="%.10g", lineterminator="\n")


def _files(folder: Path) -> list[str]:
    """Every file below a folder, relative, with forward slashes, sorted."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    )
