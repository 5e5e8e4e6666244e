"""How often the diagnosis is right on real noise: blocks of `real_noise`, diagnosed and counted.

    python -m benchmarks.diagnosis.real_rates FOLDER OUT.json [--only WORD,WORD] [--figures FILE]

OUT holds a row for each block, kept as soon as it is done, and the rates. Of the untouched twin the
first round alone is made, which tells how strongly the flight shows what is hidden, and from what
it can tell it (see `signal`). No other methods, as `python -m benchmarks.diagnosis --blocks FOLDER`
has them: a third of its time.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

import corridor
from benchmarks.diagnosis.assess import parameter_errors
from benchmarks.diagnosis.judge import judge
from benchmarks.diagnosis.rates import Rate
from benchmarks.diagnosis.signal import Signal, signals
from benchmarks.diagnosis.trials import of_folder
from benchmarks.diagnosis.truth import Truth
from benchmarks.guarantees import table
from corridor.core.adjustment import Model
from corridor.core.block import Block
from corridor.core.effects import every_effect
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import plain, whole_file, write_json
from corridor.core.preparation import prepare
from corridor.diagnosis.forward_selection import Question, Round, course_of
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import Settings, changed

# A value is right within so many of its stated sigmas.
RIGHT_SIGMAS = 3.0
# Check points are worse where their error grows by more than this share.
WORSE = 1.1
# Least signal-to-noise ratio at which an effect has to be named.
STRONG = 10.0
# Edges of the probabilities that are held against what came out.
EDGES = (0.0, 0.9, 0.98, 0.999, 1.0)


class Twins:
    """Untouched parts of which the first round has been made, each once."""

    def __init__(self) -> None:
        self._made: dict[tuple, tuple[Block, Round]] = {}

    def first(self, twin: Block) -> tuple[Block, Round]:
        """The twin as it is diagnosed, and its first round."""
        key = tuple(twin.images["image"]), tuple(twin.images)
        if key not in self._made:
            untouched, *_ = prepare(twin)
            with changed(most_refits=0):
                believed = ReferenceModel.of(untouched, Model())
                self._made[key] = untouched, course_of(believed, Question()).last
        return self._made[key]

    def signals(self, truth: Truth, block: Block, twin: Block) -> dict[str, Signal]:
        """How strongly what is hidden shows in a block, by its twin."""
        untouched, first = self.first(twin)
        return signals(truth, first.evidence, block, untouched, {}, first.noises)

    def value(self, twin: Block, slug: str, name: str) -> float:
        """What the twin itself says of a parameter, nothing else being missing; 0 if nothing.

        A real survey is known to be free of an effect no better than that.
        """
        _, first = self.first(twin)
        evidence = first.evidence
        n = evidence.number.get(slug)
        if n is None or evidence.groups[n].own is not None:
            return 0.0
        group = evidence.groups[n]
        theta, _ = evidence.solution({n: group.free})
        at = [k for k, (_, parameter, _) in enumerate(group.labels) if parameter == name]
        return float(theta[n][at[0]] * group.scale[at[0]]) if at else 0.0


def row_of(block: Block, truth: Truth, settings: Settings | None = None) -> dict:
    """What was said of a block, with settings or the usual ones, and whether it is right."""
    began = time.process_time()
    try:
        found = corridor.diagnose(block, settings=settings)
    except Exception as error:  # a crash is a row of its own, or the rates would not know of it
        told = isinstance(error, InputError | AdjustmentFailed)
        name = "" if told else f"{type(error).__name__}: "
        row = {"failed": f"{name}{error}", "crash": not told}
        return row | {"kind": truth.kind, "hidden": truth.label}
    said = plain(found.to_dict())
    judged = judge(said, truth, block)
    errors = parameter_errors(said, truth)
    check = said["gap"]["check_m"]
    wanted = {one.slug if one.point is None else f"{one.slug}.{one.point}" for one in truth.inside}
    stated = [one for one in said["effects"] if one["class"] in ("named", "ambiguous")]
    return {
        "failed": None,
        "kind": truth.kind,
        "hidden": truth.label,
        "verdict": said["verdict"],
        "effects": [(one["slug"], one["class"], one.get("point")) for one in said["effects"]],
        "unknown": [(one["group"], one["class"]) for one in said["unknown"]],
        "named": wanted <= set(judged.named),
        "inside": wanted <= set(judged.inside),
        "right_value": bool(errors) and all(abs(e["sigmas"]) < RIGHT_SIGMAS for e in errors),
        "errors": errors,
        "wrong": judged.wrong,
        "stated": bool(stated or judged.unknown),
        "absurd": [one["slug"] for one in stated if _absurd(one, block, errors)],
        "worse": bool(stated) and check is not None and check["after"] > WORSE * check["before"],
        "check": check,
        "lens": said["lens"],
        "p_nothing": said["p_nothing"],
        "p_halves": said["halves"]["p"],
        "sure": [
            (1.0 / (1.0 + float(np.exp(-one["log_evidence"]))), one["slug"] not in judged.wrong)
            for one in said["effects"]
        ],
        "sentence": said["sentence"],
        "seconds": time.process_time() - began,
    }


def _absurd(said: dict, block: Block, errors: list[dict]) -> bool:
    """Whether a stated value is one that does not happen, nor was put in."""
    effect = next(one for one in every_effect() if one.slug == said["slug"])
    most = {p.name: p.most for p in effect.parameters(block)}
    mine = [e for e in errors if e["slug"] == said["slug"]]
    put = {e["name"]: abs(e["true"]) + RIGHT_SIGMAS * e["sigma"] for e in mine}
    return any(
        abs(p["value"]) > max(most.get(p["name"], np.inf), put.get(p["name"], 0.0))
        for p in said["parameters"]
    )


def _untouched(name: str, rows: Mapping[str, dict]) -> dict | None:
    """What was said of the part into which the effects of a block were put, if it was asked."""
    ending = "_untouched"
    parts = [k for k in rows if k.endswith(ending) and name.startswith(k.removesuffix("untouched"))]
    part = rows[max(parts, key=len)] if parts else None
    return None if part is None or part["failed"] else part


def _wrong_beside_untouched(name: str, rows: Mapping[str, dict]) -> bool:
    """Whether a wrong effect is named that is not stated of the untouched part: a real flight is
    known to be free of effects no better than that."""
    part = _untouched(name, rows)
    stated = () if part is None else part["effects"]
    own = {slug for slug, kind, _ in stated if kind in ("named", "ambiguous")}
    return bool(set(rows[name]["wrong"]) - own)


def _worse_than_untouched(name: str, rows: Mapping[str, dict]) -> bool:
    """Whether check points are worse than before, and than those of the untouched part.

    What was put in may have made good by chance what the part is off by; to take it out again is
    no harm.
    """
    row, part = rows[name], _untouched(name, rows)
    if not row["worse"] or part is None:
        return row["worse"]
    return row["check"]["after"] > WORSE * part["check"]["before"]


def rates(every: Mapping[str, dict]) -> dict[str, str]:
    """The figures of rows by the name of their block, as text."""
    read = [row for row in every.values() if not row["failed"]]
    hidden = [row for row in read if row["kind"] != "null"]
    blunders = [row for row in hidden if set(row["hidden"].split("+")) == {"control_blunder"}]
    others = [row for row in hidden if row not in blunders]
    strong = [row for row in others if _least(row, "ratio") >= STRONG]
    apart = [row for row in strong if all(one["separable"] for one in row["signals"].values())]
    out = {
        "of 10 sigma, which the flight can tell from all others: named": Rate.of(
            row["named"] for row in apart
        ),
        "of these with the right value": Rate.of(
            row["named"] and row["right_value"] for row in apart
        ),
        "of these with what the untouched part has and what was put in": Rate.of(
            row["named"] and _right_beside_twin(row) for row in apart
        ),
        "of these in the set that is named": Rate.of(row["inside"] for row in apart),
        "of 10 sigma: in the set that is named": Rate.of(row["inside"] for row in strong),
        "named, effects": Rate.of(row["named"] for row in others),
        "named with the right value, effects": Rate.of(
            row["named"] and row["right_value"] for row in others
        ),
        "in the set that is named, effects": Rate.of(row["inside"] for row in others),
        "control blunders named": Rate.of(row["named"] for row in blunders),
        "control blunders in the set that is named": Rate.of(row["inside"] for row in blunders),
        "wrong names beside hidden effects": Rate.of(bool(row["wrong"]) for row in hidden),
        "wrong names beside hidden effects, that the untouched part has not": Rate.of(
            _wrong_beside_untouched(name, every)
            for name, row in every.items()
            if not row["failed"] and row["kind"] != "null"
        ),
        "untouched blocks of which something is said": Rate.of(
            row["stated"] for row in read if row["kind"] == "null"
        ),
        "absurd values": Rate.of(bool(row["absurd"]) for row in read),
        "crashes": Rate.of(row.get("crash", False) for row in every.values()),
        "refused in a sentence": Rate.of(
            bool(row["failed"]) and not row.get("crash", False) for row in every.values()
        ),
        "check points worse by a tenth": Rate.of(row["worse"] for row in read),
        "check points worse by a tenth, than in the untouched part too": Rate.of(
            _worse_than_untouched(name, every) for name, row in every.items() if not row["failed"]
        ),
    }
    sure = [pair for row in read for pair in row["sure"]]
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        some = [right for p, right in sure if low <= p < high or (high == 1.0 and p == 1.0)]
        out[f"right where called {100 * low:g} to {100 * high:g} % sure"] = Rate.of(some)
    return {name: str(rate) for name, rate in out.items()}


def _right_beside_twin(row: Mapping) -> bool:
    """Whether each value is the true one and what the untouched part has of it, as `value`."""
    return bool(row["errors"]) and all(
        abs(e["value"] - e["true"] - e["twin"]) < RIGHT_SIGMAS * e["sigma"] for e in row["errors"]
    )


def _least(row: Mapping, what: str) -> float:
    """The least of a number of the signals of a row."""
    return min((one[what] or 0.0 for one in row["signals"].values()), default=0.0)


def main(arguments: list[str] | None = None) -> None:
    """Diagnose the blocks of a folder and print the rates."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.real_rates")
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="", help="blocks whose name holds one of these words")
    parser.add_argument("--figures", type=Path, help="docs/guarantees.json, to hold the figures")
    options = parser.parse_args(arguments)
    rows = json.loads(options.out.read_text())["rows"] if options.out.is_file() else {}
    words, twins = options.only.split(","), Twins()
    for trial in of_folder(options.folder):
        if trial.name in rows or not any(word in trial.name for word in words):
            continue
        block, twin, truth = trial.load()
        rows[trial.name] = row = row_of(block, truth)
        found = {} if twin is None else twins.signals(truth, block, twin)
        row["signals"] = {
            key: asdict(one) | {"separable": one.separable} for key, one in found.items()
        }
        for error in row.get("errors", ()):
            error["twin"] = twins.value(twin, error["slug"], error["name"])
        told = [f"{slug} ({kind})" for slug, kind, _ in row.get("effects", ())]
        told += [f"{group} ({kind})" for group, kind in row.get("unknown", ())]
        print(f"{trial.name}: {row.get('verdict', row['failed'])}; {', '.join(told)}", flush=True)
        with whole_file(options.out) as part:
            write_json({"rates": rates(rows), "rows": rows}, part)
    for name, rate in rates(rows).items():
        print(f"{name}: {rate}")
    if options.figures is not None:
        table.store(options.figures, "flights", rates(rows))
        table.write(options.figures)


if __name__ == "__main__":
    main()
