"""The figures of a benchmark in a folder: benchmark.json, benchmark.csv, report.txt, pictures."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from benchmarks.diagnosis.pictures import confusion_matrix, naming_rates
from benchmarks.diagnosis.summary import answer
from benchmarks.diagnosis.table import as_text
from corridor.core.output import whole_files, write_json, write_picture

_COLUMNS = (
    "name", "kind", "hidden", "images", "observations", "seconds", "verdict", "detected",
    "suspected", "extras", "unknown", "place", "score", "check_before", "check_after",
    "check_twin", "check_known", "excess", "closure", "closure_known", "after_over_twin",
    "known_over_twin", "failed",
)  # fmt: skip


def save(rows: list[dict], summary: Mapping, folder: str | os.PathLike, settings: Mapping) -> list:
    """Writes all files beside the kept rows, whole or not at all; returns their paths."""
    folder = Path(folder)
    # The diagnosis word for word is in the kept rows.
    short = [{k: v for k, v in row.items() if k != "said"} for row in rows]
    content = {"settings": dict(settings), "summary": summary, "rows": short}
    names = ("benchmark.json", "benchmark.csv", "report.txt", "confusion.png", "rates.png")
    files = [folder / name for name in names]
    with whole_files(*files) as (result, table, text, confusion, rates):
        write_json(content, result)
        as_table(rows).to_csv(table, index=False, float_format="%.6g", lineterminator="\n")
        text.write_text(as_text(summary) + "\n", encoding="utf-8")
        write_picture(confusion_matrix(**summary["confusion"]), confusion)
        write_picture(naming_rates(summary["by_ratio"]), rates)
    return files


def as_table(rows: list[dict]) -> pd.DataFrame:
    """One row a block: what is hidden, what was said, how strong and how alike it is."""
    out = []
    for row in rows:
        one = {key: row.get(key) for key in _COLUMNS}
        found = row.get("signals") or {}
        weakest = min(found.values(), key=lambda s: s["ratio"] or 0.0, default={})
        one |= {
            "answer": answer(row), "named": " ".join(row.get("named", ())),
            "inside": " ".join(row.get("inside", ())), "wrong": " ".join(row.get("wrong", ())),
            "ratio": weakest.get("ratio"), "apart": weakest.get("apart"),
            "rival": weakest.get("rival"), "from_noise": weakest.get("from_noise"),
            "twin_verdict": (row.get("twin") or {}).get("verdict"),
        }  # fmt: skip
        out.append(one)
    return pd.DataFrame(out)
