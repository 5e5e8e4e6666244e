"""Every summary statistic of a fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np

from corridor.core.geometry import CLIPPED, robust_scale, robust_scale_of_lengths
from corridor.diagnosis.bootstrap.signatures import Signatures
from corridor.diagnosis.bootstrap.statistics.antenna import gnss_forms
from corridor.diagnosis.bootstrap.statistics.statistic import (
    Curve,
    Fit,
    Form,
    corridor_frame,
    named,
)
from corridor.diagnosis.bootstrap.statistics.ties import (
    MANY_POINTS,
    PLACES,
    TieFrame,
    mark_forms,
    tie_forms,
)


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
        found = self._signatures.strengths(fits)
        each = (Residuals(fit, self._limits, one) for fit, one in zip(fits, found, strict=True))
        return np.array([np.concatenate([form.of(r) for form in self._forms]) for r in each])

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
            rows = system.control_rows
            yield from ground_forms(system, "control", rows, lambda r: r.fit.control[: len(rows)])
        if len(replicator.check_rows):
            yield from ground_forms(system, "check", replicator.check_rows, lambda r: r.fit.check)
        self._signatures = found = Signatures(replicator, self._limits.image)
        self.unseen, name = found.absorbed, "signatures of the physical effects"
        statistic = named(name, "signature", "stated deviations", "effect", found.names)
        yield Form(statistic, lambda r: r.strengths)


class Limits:
    """Where residuals are cut, the same for a block and all its replicates.

    frame: of the tie points, None without any. marks: rows of marks; mark (m,) px, gnss (3,) m:
    their limits. image (n,): px, of all image observations, 0 where held out.
    """

    def __init__(self, replicator):
        b = replicator
        self.frame = TieFrame(b) if b.is_tie.any() else None
        self.marks = np.flatnonzero(~b.is_tie)
        self.mark = self.gnss = np.zeros(0)
        self.image = np.zeros(len(b.sigma))
        if self.frame is not None:
            self.image[self.frame.used] = self.frame.limit[self.frame.used]
        if len(self.marks):
            sigma = b.sigma[self.marks]
            length = np.hypot(*b.fit.pixels[self.marks].T) / sigma
            self.mark = CLIPPED * robust_scale_of_lengths(length, least=1e-9) * sigma
            self.image[self.marks] = self.mark
        if len(b.fit.gnss):
            self.gnss = CLIPPED * robust_scale(b.fit.gnss, axis=0, least=1e-9)
        self.antenna_rotation = b.system.images.rotation[b.system.gnss.image]


class Residuals:
    """Residuals of a fit, none beyond its limit.

    ties (u, 2), held (h, 2), marks (m, 2) px; gnss (k, 3) m. frame: see `TieFrame`.
    strengths: of the signatures.
    """

    def __init__(self, fit: Fit, limits: Limits, strengths: np.ndarray):
        self.fit, self._limits, self.frame, self.strengths = fit, limits, limits.frame, strengths
        if self.frame is not None:
            self.ties = self._cut(fit.pixels, self.frame.used)
            self.held = self._cut(fit.pixels, self.frame.held)
        mark = limits.mark[:, None]
        self.marks = np.clip(fit.pixels[limits.marks], -mark, mark)
        self.gnss = np.clip(fit.gnss, -limits.gnss, limits.gnss) if len(fit.gnss) else fit.gnss

    def _cut(self, pixels: np.ndarray, rows: np.ndarray) -> np.ndarray:
        limit = self.frame.limit[rows, None]
        return np.clip(pixels[rows], -limit, limit)

    @cached_property
    def tie_square(self) -> np.ndarray:
        """Mean square of both coordinates (u,), px^2."""
        return (self.ties**2).sum(axis=1) / 2

    @cached_property
    def outward(self) -> np.ndarray:
        """Weighted part (u,) away from the picture's middle."""
        return self.frame.weight * np.einsum("ni,ni->n", self.ties, self.frame.across)

    @cached_property
    def along(self) -> np.ndarray:
        """Part (u,) along the velocity in the picture."""
        return np.einsum("ni,ni->n", self.ties, self.frame.flow)

    @cached_property
    def across(self) -> np.ndarray:
        """Part (u,) across it."""
        x, y = self.frame.flow.T
        return self.ties[:, 1] * x - self.ties[:, 0] * y

    @cached_property
    def gnss_in_camera(self) -> np.ndarray:
        """Of the antenna (k, 3), in the camera frame, m."""
        return np.einsum("nij,nj->ni", self._limits.antenna_rotation, self.gnss)


def ground_forms(system, kind: str, rows: np.ndarray, of: Callable) -> Iterator[Form]:
    """Residuals `of` a fit at ground points (rows of ground.csv); kind: `control` or `check`."""
    ground = system.block.ground
    names = tuple(map(str, ground["point"].iloc[rows]))
    if len(rows) <= MANY_POINTS:
        for k, axis in enumerate("xyz"):
            statistic = named(f"{kind} {axis} by point", kind, "m", f"{kind} point", names)
            yield Form(statistic, lambda r, k=k: of(r)[:, k])
    else:
        origin, axes = corridor_frame(system.images.centre)
        at = (ground[["x", "y"]].to_numpy(float)[rows] - origin) @ axes[0]
        curve = Curve.even(at, PLACES, np.ones(len(rows)), 3)
        what = "along the corridor (m)"
        for k, axis in enumerate("xyz"):
            statistic = curve.statistic(f"{kind} {axis} along the corridor", kind, "m", what)
            yield Form(statistic, lambda r, k=k: curve.mean(of(r)[:, k]))
    if kind == "check":
        yield Form(
            named("check-point error, RMS", kind, "m", "axis", tuple("xyz")),
            lambda r: np.sqrt(np.mean(of(r) ** 2, axis=0)),
        )
