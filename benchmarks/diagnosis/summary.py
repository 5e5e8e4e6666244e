"""The figures of a benchmark: what was promised of the diagnosis, and whether it holds.

Detected: something was stated (named, cannot be told apart, unknown). Named: the hidden effect, by
its name alone. Inside: named, or in the set that is said not to be told apart. Blocks whose
diagnosis failed count as not detected.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmarks.diagnosis.methods import methods
from benchmarks.diagnosis.rates import Rate

# Edges of the signal-to-noise ratios for which rates are given apart.
EDGES = (0.0, 4.0, 6.0, 8.0, 12.0, 25.0, np.inf)
STRONG, FAIR = 8.0, 6.0
# Share of the ratio that is left beside a rival which does three quarters of the same.
CONFOUNDED = 0.5
CLOSED, NEAR_TWIN, EXCESS = 0.98, 1.25, 2.0


def summary(rows: list[dict]) -> dict:
    """What `benchmark.json` holds beside the rows (see `assess`), as JSON can hold it."""
    read = [row for row in rows if row["kind"] != "unread"]
    kinds = {
        kind: [row for row in read if row["kind"] == kind]
        for kind in ("null", "single", "together", "unknown")
    }
    single = kinds["single"]
    clear = [row for row in single if separable(row)]
    shown = [row for row in single if (ratio(row) or 0.0) >= STRONG]
    alike = [row for row in shown if _alike(row)]
    between = [row for row in shown if separable(row) is False and not _alike(row)]
    return {
        "blocks": {kind: len(some) for kind, some in kinds.items()},
        "failed": {row["name"]: row["failed"] for row in rows if row.get("failed")},
        "null": _null(kinds["null"], read),
        "single_8": _single([row for row in clear if ratio(row) >= STRONG]),
        "single_6": _single([row for row in clear if FAIR <= ratio(row) < STRONG]),
        "by_ratio": [
            {"from": low, "to": None if np.isinf(high) else high}
            | _single([row for row in clear if low <= ratio(row) < high])
            for low, high in zip(EDGES[:-1], EDGES[1:], strict=True)
        ],
        "by_slug": _by_slug(clear),
        "lookalike": {
            "inside": _rate(map(_inside, alike)),
            "one_name": _rate(_confident(row) for row in alike),
            "wrong": _rate(bool(row.get("wrong")) for row in alike),
        },
        "hardly_separable": _single(between),
        "together": _together(kinds["together"]),
        "parameters": _parameters(read),
        "gap": _gap(read),
        "unknown": _unknown(kinds["unknown"]),
        "confusion": confusion(read),
        "methods": methods(single, kinds["null"]),
        "methods_confounders": methods(
            [row for row in single if _confounded(row)], kinds["null"]
        ),
        "seconds": _seconds(read),
    }  # fmt: skip


# --- one block --------------------------------------------------------------------------------


def ratio(row: dict) -> float | None:
    """Signal-to-noise ratio of the block's hidden effect, the weakest of several."""
    found = [one["ratio"] for one in row.get("signals", {}).values()]
    return None if not found or None in found else min(found)


def separable(row: dict) -> bool | None:
    """Whether nothing else, GNSS noise included, comes within five sigmas of a hidden effect."""
    found = [one["separable"] for one in row.get("signals", {}).values()]
    return None if not found or None in found else all(found)


def _alike(row: dict) -> bool:
    return any(one["alike"] for one in row.get("signals", {}).values())


def _confounded(row: dict) -> bool:
    """Whether another candidate does three quarters of what a hidden effect does, or more."""
    return any(
        one["apart"] is not None and one["apart"] < CONFOUNDED * (one["ratio"] or 0.0)
        for one in row.get("signals", {}).values()
    )


def _keys(row: dict) -> list[str]:
    return list(row.get("signals") or row["hidden"].split("+"))


def _named(row: dict) -> bool:
    return set(_keys(row)) <= set(row.get("named", ()))


def _inside(row: dict) -> bool:
    return set(_keys(row)) <= set(row.get("inside", ()))


def _confident(row: dict) -> bool:
    return bool(row.get("named") or row.get("wrong"))


def _rate(answers: Iterable[bool]) -> dict:
    return Rate.of(answers).to_dict()


# --- many -------------------------------------------------------------------------------------


def _null(nulls: list[dict], rows: list[dict]) -> dict:
    """False names and false statements, in null blocks and in the twins of the others."""
    twins = [row["twin"] for row in rows if row.get("twin")]
    out = {}
    for name, some in (("blocks", nulls), ("twins", twins), ("all", [*nulls, *twins])):
        out[name] = {
            "false_name": _rate(bool(row.get("wrong")) for row in some),
            "false_statement": _rate(row.get("detected", False) for row in some),
            "suspected": _rate(row.get("suspected", False) for row in some),
        }
    return out


def _single(rows: list[dict]) -> dict:
    return {
        "detected": _rate(row.get("detected", False) for row in rows),
        "named": _rate(map(_named, rows)),
        "inside": _rate(map(_inside, rows)),
        "wrong": _rate(bool(row.get("wrong")) for row in rows),
    }


def _by_slug(rows: list[dict]) -> dict:
    out = {}
    for slug in sorted({row["hidden"] for row in rows}):
        some = [row for row in rows if row["hidden"] == slug and ratio(row) >= STRONG]
        if some:
            out[slug] = _single(some)
    return out


