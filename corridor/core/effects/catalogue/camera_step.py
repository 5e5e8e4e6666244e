"""The camera is another one from a moment on: a hard landing, a knock, a lens that has slipped.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import Parameter, of_interior
from corridor.core.effects.moments import AtMoments

# What another camera has otherwise: of its parameters the unit and a usual size.
_MOVED = {"f": ("px", 2.0), "cx": ("px", 2.0), "cy": ("px", 2.0), "k1": ("1", 1e-3)}
_PAUSE = 2.0  # times the usual interval between exposures


class CameraStep(AtMoments):
    """By default the pauses in which a strip or a flight ends; where there is none, or too many, as
    of any effect of moments."""

    slug = "camera_step"
    title = "Focal length, principal point and distortion that change at a moment and stay changed"
    called = "a sudden and lasting change of the camera"
    place = "camera"
    needs = ("images.time_s",)
    generic = True
    revealed_by = "GNSS or control before and after the change"
    unobservable_when = "the change lies between two flights whose lever arms are free"
    most = 7

    def _first_after(self, times):
        pause = np.diff(times)
        after = 1 + np.flatnonzero(pause > _PAUSE * np.median(pause))
        few = 0 < len(after) <= min(self.most, len(times) - 1)
        return after if few else super()._first_after(times)

    def parameters(self, block):
        count = len(self.moments(Images.of(block)))
        return [
            Parameter(f"{name}_{k + 1}", unit, scale=scale)
            for name, (unit, scale) in _MOVED.items()
            for k in range(count)
        ]

    def derivative(self, context):
        """f, cx, cy, k1 move by the sum of all steps before the image was taken."""
        return of_interior(context, **dict.fromkeys(_MOVED, self.happened(context)))
