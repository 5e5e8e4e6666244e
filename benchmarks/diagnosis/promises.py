"""The figures beside what was promised: wanted, found, held or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Promise:
    """found: of the benchmark, None where no block says anything. count: of blocks behind it."""

    name: str
    wanted: str
    found: float | None
    holds: bool | None
    count: int
    low: float | None = None
    high: float | None = None


def promises(summary: Mapping) -> list[Promise]:
    """Each promise, in the order of the table."""
    null, eight, six = summary["null"]["all"], summary["single_8"], summary["single_6"]
    alike, both, gap = summary["lookalike"], summary["together"], summary["gap"]
    outside, errors = summary["unknown"], summary["parameters"]
    return [
        _most("null blocks: a false name", null["false_name"], 0.03),
        _most("null blocks: anything stated", null["false_statement"], 0.03),
        _least("ratio 8 and more: detected", eight["detected"], 0.95),
        _least("ratio 8 and more: named", eight["named"], 0.95),
        _least("ratio 8 and more: inside the set", eight["inside"], 0.98),
        _least("ratio 6 to 8: detected", six["detected"], 0.90),
        _least("ratio 6 to 8: named", six["named"], 0.88),
        _least("ratio 6 to 8: inside the set", six["inside"], 0.95),
        _least("look-alikes: inside the set", alike["inside"], 0.98),
        _most("look-alikes: one confident name", alike["one_name"], 0.0),
        _most("look-alikes: a wrong name", alike["wrong"], 0.0),
        _least("two at once: both found", both["both"], 0.90),
        _number("two at once: extras a block", both["extras_a_block"], 0.0, 0.1, both["both"]),
        _number(
            "parameter errors: std in sigmas", errors["std"], 0.8, 1.3,
            {"count": errors["count"]},
        ),
        _least("readout within 3 % or 1 ms", errors["readout"], 0.95),
        _least("check points: 98 % of the excess closed", gap["closed"], 0.95),
        _limit("  by whoever is told what is hidden", gap["closed_known"]),
        _least("  where that closes it", gap["closed_of_known"], 0.95),
        _least("check points: within 1.25 of the twin's", gap["near_twin"], 0.95),
        _limit("  by whoever is told what is hidden", gap["near_twin_known"]),
        _least("  where that comes as near", gap["near_twin_of_known"], 0.95),
        _least("outside the catalogue: stated", outside["stated"], 0.90),
        _least("outside the catalogue: right place or time", outside["place"], 0.90),
    ]  # fmt: skip


def _least(name: str, rate: Mapping, wanted: float) -> Promise:
    share = rate["share"]
    holds = None if share is None else share >= wanted
    return Promise(
        name, f"at least {100 * wanted:g} %", share, holds, rate["count"], rate["low"], rate["high"]
    )


def _most(name: str, rate: Mapping, wanted: float) -> Promise:
    share = rate["share"]
    holds = None if share is None else share <= wanted
    return Promise(
        name, f"at most {100 * wanted:g} %", share, holds, rate["count"], rate["low"], rate["high"]
    )


def _limit(name: str, rate: Mapping) -> Promise:
    """What could be had at most: no promise of ours."""
    return Promise(name, "the limit", rate["share"], None, rate["count"], rate["low"], rate["high"])


def _number(name: str, value: float | None, low: float, high: float, of: Mapping) -> Promise:
    holds = None if value is None else low <= value <= high
    wanted = f"{low:g} to {high:g}" if low else f"below {high:g}"
    return Promise(name, wanted, value, holds, of["count"])
