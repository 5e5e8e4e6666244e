"""A diagnosis saved into a folder, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from corridor.core.effects import Values
from corridor.core.output import (
    Progress,
    check_folder,
    files_in,
    telling,
    whole_folder,
    write_csv,
    write_json,
)
from corridor.diagnosis.bootstrap.comparison import Comparison
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.report.beside import COUNT, beside
from corridor.diagnosis.report.corrected import corrected
from corridor.diagnosis.report.page import make_page

RESULT = "diagnosis.json"


def check_output(folder: str | os.PathLike) -> None:
    """Raises InputError where `save` would refuse `folder`: a file, or no earlier diagnosis."""
    check_folder(folder, RESULT)


def save(
    diagnosis: Diagnosed,
    folder: str | os.PathLike,
    counterparts: int = COUNT,
    threads: int = 1,
    command: str = "",
    progress: Callable[[Progress], None] | None = None,
    gis: bool = False,
) -> list[Path]:
    """Writes a diagnosis into `folder`, whole or not at all; returns the paths, sorted.

    report.html (one page, no links), diagnosis.json, block/ (adjusted with the effects found),
    corrected/ (as measured, those effects taken out) and the pictures of the page.
    counterparts: how many simulated ones stand beside the measured block, 19 or more. threads: 1
    or 2. command: what was typed, for the page. progress: called with a `Progress`.
    gis: also diagnosis.gpkg and diagnosis.las of what is in block/, as an adjustment has
    them.
    Suspected effects, and shapes that do not help held-out data, are in neither block.
    An earlier result in `folder` is replaced; what else lies there stays. Raises InputError where
    `folder` is a file, or holds something but no earlier diagnosis.
    """
    folder = Path(folder)
    say = telling(progress)
    check_output(folder)
    # Simulated counterparts need the room.
    diagnosis.course.last.make_room()
    compared = beside(diagnosis, counterparts, threads, progress)
    notes = [*diagnosis.notes, *compared.notes]
    slugs = list(dict.fromkeys(key.partition(".")[0] for key in diagnosis.used))
    with whole_folder(folder, RESULT) as part:
        say("writing the blocks")
        diagnosis.after.block.write(part / "block")
        corrected(diagnosis.block, diagnosis.after, slugs).write(part / "corrected")
        say("making the page")
        page = make_page(diagnosis, compared, notes, command, part)
        (part / "report.html").write_text(page, encoding="utf-8")
        found = Values(one.values for one in diagnosis.findings.effects if one.values)
        for name, table in found.tables().items():
            write_csv(table, part / name)
        if gis:
            diagnosis.after.write_gis(part / "diagnosis")
        content = diagnosis.to_dict() | {
            "notes": notes,
            "written": slugs,
            "counterparts": {"before": _told(compared.before), "after": _told(compared.after)},
        }
        content["files"] = sorted([RESULT, *files_in(part)])
        write_json(content, part / RESULT)
        written = files_in(part)
    return [folder / name for name in written]


def _told(case: Comparison | None) -> dict | None:
    """What a comparison says, for diagnosis.json."""
    if case is None:
        return None
    return {
        "count": case.count,
        "statistics": len(case.statistics),
        "leaving": [one.statistic.name for one in case.leaving],
        "gap": case.gap,
    }
