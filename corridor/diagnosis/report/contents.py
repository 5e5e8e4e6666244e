"""What the page shows: sentences, tables of text, and what its pictures are drawn from.

Small enough to be handed to the notebook that makes the page; nothing is computed there.
"""

from __future__ import annotations

import platform
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

import pandas as pd

from corridor.diagnosis.comparison import Comparison
from corridor.diagnosis.report import tables

if TYPE_CHECKING:
    from corridor.diagnosis.diagnose import Diagnosis

_LIBRARIES = ("corridor", "numpy", "scipy", "numba", "pandas", "matplotlib")


@dataclass
class Contents:
    """Everything on the page.

    before, after: the block beside its counterparts, None where none could be simulated or
    nothing was added. evidence, threshold: see `corridor.figures.evidence_bars`. tables: by name;
    those with nothing to say are left out. notes: sentences on what did not go as usual.
    """

    name: str
    sentence: str
    verdict: str
    tables: dict[str, pd.DataFrame]
    evidence: pd.DataFrame
    threshold: dict[str, float]
    before: Comparison | None = None
    after: Comparison | None = None
    notes: list[str] = field(default_factory=list)
    command: str = ""

    @classmethod
    def of(
        cls,
        diagnosis: Diagnosis,
        before: Comparison | None,
        after: Comparison | None,
        written: list[str],
        notes: list[str],
        command: str = "",
    ) -> Contents:
        """The page of a diagnosis.

        written: slugs of the effects in block/ and corrected/. notes: beyond the diagnosis's own.
        """
        made = {
            "found": tables.found(diagnosis),
            "separating": tables.separating(diagnosis),
            "unknown": tables.unknown(diagnosis),
            "gap": tables.gap(diagnosis, before, after),
            "leaving": tables.leaving(before, after),
            "limits": tables.limits(diagnosis),
            "untestable": tables.untestable(diagnosis, before),
            "variance": tables.variance(diagnosis),
            "rounds": tables.rounds(diagnosis),
            "physics": tables.physics(diagnosis),
            "believed": tables.believed(diagnosis),
            "written": tables.written(diagnosis, written),
            "versions": _versions(diagnosis, before),
        }
        return cls(
            name=diagnosis.block.name,
            sentence=diagnosis.sentence,
            verdict=diagnosis.verdict,
            tables={name: table for name, table in made.items() if len(table)},
            evidence=tables.evidence(diagnosis),
            threshold=dict(diagnosis.course.last.threshold),
            before=before,
            after=after,
            notes=[*diagnosis.notes, *notes],
            command=command,
        )


def _versions(diagnosis: Diagnosis, before: Comparison | None) -> pd.DataFrame:
    rows = [
        ("level of a false name", f"{100 * diagnosis.level:g} %"),
        ("seed", f"{diagnosis.seed}"),
        ("counterparts", f"{before.count if before else 0}"),
        ("Python", platform.python_version()),
    ]
    for name in _LIBRARIES:
        try:
            rows.append((name, version(name)))
        except PackageNotFoundError:
            # Run from a checkout that nobody installed.
            from corridor import __version__

            rows.append((name, __version__))
    return pd.DataFrame(rows, columns=["what", "value"])
