"""A dirty block and its double, diagnosed and held against what is in them: nothing with a name."""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterable, Mapping

import corridor
from benchmarks.diagnosis.rates import Rate
from benchmarks.ladder.blocks import double, made
from corridor import Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.output import plain
from corridor.diagnosis.settings import Settings

FIRM = ("named", "ambiguous")


def climb(images: int, seed: int, twice: bool = True, settings: Settings | None = None) -> dict:
    """What is said of one block of the ladder, and of its double where `twice`."""
    rung = made(images, seed)
    row = {"images": images, "seed": seed, "truth": rung.truth, "once": said(rung.block, settings)}
    if twice:
        row["double"] = said(double(rung.block), settings)
        row["agree"] = agree(row["once"], row["double"], bool(rung.truth["outside"]))
    return row


def said(block: Block, settings: Settings | None = None) -> dict:
    """The verdict of a diagnosis in short; `refused` or `crash` where there is none."""
    began = time.process_time()
    try:
        found = corridor.diagnose(block, settings=settings)
    except (InputError, AdjustmentFailed) as error:
        return {"refused": str(error), "seconds": time.process_time() - began}
    except Exception as error:  # noqa: BLE001, whatever it is, it is what is looked for
        where = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"
        return {"crash": told, "seconds": time.process_time() - began}
    told = plain(found.to_dict())
    return {
        "verdict": told["verdict"],
        "effects": [
            [one["slug"], one["class"], one.get("point"), one["cannot_be_told_apart_from"]]
            for one in told["effects"]
        ],
        "unknown": [[one["group"], one["class"], one["parts"]] for one in told["unknown"]],
        "p_nothing": told.get("p_nothing"),
        "halves": told.get("halves"),
        "sentence": told["sentence"],
        "seconds": time.process_time() - began,
    }


def false_names(one: Mapping) -> list[str]:
    """Slugs that are named, or one of a named set, where no effect of the catalogue is."""
    return [slug for slug, kind, *_ in one.get("effects", ()) if kind in FIRM]


def agree(once: Mapping, twice: Mapping, outside: bool) -> bool:
    """Whether neither of two verdicts says for certain what the other does not even suspect.

    outside: there is something outside the catalogue, which more data may show.
    """
    if "verdict" not in once or "verdict" not in twice:
        return ("verdict" in once) == ("verdict" in twice)
    return _covers(once, twice, outside) and _covers(twice, once, outside)


def _covers(one: Mapping, other: Mapping, outside: bool) -> bool:
    """Whether all that `one` states is at least suspected in `other`."""
    names = {slug for slug, _, _, alike in other["effects"] for slug in (slug, *alike)}
    names |= {slug for *_, parts in other["unknown"] for slug in parts}
    firm = [{slug, *alike} for slug, kind, _, alike in one["effects"] if kind in FIRM]
    unknown = any(kind == "unknown" for _, kind, _ in one["unknown"]) and not outside
    return all(some & names for some in firm) and (bool(other["unknown"]) or not unknown)


def rates(rows: Iterable[Mapping]) -> dict[str, dict[str, str]]:
    """Figures by size, as text."""
    rows = list(rows)
    out = {}
    for size in sorted({row["images"] for row in rows}):
        mine = [row for row in rows if row["images"] == size]
        each = [row[key] for row in mine for key in ("once", "double") if key in row]
        read, again = (
            [row[key] for row in mine if "verdict" in row.get(key, {})]
            for key in ("once", "double")
        )
        both = [row["agree"] for row in mine if "agree" in row]
        out[str(size)] = {
            "blocks": str(len(mine)),
            "crashes": str(Rate.of("crash" in one for one in each)),
            "refused": str(Rate.of("refused" in one for one in each)),
            "false names": str(Rate.of(bool(false_names(one)) for one in read)),
            # Copies err alike, and by more than so many sound observations do.
            "false names in doubles": str(Rate.of(bool(false_names(one)) for one in again)),
            "block and double agree": str(Rate.of(both)),
            "block and double have one verdict": str(Rate.of(_same(row) for row in mine)),
            "median processor seconds": f"{_median([one['seconds'] for one in each]):.1f}",
        }
    return out


def _same(row: Mapping) -> bool:
    """Whether the two verdicts are the same word."""
    return row["once"].get("verdict") == row.get("double", row["once"]).get("verdict")


def _median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2] if values else 0.0
