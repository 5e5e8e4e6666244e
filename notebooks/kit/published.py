"""What others have published, and whether it holds here.

The register `notebooks/published.toml` lists every figure of another work that a chapter or a
test compares itself with. `compare` sets our numbers beside it and says of each: holds, does
not hold, cannot tell. Only predictions are counted as confirmations: what was put in, tuned or
compared with itself could not have come out otherwise. `python -m kit.published` gathers the
verdict tables shown in the executed notebooks into one page, `notebooks/verdicts.md`.
"""

import argparse
import html
import json
import math
import os
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from corridor.core.errors import InputError

NOTEBOOKS = Path(__file__).resolve().parents[1]
HOLDS, FAILS, UNKNOWN = "holds", "does not hold", "cannot tell"
MIME = "application/vnd.corridor.verdicts+json"
COLUMNS = ("statement", "source", "kind", "published", "ours", "ours / published", "verdict", "why")

KINDS = {
    "prediction": "a number that could have come out otherwise",
    "statement": "a sentence of the source, put as a bound or a ratio",
    "tuned": "a free choice of ours was made with it",
    "input": "we put it in",
    "consistency": "the source against itself, or a program against itself",
}
# Who says the number: what a chapter re-does is one thing, a check of the software another.
GROUPS = {
    "works": "the thesis and its articles",
    "flights": "other studies of flights, done again",
    "cameras": "cameras that others measured, or their makers state",
    "programs": "other programs on the same files: checks of the software",
}
_NEEDED = ("source", "where", "row", "value", "unit", "tolerance", "chapter", "kind")
_OPTIONAL = ("note", "bound", "basis", "group")
# More rows than these are folded, but for those that do not hold.
_FOLDED = 12
BOUNDS = ("", "at most", "at least")
BY_DRAWS = "draws"


@dataclass(frozen=True)
class Published:
    """One published figure: a number, or a few that belong together (x, y, z).

    `where` is the table, figure or file section in `source`, `row` the line of it. `kind`: one of
    `KINDS`. `tolerances`: one a value, in its unit; `by_draws`: it holds as well where it
    lies within the range of our draws. `digits` are the decimals worth showing: those printed, or
    those of the tolerance if it is finer. `basis` says where the tolerance comes from. `bound`:
    `at most` or `at least` where the statement is that ours lies on that side of the value.
    """

    id: str
    source: str
    where: str
    row: str
    values: tuple[float, ...]
    unit: str
    kind: str
    tolerances: tuple[float, ...]
    by_draws: bool
    digits: int
    chapter: str
    note: str = ""
    bound: str = ""
    basis: str = ""
    group: str = "programs"

    @property
    def value(self) -> float | np.ndarray:
        """The number, or an array of those that belong together."""
        return self.values[0] if len(self.values) == 1 else np.array(self.values)

    @property
    def allowed(self) -> np.ndarray:
        """Largest difference that still holds, for each value."""
        return np.array(self.tolerances)

    def text(self, values: Iterable[float]) -> str:
        """Values as a person writes them: the same decimals, the unit once."""
        numbers = ", ".join(_fixed(v, self.digits) for v in values)
        return f"{numbers} {self.unit}".strip()


