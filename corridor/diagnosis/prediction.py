"""Whether data that no fit has used are predicted better, by more than chance.

Each observation held out has a density, Student's t about what a fit predicts; d is what its
logarithm gains between two fits. What is left in one strip hangs together: its light, its
vegetation, its matches. So the sums d_c of strips are what counts, and where nothing is gained

    mean(d_c) / (sd(d_c) / sqrt(q))  is at most Student's t with q - 1 degrees of freedom,

whatever their variances, at any level below 8 %.
Source: Diebold and Mariano 1995 (loss of two predictions); Ibragimov and Müller 2010 (few groups).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from corridor.adjustment import Adjustment
from corridor.diagnosis.robust import scale_of
from corridor.diagnosis.settings import SETTINGS
from corridor.preparation import strips_of


@dataclass(frozen=True)
class Prediction:
    """What a correction gains in strips: log density (strips,) of what no fit has used there."""

    gain: np.ndarray

    @classmethod
    def between(cls, without: Adjustment, with_it: Adjustment, rows: np.ndarray) -> Prediction:
        """Of tie observations, rows (k,) of tie_points, that neither adjustment has used."""
        if not len(rows):
            return cls(np.zeros(0))
        block = without.system.block
        strip = np.zeros(len(block.images), dtype=np.int64)
        for number, (_, images) in enumerate(strips_of(block)):
            strip[images] = number
        before, after = (_squares(one, rows) for one in (without, with_it))
        good = np.isfinite(before) & np.isfinite(after)
        scale = scale_of(before[good]) if good.any() else 1.0
        gained = _log_density(after[good] / scale**2) - _log_density(before[good] / scale**2)
        at = strip[block.image_rows("tie_points")[rows[good]]]
        seen = np.bincount(at) > 0
        return cls(np.bincount(at, gained)[seen])

    @property
    def proved(self) -> bool:
        """Whether the gain is larger than chance makes it, by what the strips say one by one."""
        count = len(self.gain)
        if count < 2:
            return False
        error = float(np.std(self.gain, ddof=1)) * np.sqrt(count)
        limit = stdtrit(count - 1, 1.0 - SETTINGS.prediction_level)
        return bool(self.gain.sum() > limit * error)


def residuals_of(adjustment: Adjustment) -> np.ndarray:
    """Image residuals (rows of tie_points and marks, 2), px; NaN where none is known."""
    system = adjustment.system
    out = np.full((len(system.block.tie_points) + len(system.block.marks), 2), np.nan)
    out[system.image_rows.row] = system.residuals().pixels
    return out


def _squares(adjustment: Adjustment, rows: np.ndarray) -> np.ndarray:
    # What is held out has its sigmas all raised alike, which the scale takes back.
    sigma = adjustment.system.block.tie_sigma()[rows]
    return (residuals_of(adjustment)[rows] ** 2).sum(axis=1) / sigma**2


def _log_density(square: np.ndarray) -> np.ndarray:
    """Of a bivariate Student t, but for a constant; square (n,) in squared scales."""
    nu = SETTINGS.student_nu
    return -0.5 * (nu + 2.0) * np.log1p(square / nu)
