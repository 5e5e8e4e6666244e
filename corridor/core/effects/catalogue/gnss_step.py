"""The GNSS positions jump at a moment and stay off: another fix, another base station.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import LinearEffect, Parameter, along_each

_MOST = 60


class GnssStep(LinearEffect):
    """at: times of the jumps, s. By default between any two images, or `_MOST` times with as many
    images between."""

    slug = "gnss_step"
    title = "GNSS positions that jump at a moment and stay off"
    called = "a sudden and lasting shift of the GNSS positions"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.time_s")
    generic = True
    revealed_by = "images that tie the positions before and after the jump to each other"
    unobservable_when = "the jump lies between two flights whose lever arms are free"

    def __init__(self, group: str | None = None, at: tuple[float, ...] | None = None):
        super().__init__(group)
        self.at = at

    def moments(self, images: Images) -> np.ndarray:
        """Times of the jumps, s, none of them that of an image."""
        if self.at is not None:
            return np.asarray(self.at, dtype=float)
        times = np.unique(images.time[np.isfinite(images.time)])
        if len(times) < 2:
            return np.zeros(1)
        count = min(_MOST, len(times) - 1)
        after = np.unique(np.round(np.linspace(0, len(times), count + 2)[1:-1]).astype(int))
        return (times[after - 1] + times[after]) / 2

    def parameters(self, block):
        count = len(self.moments(Images.of(block)))
        return [Parameter(f"{a}_{k + 1}", "m", scale=0.05) for a in "xyz" for k in range(count)]

    def derivative(self, context):
        """Each axis moves by the sum of all jumps before the image was taken."""
        moments = self.moments(context.images)
        time = context.images.time[context.image][:, None]
        return along_each(np.where(np.isnan(time), np.nan, time > moments))
