"""What a report reads of a diagnosis."""

from __future__ import annotations

from typing import Any, Protocol

from corridor.adjustment import Adjustment
from corridor.block import Block
from corridor.diagnosis.findings.findings import Findings
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.rounds import Course


class Diagnosed(Protocol):
    """See `corridor.diagnosis.Diagnosis`."""

    block: Block
    believed: ReferenceModel
    before: Adjustment
    after: Adjustment
    course: Course
    findings: Findings
    gap: dict[str, Any]
    detection_limits: dict[str, dict[str, float | None]]
    untestable: list[dict]
    alarms: list[dict]
    lens: dict | None
    notes: list[str]
    doubts: list[str]
    used: list[str]
    rivals: dict[str, dict[str, float]]
    level: float
    seed: int
    required: float | None
    verdict: str
    sentence: str
    actions: list[str]
