"""Every summary statistic of a fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from corridor.diagnosis.signatures import Signatures
from corridor.diagnosis.statistics.antenna import gnss_forms
from corridor.diagnosis.statistics.ground import ground_forms
from corridor.diagnosis.statistics.residuals import Limits, Residuals
from corridor.diagnosis.statistics.statistic import Fit, Form, named
from corridor.diagnosis.statistics.ties import mark_forms, tie_forms


class SummaryStatistics:
    """Summary statistics of fits, in the same bins for a block and all its replicates.

    replicator: the model and its own fit. statistics: what they are. missing: what could not be
    formed, and the column to add; unseen: effects that leave no signature. Call it with `Fit`s:
    (fits, values) of all statistics end to end.
    """

    def __init__(self, replicator):
        self.missing: dict[str, str] = {}
        self.unseen: tuple[str, ...] = ()
        self._limits = Limits(replicator)
        self._forms = [form for form in self._made(replicator) if len(form.statistic)]
        self.statistics = [form.statistic for form in self._forms]

    def __call__(self, fits: Sequence[Fit]) -> np.ndarray:
        cut = [Residuals(fit, self._limits).pixels for fit in fits]
        scores = self._found.scores(
            [(pixels, fit.gnss, fit.control) for pixels, fit in zip(cut, fits, strict=True)]
        )
        return np.array([self._of(fit, score) for fit, score in zip(fits, scores, strict=True)])

    def _of(self, fit: Fit, score: np.ndarray) -> np.ndarray:
        residuals = Residuals(fit, self._limits, score)
        return np.concatenate([form.of(residuals) for form in self._forms])

    @property
    def lengths(self) -> list[int]:
        """Values of each statistic."""
        return [len(one) for one in self.statistics]

    def _made(self, replicator) -> Iterator[Form]:
        system, frame = replicator.system, self._limits.frame
        if frame is not None:
            yield from tie_forms(frame)
            self.missing |= frame.missing
        if len(self._limits.marks):
            yield from mark_forms(replicator, self._limits.marks)
        if len(system.gnss.names):
            yield from gnss_forms(replicator, self.missing)
        if len(system.control_rows):
            yield from ground_forms(system, "control", system.control_rows, lambda r: r.fit.control)
        if len(replicator.check_rows):
            yield from ground_forms(system, "check", replicator.check_rows, lambda r: r.fit.check)
        yield from self._signatures(replicator)

    def _signatures(self, replicator) -> Iterator[Form]:
        found, unit = Signatures(replicator), "stated deviations"
        self._found, self.unseen = found, found.absorbed
        for name, effects, of in (
            ("signatures of the physical effects", found.names, found.strengths),
            ("signatures in single images", found.single, found.in_single_images),
        ):
            yield Form(
                named(name, "signature", unit, "effect", effects), lambda r, of=of: of(r.score)
            )
