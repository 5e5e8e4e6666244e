"""Never judged on what it was tuned on: flights left out in turn, and which numbers matter.

    python -m benchmarks.diagnosis.protocol FOLDER -o OUT.json [--fit NAME=V,V ...]
        [--sensitivity NAME,NAME|all] [--only WORD,WORD] [--figures docs/guarantees.json]

FOLDER holds blocks with what is true of them: NAME and NAME.truth.json, as `real_noise` writes them
and as anybody may lay them there; nothing hidden is `{"effects": []}`. A flight is what the truth
names (`"flight": "saraburi 2"`), else the folder below FOLDER in which the block lies, else the
block itself. All parts of one flight share its light, its ground and its lens, so they are left out
together: each number that `--fit` names takes the value that does best on all other flights, and
the flight is judged with that. Results are told a flight and pooled, with their intervals (Wilson
1927). `--sensitivity` halves and doubles numbers of `Settings`, one at a time, and counts which
answers change. OUT keeps a row for each block and setting when it is done: the same command goes
on where it stopped.
Source: Stone 1974, "Cross-validatory choice and assessment of statistical predictions".
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from benchmarks.diagnosis.rates import Rate
from benchmarks.diagnosis.real_rates import row_of
from benchmarks.diagnosis.truth import read_truth
from benchmarks.guarantees import table
from corridor import read
from corridor.core.errors import InputError
from corridor.core.output import whole_file, write_json
from corridor.diagnosis.settings import Settings

DEFAULT = "default"
_TRUTH = ".truth.json"
# Variants are told by their number's name and value.
Rows = Mapping[str, Mapping[str, dict]]


@dataclass(frozen=True)
class Judged:
    """A block of a flight, and the file that says what is hidden in it."""

    name: str
    flight: str
    block: Path
    truth: Path


def flights_of(folder: Path) -> list[Judged]:
    """All blocks below a folder that have their truth beside them. Raises InputError without any.

    A twin, which has no truth of its own, is no block of these.
    """
    out = []
    for file in sorted(folder.rglob(f"*{_TRUTH}")) if folder.is_dir() else []:
        block = file.with_name(file.name.removesuffix(_TRUTH))
        if not (block / "block.toml").is_file():
            continue
        read_truth(file)
        parts = block.relative_to(folder).parts
        stated = json.loads(file.read_text(encoding="utf-8")).get("flight")
        out.append(Judged("-".join(parts), str(stated or parts[0]), block, file))
    if not out:
        raise InputError(f"{folder} holds no block NAME with its NAME{_TRUTH} beside it")
    return out


def variants(fit: Mapping[str, Iterable[float]]) -> dict[str, Settings]:
    """The settings as they are, and with each value of the numbers that are fitted."""
    usual = Settings()
    out = {DEFAULT: usual}
    for name, values in fit.items():
        out |= {f"{name}={value:g}": replace(usual, **{name: value}) for value in values}
    return out


def halved_and_doubled(names: Iterable[str] = ()) -> dict[str, Settings]:
    """The settings as they are, and with each number halved and doubled; default: all numbers.

    Of several values (a grid, three axes) all together; whole numbers stay whole, and chances,
    shares and signs stay what they are.
    """
    usual, wanted = Settings(), set(names)
    unknown = wanted - {field.name for field in fields(Settings)}
    if unknown:
        raise InputError(f"Settings has no {', '.join(sorted(unknown))}")
    out = {DEFAULT: usual}
    for field in fields(Settings):
        value = getattr(usual, field.name)
        if wanted and field.name not in wanted or isinstance(value, bool):
            continue
        for factor in (0.5, 2.0):
            moved = _times(value, factor)
            if moved != value:
                out[f"{field.name} x {factor:g}"] = replace(usual, **{field.name: moved})
    return out


def _times(value, factor: float):
    if isinstance(value, tuple):
        return tuple(_times(one, factor) for one in value)
    if isinstance(value, int):
        return max(round(factor * value), 1)
    moved = factor * value
    return moved if not 0.0 < value < 1.0 else min(moved, 0.5 * (1.0 + value))


def score(row: Mapping) -> float:
    """What an answer is worth: one where it is right, less one for what is false.

    Hidden effects: 1 named, 1/2 in the set that is named; nothing hidden: 1 where nothing is said.
    """
    if row.get("failed"):
        return -1.0
    if row["kind"] == "null":
        good = float(not row["stated"])
    else:
        good = 1.0 if row["named"] else 0.5 if row["inside"] else 0.0
    return good - len(row["wrong"]) - len(row["absurd"]) - float(row["worse"])


def left_out(rows: Rows, flights: Mapping[str, str]) -> dict[str, tuple[str, dict[str, dict]]]:
    """Flight -> the variant that is best on all others, and its rows of that flight.

    rows: block -> variant -> row; those that all variants have count. Of equally good ones the
    first. flights: block -> flight. With one flight alone nothing can be left out: the settings as
    they are.
    """
    names = [name for name in rows if DEFAULT in rows[name]]
    common = [v for v in next(iter(rows.values()), {}) if all(v in rows[n] for n in names)]
    out = {}
    for flight in sorted({flights[name] for name in names}):
        others = [name for name in names if flights[name] != flight]
        each = {v: sum(score(rows[n][v]) for n in others) for v in common}
        best = max(common, key=lambda v: each[v]) if others else DEFAULT
        mine = {name: rows[name][best] for name in names if flights[name] == flight}
        out[flight] = best, mine
    return out


def told(rows: Iterable[Mapping]) -> dict[str, str]:
    """Rates of some rows, as text."""
    rows = list(rows)
    read_ = [row for row in rows if not row.get("failed")]
    hidden = [row for row in read_ if row["kind"] != "null"]
    return {
        "blocks": str(len(rows)),
        "failed": str(Rate.of(bool(row.get("failed")) for row in rows)),
        "untouched, something said": str(
            Rate.of(row["stated"] for row in read_ if row["kind"] == "null")
        ),
        "hidden, named": str(Rate.of(row["named"] for row in hidden)),
        "hidden, in the set that is named": str(Rate.of(row["inside"] for row in hidden)),
        "wrong names": str(Rate.of(bool(row["wrong"]) for row in read_)),
        "absurd values": str(Rate.of(bool(row["absurd"]) for row in read_)),
        "check points worse": str(Rate.of(row["worse"] for row in read_)),
    }


def sensitivity(rows: Rows) -> dict[str, dict]:
    """Of each variant: blocks, answers that change, and by how much the mean score does."""
    out: dict[str, dict] = {}
    for name in sorted({v for row in rows.values() for v in row} - {DEFAULT}):
        both = [(row[DEFAULT], row[name]) for row in rows.values() if {name, DEFAULT} <= set(row)]
        changed = [_answer(one) != _answer(other) for one, other in both]
        gain = np.mean([score(other) - score(one) for one, other in both]) if both else 0.0
        out[name] = {"blocks": len(both), "changed": sum(changed), "score": float(gain)}
    return out


def _answer(row: Mapping):
    """What decides about an answer: the verdict, and what is named."""
    if row.get("failed"):
        return row["failed"]
    return row["verdict"], sorted(map(str, row["effects"])), sorted(map(str, row["unknown"]))


def run(
    judged: list[Judged], settings: Mapping[str, Settings], out: Path, say=print
) -> dict[str, dict[str, dict]]:
    """Block -> variant -> row; kept in `out`."""
    rows = json.loads(out.read_text())["rows"] if out.is_file() else {}
    for one in judged:
        mine = rows.setdefault(one.name, {})
        block, truth = read(one.block), read_truth(one.truth)
        for name, values in settings.items():
            if name in mine:
                continue
            mine[name] = row_of(block, truth, values)
            say(f"{one.name}, {name}: {mine[name].get('verdict') or mine[name]['failed']}")
            with whole_file(out) as part:
                write_json({"rows": rows}, part)
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Run the protocol, print the flights, and what matters."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.protocol")
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--fit", nargs="*", default=[], metavar="NAME=V,V")
    parser.add_argument("--sensitivity", help="names of numbers, commas; or all")
    parser.add_argument("--only", default="", help="blocks whose name holds one of these words")
    parser.add_argument("--figures", type=Path, help="docs/guarantees.json, to hold the figures")
    options = parser.parse_args(arguments)
    words = options.only.split(",")
    judged = [o for o in flights_of(options.folder) if any(word in o.name for word in words)]
    fit = {}
    for text in options.fit:
        name, _, values = text.partition("=")
        fit[name] = [float(value) for value in values.split(",")]
    settings = variants(fit)
    if options.sensitivity:
        names = () if options.sensitivity == "all" else options.sensitivity.split(",")
        settings |= halved_and_doubled(names)
    rows = run(judged, settings, options.output)
    names = {one.name for one in judged}
    rows = {name: row for name, row in rows.items() if name in names}
    flight = {one.name: one.flight for one in judged}
    fitted = {name: {v: row[v] for v in row if v in variants(fit)} for name, row in rows.items()}
    found = left_out(fitted, flight)
    pooled = [row for _, mine in found.values() for row in mine.values()]
    figures = {
        name: {"settings": best, **told(mine.values())} for name, (best, mine) in found.items()
    }
    figures["all flights"] = told(pooled)
    for name, values in figures.items():
        print(name, "; ".join(f"{key} {value}" for key, value in values.items()))
    matters = sensitivity(rows) if options.sensitivity else {}
    for name, one in matters.items():
        print(f"{name}: {one['changed']} of {one['blocks']} change, score {one['score']:+.2f}")
    if options.figures is not None:
        table.store(options.figures, "left_out", figures)
        if matters:
            table.store(options.figures, "sensitivity", matters)
        table.write(options.figures)


if __name__ == "__main__":
    main()
