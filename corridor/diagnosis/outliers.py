"""Tie observations that a robust fit has set aside, and whether they are more than wrong matches.

Matches go wrong anywhere and in any direction. Where a pane covers part of the picture, single
observations cross its rim: each of them is set aside as a wrong match, no shape that is fitted to
all of them sees it, and what gives it away is that they lie together and point one way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.adjustment import Adjustment
from corridor.diagnosis.robust import scale_of
from corridor.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class Ties:
    """Tie observations (n,) of one camera, by point.

    place: (n, 2) px where the model puts them: measured, a wrong match moves its own place.
    residual: (n, 2) in scales of Student's t; scale_px: (n,) what one of them is. size: (2,) px.
    """

    point: np.ndarray
    image: np.ndarray
    place: np.ndarray
    residual: np.ndarray
    scale_px: np.ndarray
    size: np.ndarray

    @property
    def far(self) -> np.ndarray:
        """Which of them the fit has set aside."""
        return (self.residual**2).sum(axis=1) > SETTINGS.outlier_scales**2


def ties_by_camera(adjustment: Adjustment) -> list[Ties]:
    """The tie observations that an adjustment can see, a camera each."""
    system = adjustment.system
    rows, images = system.image_rows, system.images
    found = system.residuals().pixels
    good = rows.tie & np.isfinite(found).all(axis=1)
    if not good.any():
        return []
    point, image, xy = rows.point[good], rows.image[good], rows.xy[good]
    found, sigma = found[good], rows.sigma[good]
    scale = scale_of(((found / sigma[:, None]) ** 2).sum(axis=1)) * sigma
    camera = images.camera[image]
    out = []
    for number in np.unique(camera):
        k = camera == number
        out.append(
            Ties(
                point[k],
                image[k],
                (xy - found)[k],
                (found / scale[:, None])[k],
                scale[k],
                images.size[image[k][0]].astype(float),
            )
        )
    return out