def _together(rows: list[dict]) -> dict:
    strong = [row for row in rows if (ratio(row) or 0.0) >= STRONG and separable(row)]
    extras = [row.get("extras", 0) for row in strong]
    return {
        "both": _rate(map(_inside, strong)),
        "both_named": _rate(map(_named, strong)),
        "extras_a_block": float(np.mean(extras)) if extras else None,
    }


def _parameters(rows: list[dict]) -> dict:
    """Errors in sigmas, of effects that were named or in a set; the readout's in seconds."""
    found = [p for row in rows for p in row.get("parameters", ()) if p["class"] != "suspected"]
    off = np.array([p["sigmas"] for p in found], dtype=float)
    readout = [
        abs(p["value"] - p["true"]) <= max(0.03 * abs(p["true"]), 0.001)
        for p in found
        if p["name"] == "readout"
    ]
    each = {}
    for slug in sorted({p["slug"] for p in found}):
        mine = np.array([p["sigmas"] for p in found if p["slug"] == slug])
        each[slug] = {"count": len(mine), "rms": float(np.sqrt(np.mean(mine**2)))}
    return {
        "count": len(off),
        "std": float(off.std(ddof=1)) if len(off) > 1 else None,
        "mean": float(off.mean()) if len(off) else None,
        # Of the middle two thirds: what a few wild ones do not change.
        "central_std": float(np.diff(np.quantile(off, [0.1587, 0.8413]))[0] / 2)
        if len(off) else None,
        "within_1": _rate(np.abs(off) <= 1.0), "within_2": _rate(np.abs(off) <= 1.96),
        "within_3": _rate(np.abs(off) <= 3.0),
        "readout": _rate(readout), "by_slug": each,
    }  # fmt: skip


def _gap(rows: list[dict]) -> dict:
    """Check points, where before is more than twice the twin's.

    Of effects of the catalogue that the block shows (ratio 8 and more): what a flight cannot see,
    nobody can close. `known`: by the believed model with what is really missing from it, whatever
    was found; `of_known`: by the diagnosis where that one closes it.
    """
    some = [row for row in rows if (row.get("excess") or 0.0) > EXCESS]
    known = [row for row in some if row["kind"] != "unknown" and (ratio(row) or 0.0) >= STRONG]
    found = [row for row in known if _inside(row)]
    told = [row for row in known if row.get("check_known") is not None]
    return {
        "blocks": len(known),
        "closed": _rate(row["closure"] >= CLOSED for row in known),
        "near_twin": _rate(row["after_over_twin"] <= NEAR_TWIN for row in known),
        "closed_where_found": _rate(row["closure"] >= CLOSED for row in found),
        "near_twin_where_found": _rate(row["after_over_twin"] <= NEAR_TWIN for row in found),
        "closed_known": _rate(row["closure_known"] >= CLOSED for row in told),
        "near_twin_known": _rate(row["known_over_twin"] <= NEAR_TWIN for row in told),
        "closed_of_known": _rate(
            row["closure"] >= CLOSED for row in told if row["closure_known"] >= CLOSED
        ),
        "near_twin_of_known": _rate(
            row["after_over_twin"] <= NEAR_TWIN
            for row in told if row["known_over_twin"] <= NEAR_TWIN
        ),
        "median_closure": float(np.median([row["closure"] for row in known])) if known else None,
    }  # fmt: skip


def _unknown(rows: list[dict]) -> dict:
    strong = [row for row in rows if (ratio(row) or 0.0) >= STRONG]
    placed = [row for row in strong if row.get("place") is not None]
    return {
        "stated": _rate(row.get("unknown", False) for row in strong),
        "place": _rate(row["place"] for row in placed),
        "stated_at_its_place": _rate(
            row.get("unknown", False) and row.get("place") is not False for row in strong
        ),
        "wrong": _rate(bool(row.get("wrong")) for row in strong),
    }


def _seconds(rows: list[dict]) -> dict:
    found = [row["seconds"] for row in rows if row.get("seconds")]
    if not found:
        return {"median": None, "largest": None}
    return {"median": float(np.median(found)), "largest": float(max(found))}


ANSWERS = ("its set", "another set", "unknown", "suspected", "nothing", "failed")


def confusion(rows: list[dict]) -> dict:
    """hidden (rows), answers (columns), counts: of blocks with one effect or none.

    The answer is the first name that is stated firmly, else one of `ANSWERS`.
    """
    some = [row for row in rows if "+" not in row["hidden"]]
    order = {"null": 0, "single": 1, "unknown": 2}
    hidden = sorted({(order[row["kind"]], row["hidden"]) for row in some})
    given = [answer(row) for row in some]
    names = [name for _, name in hidden]
    others = sorted(set(given) - set(names) - set(ANSWERS))
    firm = [name for kind, name in hidden if kind == 1]
    columns = [*firm, *others, *(a for a in ANSWERS if a in given)]
    counts = [
        [
            sum(
                row["hidden"] == name and one == column
                for row, one in zip(some, given, strict=True)
            )
            for column in columns
        ]
        for name in names
    ]
    return {"hidden": names, "answers": columns, "counts": counts}


def answer(row: dict) -> str:
    """What a block was first said to lack."""
    if row.get("failed"):
        return "failed"
    names = [one["slug"] for one in row["said"]["effects"] if one["class"] == "named"]
    if row["verdict"] == "named" and names:
        return names[0]
    if row["verdict"] == "ambiguous":
        return "its set" if row["inside"] else "another set"
    if row["verdict"] != "unknown" and row["unknown"]:
        return "unknown"  # a variance alarm
    return row["verdict"]
