"""Every summary statistic of a fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from corridor.diagnosis.signatures import of_single_images, signatures
from corridor.diagnosis.statistics.antenna import gnss_forms
from corridor.diagnosis.statistics.ground import ground_forms
from corridor.diagnosis.statistics.residuals import Limits, Residuals
from corridor.diagnosis.statistics.statistic import Fit, Form, named
from corridor.diagnosis.statistics.ties import mark_forms, tie_forms


class SummaryStatistics:
    """Summary statistics of fits, in the same bins for a block and all its replicates.

    replicator: the model and its own fit. statistics: what they are. missing: what could not be
    formed, and the column to add; unseen: effects that leave no signature. Call it with a `Fit`:
    (values,) of all statistics end to end.
    """

    def __init__(self, replicator):
        self.missing: dict[str, str] = {}
        self.unseen: tuple[str, ...] = ()
        self._limits = Limits(replicator)
        self._forms = [form for form in self._made(replicator) if len(form.statistic)]
        self.statistics = [form.statistic for form in self._forms]

    def __call__(self, fit: Fit) -> np.ndarray:
        residuals = Residuals(fit, self._limits)
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
        found, unit = signatures(replicator), "stated deviations"
        if found is not None:
            self.unseen = found.absorbed
            name = "signatures of the physical effects"
            yield Form(
                named(name, "signature", unit, "effect", found.names),
                lambda r: found.strengths(r.pixels, r.fit.gnss, r.fit.control),
            )
        single = of_single_images(replicator)
        if single:
            names = [name for name, *_ in single]
            shares = [_share(replicator.system, pixels, gnss) for _, pixels, gnss in single]
            yield Form(
                named("signatures in single images", "signature", unit, "effect", names),
                lambda r: np.array([share(r) for share in shares]),
            )


def _share(system, pixels: np.ndarray, gnss: np.ndarray):
    """RMS over the images of what residuals share with a signature, in stated deviations."""
    rows, image = system.image_rows, system.gnss.image
    count = len(system.columns.images)
    heavy = pixels / rows.sigma[:, None] ** 2
    antenna = gnss / system.gnss.sigma**2
    square = np.bincount(rows.image, (heavy * pixels).sum(axis=1), count)
    square += np.bincount(image, (antenna * gnss).sum(axis=1), count)
    touched = square > 1e-6 * square.max()
    in_pixels, in_antenna = bool(np.any(pixels)), bool(np.any(gnss))

    def share(r: Residuals) -> float:
        total = np.zeros(count)
        if in_pixels:
            total += np.bincount(rows.image, (heavy * r.pixels).sum(axis=1), count)
        if in_antenna:
            total += np.bincount(image, (antenna * r.gnss).sum(axis=1), count)
        return float(np.sqrt(np.mean(total[touched] ** 2 / square[touched])))

    return share