@dataclass(frozen=True)
class Draws:
    """Our number from several seeds: judged by its median, shown with its range.

    values: (draws,), or (draws, numbers) where several belong together.
    """

    values: np.ndarray

    @property
    def _rows(self) -> np.ndarray:
        values = np.asarray(self.values, dtype=float)
        return values.reshape(len(values), -1)

    @property
    def median(self) -> np.ndarray:
        """(numbers,), NaN without any draw."""
        return np.median(self._rows, axis=0) if len(self._rows) else np.array([np.nan])

    @property
    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest (numbers,)."""
        return self._rows.min(axis=0), self._rows.max(axis=0)


@dataclass(frozen=True)
class Verdict:
    """A published figure, ours (None: not to be had here), the word and the reason.

    lowest, highest: of ours, where it is the median of several draws.
    """

    published: Published
    ours: tuple[float, ...] | None
    word: str
    why: str
    lowest: tuple[float, ...] | None = None
    highest: tuple[float, ...] | None = None

    def cells(self) -> dict[str, str]:
        """The row of the table, rounded as it is shown."""
        entry = self.published
        return {
            "statement": entry.row,
            "source": f"{entry.source}, {entry.where}",
            "kind": entry.kind,
            "published": f"{entry.bound} {entry.text(entry.values)}".strip(),
            "ours": self._ours(),
            "ours / published": self._ratio(),
            "verdict": self.word,
            "why": self.why,
        }

    def _ratio(self) -> str:
        entry = self.published
        if self.ours is None or entry.bound or not any(entry.values):
            return ""
        # Of the numbers as they are shown, so that a reader finds the same.
        return ", ".join(
            f"{float(_fixed(mine, entry.digits)) / theirs:.2f}" if theirs else "-"
            for mine, theirs in zip(self.ours, entry.values, strict=True)
        )

    def _ours(self) -> str:
        entry = self.published
        if self.ours is None:
            return ""
        if self.lowest is None:
            return entry.text(self.ours)
        parts = [
            f"{_fixed(v, entry.digits)} ({_fixed(a, entry.digits)} to {_fixed(b, entry.digits)})"
            for v, a, b in zip(self.ours, self.lowest, self.highest, strict=True)
        ]
        return f"{', '.join(parts)} {entry.unit}".strip()


class Verdicts:
    """A verdict table: prints as text, shows itself in a notebook, counts itself."""

    def __init__(self, verdicts: Iterable[Verdict]):
        self.verdicts = list(verdicts)

    def __iter__(self):
        return iter(self.verdicts)

    def __len__(self):
        return len(self.verdicts)

    def __getitem__(self, identifier: str) -> Verdict:
        for verdict in self.verdicts:
            if verdict.published.id == identifier:
                return verdict
        raise KeyError(identifier)

    def __add__(self, other: "Verdicts") -> "Verdicts":
        return Verdicts([*self.verdicts, *other.verdicts])

    @property
    def hold(self) -> bool:
        """True if every statement of the table holds."""
        return all(verdict.word == HOLDS for verdict in self.verdicts)

    @property
    def counts(self) -> dict[str, dict[str, int]]:
        """Of each kind: how many hold, do not hold, cannot be told."""
        return _counts(v.cells() for v in self.verdicts)

    @property
    def table(self) -> pd.DataFrame:
        """One row a statement, as text: the columns of COLUMNS."""
        rows = [v.cells() for v in self.verdicts]
        return pd.DataFrame(rows, columns=list(COLUMNS), dtype=str)

    def __str__(self):
        # Sources are long and the same for many rows: they head their rows.
        lines, source = [], None
        rows, notes = _notes_once([v.cells() for v in self.verdicts])
        shown = COLUMNS[0], *COLUMNS[2:-1]
        wide = {c: max([len(c), *(len(r[c]) for r in rows)]) for c in shown}
        lines.append("  ".join(c.ljust(wide[c]) for c in shown) + "  why")
        for row in rows:
            if row["source"] != source:
                source = row["source"]
                lines.append(f"-- {source}")
            cells = [row[c].ljust(wide[c]) for c in shown]
            lines.append("  ".join([*cells, row["why"]]).rstrip())
        lines += notes
        lines.append(_sentence(self.counts))
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self):
        rows, notes = _notes_once([v.cells() for v in self.verdicts])
        below = "".join(f"<p>{html.escape(note)}</p>" for note in notes)
        words = f"<p>{html.escape(_sentence(self.counts))}</p>"
        if len(rows) <= _FOLDED:
            return words + _html_table(rows) + below
        open_rows = [row for row in rows if row["verdict"] != HOLDS]
        rest = [row for row in rows if row["verdict"] == HOLDS]
        folded = f"<details><summary>{len(rest)} rows hold</summary>{_html_table(rest)}</details>"
        return words + (_html_table(open_rows) if open_rows else "") + below + folded

    def _repr_mimebundle_(self, include=None, exclude=None):
        # What `page` gathers: the notebook itself is the record of what it found.
        return {MIME: {"rows": [v.cells() for v in self.verdicts]}}


def read(path: str | os.PathLike | None = None) -> dict[str, Published]:
    """The register, by id (`strasbourg.sigma0`).

    path: the .toml file; by default the one in the project's notebooks folder.
    Raises InputError where the file is missing or an entry is incomplete.
    """
    path = NOTEBOOKS / "published.toml" if path is None else Path(path)
    try:
        # Decimal keeps the printed digits: 0.040 is not 0.04.
        tables = tomllib.loads(path.read_text(encoding="utf-8"), parse_float=Decimal)
    except OSError as error:
        raise InputError(f"{path}: the register cannot be read ({error.strerror}).") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}.") from error
    register: dict[str, Published] = {}
    _collect(tables, "", {}, register, path)
    return register


def compare(
    ours: Mapping[str, float | Iterable[float] | Draws | None],
    why: Mapping[str, str] | None = None,
    absent: str = "not measured here",
    register: Mapping[str, Published] | None = None,
) -> Verdicts:
    """Verdicts on our numbers, in the order given.

    ours: id in the register -> our number or numbers in the register's unit, or `Draws` of them;
        None or NaN where there is none.
    why: id -> reason, to stand in place of the automatic one (of a row that does not hold: the
        difference and the register's note).
    absent: the reason of rows without a number of ours.
    Raises InputError for an id that is not in the register or a wrong count of numbers.
    """
    register = read() if register is None else register
    verdicts = []
    for identifier, value in ours.items():
        if identifier not in register:
            raise InputError(
                f"notebooks/published.toml has no entry {identifier!r}: add its source, table, "
                "row, value and tolerance there."
            )
        verdicts.append(_judge(register[identifier], value, (why or {}).get(identifier), absent))
    return Verdicts(verdicts)


def reasons(
    plain: Verdicts, with_it: Mapping[str, Verdicts], where: str, none_of: str = ""
) -> dict[str, str]:
    """For every row that does not hold: with which change it does, or how near the nearest comes.

    with_it: the same rows with one thing changed, by what that is; where: the reader finds those
    runs; none_of: words for all of them, by default they are listed.
    """
    found = {}
    for verdict in plain:
        identifier = verdict.published.id
        if verdict.word == FAILS:
            cures = [words for words, table in with_it.items() if table[identifier].word == HOLDS]
            found[identifier] = (
                f"holds with {', '.join(cures)} {where}" if cures
                else _nearest_miss({w: t[identifier] for w, t in with_it.items()}, none_of)
            )  # fmt: skip
    return found


def _nearest_miss(of: Mapping[str, Verdict], none_of: str = "") -> str:
    """Which number of a row that holds with no change is off, where it is least so."""
    off = {
        words: np.abs(np.subtract(one.ours, one.published.values)) / one.published.allowed
        for words, one in of.items()
        if one.ours is not None
    }
    words = min(off, key=lambda name: off[name].max())
    k, one = int(off[words].argmax()), of[words]
    two = ("RMS ", "STD ") if one.published.row.endswith("STD") else ("horizontal ", "height ")
    names = {3: ("RMS ", "mean ", "STD "), 2: two}
    part = names.get(len(off[words]), [""])[k]
    head = f"holds with none of {none_of or ', '.join(off)}; nearest with {words}:"
    if len(off) == 1:
        head = f"does not hold with {words} either:"
    return f"{head} {part}{one.published.text([one.ours[k]])}"


def page(notebooks: str | os.PathLike | None = None) -> str:
    """Markdown page of every verdict shown in the executed notebooks of a folder."""
    folder = NOTEBOOKS if notebooks is None else Path(notebooks)
    shown = {path: _shown(path) for path in sorted(folder.glob("*.ipynb"))}
    every = [row for rows in shown.values() for row in rows]
    said_by = {f"{one.source}, {one.where}": one.group for one in read().values()}

    def of(group):
        return _counts(r for r in every if said_by.get(r["source"], "programs") == group)

    head = [
        "# What holds\n",
        "Every published number that a notebook compares itself with, as the executed notebooks",
        "show it. Made by `python -m kit.published`; do not edit.\n",
        f"**{_headline(of('works'), GROUPS['works'])}**\n",
        "A prediction could have come out otherwise; only predictions count. By who says it:\n",
        "| who says it | hold | do not hold | cannot tell |",
        "| --- | --- | --- | --- |",
    ]
    for group, words in GROUPS.items():
        counts = of(group).get("prediction")
        if counts:
            numbers = " | ".join(str(counts[word]) for word in (HOLDS, FAILS, UNKNOWN))
            head.append(f"| {words} | {numbers} |")
    head += ["", "| kind | what it is | hold | do not hold | cannot tell |"]
    head.append("| --- | --- | --- | --- | --- |")
    for kind, counts in _counts(every).items():
        numbers = " | ".join(str(counts[word]) for word in (HOLDS, FAILS, UNKNOWN))
        head.append(f"| {kind} | {KINDS[kind]} | {numbers} |")
    parts = []
    for path, rows in shown.items():
        if rows:
            parts += [f"\n## [{path.stem}]({path.name})\n", f"{_sentence(_counts(rows))}\n"]
            rows, notes = _notes_once(rows)
            parts.append("| " + " | ".join(COLUMNS) + " |")
            parts.append("|" + " --- |" * len(COLUMNS))
            parts += ["| " + " | ".join(_cell(row[c]) for c in COLUMNS) + " |" for row in rows]
            parts += [f"\n{note}" for note in notes]
    return "\n".join([*head, *parts]) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Write the page of verdicts; with --check only say whether it is current (status 1: no)."""
    parser = argparse.ArgumentParser(
        prog="python -m kit.published",
        description="Write notebooks/verdicts.md from the verdict tables in the notebooks.",
    )
    parser.add_argument("--check", action="store_true", help="only say whether it is current")
    options = parser.parse_args(arguments)
    target, text = NOTEBOOKS / "verdicts.md", page()
    if options.check:
        current = target.exists() and target.read_text(encoding="utf-8") == text
        print(f"{target}: {'current' if current else 'out of date'}")
        return 0 if current else 1
    target.write_text(text, encoding="utf-8", newline="\n")
    print(f"wrote {target}")
    return 0


def _collect(table, prefix, inherited, register, path):
    """Walk the tables: one with a `value` is an entry, any other hands its words down."""
    own = {k: v for k, v in table.items() if not isinstance(v, dict)}
    fields = {**inherited, **own}
    if "value" in own:
        register[prefix] = _entry(prefix, fields, path)
        return
    for name, below in table.items():
        if isinstance(below, dict):
            _collect(below, f"{prefix}.{name}" if prefix else name, fields, register, path)


def _entry(identifier, fields, path):
    missing = [name for name in _NEEDED if name not in fields]
    unknown = [name for name in fields if name not in (*_NEEDED, *_OPTIONAL)]
    if missing or unknown:
        problem = f"lacks {', '.join(missing)}" if missing else f"has unknown {', '.join(unknown)}"
        raise InputError(
            f"{path}, [{identifier}] {problem}: an entry has {', '.join(_NEEDED)} and may have "
            f"{', '.join(_OPTIONAL)}."
        )
    values = fields["value"] if isinstance(fields["value"], list) else [fields["value"]]
    try:
        if fields["kind"] not in KINDS or fields.get("group", "programs") not in GROUPS:
            raise ValueError
        allowed, digits = _tolerances(fields["tolerance"], values)
        return Published(
            id=identifier,
            values=tuple(float(v) for v in values),
            tolerances=allowed,
            by_draws=str(fields["tolerance"]).startswith(BY_DRAWS),
            digits=digits,
            **{k: str(fields[k]) for k in ("source", "where", "row", "unit", "chapter", "kind")},
            **{k: str(fields.get(k, "")) for k in ("note", "basis")},
            bound=_bound(fields.get("bound", "")),
            group=str(fields.get("group", "programs")),
        )
    except (ValueError, ArithmeticError, TypeError) as error:
        raise InputError(
            f"{path}, [{identifier}]: value is a number or a list of numbers, tolerance a number, "
            'a percentage such as "1 %", a list with one of these a value, "draws" or '
            '"draws or 5 %", bound '
            f'"at most" or "at least", kind one of {", ".join(KINDS)}, '
            f"group one of {', '.join(GROUPS)}."
        ) from error


def _tolerances(given, values):
    """Allowed difference of each value, and the decimals worth showing."""
    printed = max(_decimals(v) for v in values)
    rounding = 0.5 * 10.0**-printed
    by_draws = isinstance(given, str) and given.startswith(BY_DRAWS)
    if by_draws:
        given = given.removeprefix(BY_DRAWS).removeprefix(" or ") or "0 %"
    several = given if isinstance(given, list) else [given] * len(values)
    if len(several) != len(values):
        raise ValueError
    allowed, digits = [], printed
    for one, value in zip(several, values, strict=True):
        if isinstance(one, str):
            number, sign = one.split()
            if sign != "%":
                raise ValueError
            share = float(Decimal(number) / 100 * abs(Decimal(value)))
            allowed.append(max(share, rounding) if by_draws or not share else share)
        else:
            allowed.append(float(one))
            digits = max(digits, _decimals(one))
    return tuple(allowed), digits


def _bound(word):
    if word not in BOUNDS:
        raise ValueError
    return word


def _judge(entry, ours, why, absent):
    """Verdict on one figure; judged on all digits, shown rounded."""
    if ours is None:
        return Verdict(entry, None, UNKNOWN, why or absent)
    spread = ()
    if isinstance(ours, Draws):
        # One draw has no range.
        if len(ours.values) > 1:
            spread = tuple(tuple(map(float, end)) for end in ours.range)
        ours = ours.median
    values = tuple(float(v) for v in np.atleast_1d(np.asarray(ours, dtype=float)).ravel())
    if len(values) != len(entry.values):
        raise InputError(
            f"{entry.id}: {len(entry.values)} published number(s) cannot be compared with "
            f"{len(values)} of ours."
        )
    if not all(math.isfinite(v) for v in values):
        return Verdict(entry, None, UNKNOWN, why or absent)
    off = np.array(values) - np.array(entry.values)
    off = {"": np.abs(off), "at most": off, "at least": -off}[entry.bound]
    # A difference that is written like the tolerance must not fail on binary rounding.
    good = off <= entry.allowed * (1 + 1e-9) + 1e-12
    if entry.by_draws and spread:
        low, high = np.array(spread)
        theirs, half = np.array(entry.values), entry.allowed
        good |= (low - half <= theirs) & (theirs <= high + half)
    if good.all():
        return Verdict(entry, values, HOLDS, why or "", *spread)
    return Verdict(entry, values, FAILS, why or entry.note, *spread)


def _decimals(number):
    exponent = Decimal(number).as_tuple().exponent
    return max(0, -exponent) if isinstance(exponent, int) else 0


def _fixed(value, digits):
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0 else text


def _counts(rows):
    """Kind -> verdict -> rows, of the kinds that there are."""
    counts = {kind: dict.fromkeys((HOLDS, FAILS, UNKNOWN), 0) for kind in KINDS}
    for row in rows:
        counts[row["kind"]][row["verdict"]] += 1
    return {kind: words for kind, words in counts.items() if any(words.values())}


def _headline(counts, of=""):
    """Predictions alone."""
    words = counts.get("prediction")
    of = f" of {of}" if of else ""
    if words is None:
        return f"No prediction{of} is compared."
    told = words[HOLDS] + words[FAILS]
    open_rows = f"; {words[UNKNOWN]} cannot be told" if words[UNKNOWN] else ""
    return f"{words[HOLDS]} of {told} predictions{of} hold{open_rows}."


def _notes_once(rows):
    """Rows with a number where a reason stands more than once, and the reasons by number."""
    often = Counter(row["why"] for row in rows if row["why"])
    several = [why for why, count in often.items() if count > 1]
    letters = {why: f"note {number}" for number, why in enumerate(several, start=1)}
    short = [row | {"why": letters.get(row["why"], row["why"])} for row in rows]
    return short, [f"{letter}: {why}" for why, letter in letters.items()]


def _sentence(counts):
    """Predictions first; what is no confirmation is named, not added."""
    rest = [
        f"{words[HOLDS]} of {words[HOLDS] + words[FAILS]} {kind}"
        for kind, words in counts.items()
        if kind != "prediction"
    ]
    return _headline(counts) + (f" Not counted: {', '.join(rest)}." if rest else "")


def _html_table(rows):
    head = "".join(f"<th>{c}</th>" for c in COLUMNS)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(row[c])}</td>" for c in COLUMNS) + "</tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _cell(text):
    return text.replace("|", "\\|").replace("\n", " ")


def _shown(path: Path) -> list[dict[str, Any]]:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    rows = []
    for cell in notebook.get("cells", []):
        for output in cell.get("outputs", []):
            rows += output.get("data", {}).get(MIME, {}).get("rows", [])
    return rows


if __name__ == "__main__":
    sys.exit(main())
