"""The residuals of one fit, cut and turned as the statistics need them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from corridor.diagnosis.statistics.statistic import Fit
from corridor.diagnosis.statistics.ties import TieFrame
from corridor.geometry import CLIPPED, robust_scale, robust_scale_of_lengths


class Limits:
    """Where residuals are cut, the same for a block and all its replicates.

    frame: of the tie points, None without any. marks: rows of marks; mark (m,) px, gnss (3,) m:
    their limits.
    """

    def __init__(self, replicator):
        b = replicator
        self.frame = TieFrame(b) if b.is_tie.any() else None
        self.marks = np.flatnonzero(~b.is_tie)
        self.mark = self.gnss = np.zeros(0)
        if len(self.marks):
            sigma = b.sigma[self.marks]
            length = np.hypot(*b.fit.pixels[self.marks].T) / sigma
            self.mark = CLIPPED * robust_scale_of_lengths(length, least=1e-9) * sigma
        if len(b.fit.gnss):
            self.gnss = CLIPPED * robust_scale(b.fit.gnss, axis=0, least=1e-9)
        self.antenna_rotation = b.system.images.rotation[b.system.gnss.image]


class Residuals:
    """Residuals of a fit, none beyond its limit.

    ties (u, 2), held (h, 2), marks (m, 2) px; gnss (k, 3) m. frame: see `TieFrame`. score: by the
    columns of the signatures, where these are asked for.
    """

    def __init__(self, fit: Fit, limits: Limits, score: np.ndarray | None = None):
        self.fit, self._limits, self.frame, self.score = fit, limits, limits.frame, score
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

    @cached_property
    def pixels(self) -> np.ndarray:
        """Of all image observations (n, 2), zero where held out."""
        out = np.zeros_like(self.fit.pixels)
        if self.frame is not None:
            out[self.frame.used] = self.ties
        out[self._limits.marks] = self.marks
        return out
