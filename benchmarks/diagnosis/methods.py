"""The diagnosis beside the baselines, at the same false-alarm rate.

The limit of each baseline is the one beyond which as many null blocks lie as the diagnosis has
accused. Of single effects then: detected, named rightly, named wrongly, cannot be told apart (the
diagnosis: a set that holds the truth; BIC: another effect within 6, "strong" by Kass and Raftery
1995; the others have no such word).
"""

from __future__ import annotations

from benchmarks.diagnosis.baselines import METHODS
from benchmarks.diagnosis.rates import Rate

OURS = "diagnosis"
EQUALLY_GOOD = 6.0
# Of all blocks; a wrong name costs as much as a right one brings.
WORTH = {"named": 1.0, "alike": 0.5, "wrong": -1.0}


def methods(rows: list[dict], nulls: list[dict]) -> dict[str, dict]:
    """Method -> rates detected, named, wrong, alike, and its score (mean worth of an answer).

    rows: blocks with one hidden effect. nulls: set the limits. Of blocks that have baselines.
    """
    rows = [row for row in rows if row.get("baselines")]
    nulls = [row for row in nulls if row.get("baselines")]
    out = {OURS: _rates([_ours(row) for row in rows], limit=None)}
    accused = sum(row["detected"] for row in nulls)
    out[OURS]["false_alarms"] = Rate(accused, len(nulls)).to_dict()
    for method in METHODS:
        largest = sorted(
            (max(row["baselines"][method].values(), default=0.0) for row in nulls), reverse=True
        )
        # Without null blocks there is no limit to be set, and nothing to be compared.
        if not largest:
            continue
        limit = largest[min(accused, len(largest) - 1)]
        found = [_theirs(row, method, limit) for row in rows]
        out[method] = _rates(found, limit)
        out[method]["false_alarms"] = Rate.of(value > limit for value in largest).to_dict()
    return out


def _rates(answers: list[str], limit: float | None) -> dict:
    return {
        "limit": limit,
        "detected": Rate.of(answer != "nothing" for answer in answers).to_dict(),
        **{kind: Rate.of(answer == kind for answer in answers).to_dict() for kind in WORTH},
        "score": sum(WORTH.get(answer, 0.0) for answer in answers) / len(answers)
        if answers else None,
    }  # fmt: skip


def _ours(row: dict) -> str:
    if row["wrong"]:
        return "wrong"
    if row["named"]:
        return "named"
    if row["inside"]:
        return "alike"
    return "detected" if row["detected"] else "nothing"


def _theirs(row: dict, method: str, limit: float) -> str:
    order = sorted(row["baselines"][method].items(), key=lambda one: -one[1])
    if not order or order[0][1] <= limit:
        return "nothing"
    hidden = next(iter(row.get("signals") or [row["hidden"]]))
    right = hidden in (order[0][0], order[0][0].partition(".")[0])
    if method == "bic" and len(order) > 1 and order[0][1] - order[1][1] < EQUALLY_GOOD:
        near = [key for key, value in order if order[0][1] - value < EQUALLY_GOOD]
        return "alike" if hidden in near else "detected"
    return "named" if right else "wrong"
