"""The numbers of a diagnosis: what every report of it reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp

from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.diagnosis.findings.findings import Findings
from corridor.diagnosis.forward_selection import Course
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import Settings
from corridor.diagnosis.verification.halves import Halves


@dataclass(repr=False)
class Diagnosed:
    """What is missing, how sure that is, and what it does.

    before, after: adjustments of the believed model and of the model with what was found (the
    same where nothing was). course: all rounds of the search, with the reduced systems.
    gap, detection_limits, not_separated, untestable: as in diagnosis.json. alarms: variance tests.
    level, seed: as asked for. lens: what it has beside its polynomials, px, and what that does to
    the ground; None where nothing is seen of it, or the camera is held.
    used: what `after` has more than `before`, by slug (`slug.point` for a control point): of
    effects that cannot be told apart, one. rivals: error with each of the others, over that with
    the one that was found, of `check` points and of held-out `tie` points.
    doubts: what is probably a mistake in the block, seen at first sight; among the notes too.
    settings: the numbers by which it was decided. check_sigmas: by how many of their standard
    deviations check points are off in the end, RMS.
    halves: what two halves of the images, adjusted apart, say of each other.
    required: 3D RMS of the check points that is good enough, metres, for the report; may be set.
    """

    block: Block
    believed: ReferenceModel
    before: Adjustment
    after: Adjustment
    course: Course
    findings: Findings
    gap: dict
    detection_limits: dict
    untestable: list[dict]
    alarms: list[dict]
    lens: dict | None = None
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    seconds: float = 0.0
    used: list[str] = field(default_factory=list)
    rivals: dict[str, dict[str, float]] = field(default_factory=dict)
    level: float = 0.01
    seed: int = 0
    not_separated: list[dict] = field(default_factory=list)
    required: float | None = None
    settings: Settings = field(default_factory=Settings)
    check_sigmas: float | None = None
    halves: Halves = field(default_factory=Halves)

    @property
    def verdict(self) -> str:
        """named, ambiguous, unknown, suspected or nothing."""
        return self.findings.verdict

    @property
    def p_nothing(self) -> float:
        """Probability of evidence like this, of all tests together, were nothing missing.

        Of values for each image, and of what was held against other noise of the GNSS, it is the
        inverse of what was found, which is larger (Good 1950).
        """
        found = [one.log_evidence for one in (*self.findings.effects, *self.findings.unknown)]
        return min([self.course.p_nothing, *(exp(-max(one, 0.0)) for one in found)])

    @property
    def effects(self) -> list[dict]:
        """Effects that were found, as in diagnosis.json."""
        return [one.to_dict(self.used, self.rivals) for one in self.findings.effects]

    @property
    def unknown(self) -> list[dict]:
        """What lies outside the catalogue, as in diagnosis.json."""
        return [one.to_dict() for one in self.findings.unknown]
