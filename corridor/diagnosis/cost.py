"""What a shape of the picture costs where it is left out: on the ground, and in predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.adjustment import Adjustment
from corridor.diagnosis.prediction import Prediction, residuals_of
from corridor.diagnosis.settings import SETTINGS
from corridor.geometry import UNUSABLE, is_outlier, robust_scale_of_lengths


@dataclass(frozen=True)
class Cost:
    """What a shape of the picture costs where it is left out.

    metres, sigmas: by how much half of the tie points move at least, 3D, and in their standard
    deviations on the axis where that is most. ratio: error of ties that no fit has used with it,
    over the error without; proved: whether that is more than chance.
    """

    metres: float
    sigmas: float
    ratio: float
    proved: bool

    @classmethod
    def of(cls, without: Adjustment, with_it: Adjustment, rows: np.ndarray) -> Cost:
        """Between two adjustments; rows: tie observations that neither has used."""
        tie = tie_gap(without, with_it, rows)
        ratio = tie["after"] / tie["before"] if tie["before"] else 1.0
        proved = ratio < 1.0 and Prediction.between(without, with_it, rows).proved
        return cls(*moved(without, with_it), ratio, proved)

    @property
    def counts(self) -> bool:
        """Whether it is worth a word: beyond the ground's own doubt, or seen in the residuals."""
        seen = self.proved and self.ratio < SETTINGS.cost_ratio
        return self.sigmas > SETTINGS.cost_sigmas or seen


def moved(before: Adjustment, after: Adjustment) -> tuple[float, float]:
    """Median 3D movement of the points between two adjustments, m, and in sigmas of `before`."""
    a, b = (one.points.set_index("point")[["x", "y", "z"]] for one in (before, after))
    away = b.reindex(a.index).to_numpy() - a.to_numpy()
    known = np.isfinite(away).all(axis=1)
    metres = float(np.median(np.linalg.norm(away[known], axis=1)))
    return metres, float(np.nanmedian(np.abs(away / before.point_sigma)[known], axis=0).max())


def tie_gap(before: Adjustment, after: Adjustment, rows: np.ndarray) -> dict[str, float | None]:
    """RMS (px, an axis) of observations that both fits did not use, wrong matches left out."""
    found = [residuals_of(one)[rows] for one in (before, after)]
    if not len(rows):
        return {"before": None, "after": None}
    length = np.hypot(*found[1].T)
    good = np.isfinite(length) & ~is_outlier(length, robust_scale_of_lengths(length), UNUSABLE)
    values = [float(np.sqrt(np.mean(one[good] ** 2))) for one in found]
    return {"before": values[0], "after": values[1]}
