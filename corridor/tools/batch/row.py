"""What a batch says of one block, and how urgent that is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from corridor.core import registry

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment
    from corridor.diagnosis import Diagnosis

FAILED, NOT_RUN, MISSED = "failed", "not run", "not good enough"
IN_DOUBT, NOT_TESTED = "in doubt", "not tested"
# What somebody has to look at first; the verdicts of a diagnosis among them.
URGENCY = (
    FAILED,
    MISSED,
    "named",
    "ambiguous",
    "unknown",
    IN_DOUBT,
    "suspected",
    NOT_TESTED,
    "nothing",
    "fits",
    "good enough",
    NOT_RUN,
)


@dataclass(frozen=True)
class Row:
    """One block of a batch.

    block: its name in the batch. folder: where it lies. verdict: one of `URGENCY`; of a
    diagnosis, missed says whether it is not accurate enough. found: effects that a diagnosis found.
    sigma0 and RMS of check points (m, in plan, in height, in space) are NaN where there are none;
    of a diagnosis, those of the block with what was found. attention: the first thing to do, or
    why it failed; empty where there is nothing. fault: where a fault of the program was raised.
    """

    block: str
    folder: str
    verdict: str
    found: str = ""
    missed: bool = False
    images: int = 0
    sigma0: float = math.nan
    check_points: int = 0
    check_rms_xy_m: float = math.nan
    check_rms_z_m: float = math.nan
    check_rms_3d_m: float = math.nan
    attention: str = ""
    seconds: float = math.nan
    fault: str = ""

    @classmethod
    def of_adjustment(cls, block: str, folder: str, adjustment: Adjustment) -> Row:
        """The row of an adjustment that converged."""
        known, tested = _measured(adjustment, adjustment.required), len(adjustment.check_points) > 0
        report = registry.room("report")
        if known["missed"]:
            verdict = MISSED
        elif adjustment.required is not None and tested:
            verdict = "good enough"
        elif report.doubted(adjustment):
            verdict = IN_DOUBT
        else:
            verdict = "fits" if tested else NOT_TESTED
        good = verdict in ("fits", "good enough") and not report.doubted(adjustment)
        todo = "" if good else next(iter(report.steps(adjustment)), "")
        return cls(
            block, folder, verdict, attention=todo, seconds=adjustment.seconds, **known
        )  # fmt: skip

    @classmethod
    def of_diagnosis(cls, block: str, folder: str, diagnosis: Diagnosis) -> Row:
        """The row of a diagnosis: its verdict, and the block with what was found."""
        known, verdict = _measured(diagnosis.after, diagnosis.required), diagnosis.verdict
        slugs = [one.slug for one in diagnosis.findings.effects]
        slugs += [one.group for one in diagnosis.findings.unknown]
        needed = known["missed"] or verdict != "nothing"
        todo = next(iter(diagnosis.actions), "") if needed else ""
        found = ", ".join(dict.fromkeys(slugs))
        return cls(
            block, folder, verdict, found, attention=todo, seconds=diagnosis.seconds, **known
        )  # fmt: skip

    @classmethod
    def of_json(cls, content: dict[str, Any]) -> Row:
        """A row as JSON has it. Raises TypeError where keys are not those of a row."""
        return cls(**{key: math.nan if value is None else value for key, value in content.items()})

    @property
    def failed(self) -> bool:
        """Whether there is no result."""
        return self.verdict == FAILED

    @property
    def order(self) -> tuple:
        """What sorts the most urgent first: by verdict, then by the error of the check points."""
        rank = URGENCY.index(MISSED if self.missed else self.verdict)
        return rank, -_known(self.check_rms_3d_m), -_known(self.sigma0), self.block


def _measured(adjustment: Adjustment, required: float | None) -> dict[str, Any]:
    """What a row has of an adjustment; missed: check points are further off than required, m."""
    rms, checked = adjustment.check_rms, len(adjustment.check_points)
    return {
        "missed": bool(checked and required is not None and rms.d3 > required),
        "images": len(adjustment.block.images),
        "sigma0": float(adjustment.sigma0),
        "check_points": checked,
        "check_rms_xy_m": float(rms.xy),
        "check_rms_z_m": float(rms.z),
        "check_rms_3d_m": float(rms.d3),
    }


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0
