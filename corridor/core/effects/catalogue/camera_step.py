"""The camera is another one from a moment on: a hard landing, a knock, a lens that has slipped.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import LinearEffect, Parameter, of_interior

_MOVED = ("f", "cx", "cy")
_STEPS = 7
_PAUSE = 2.0  # times the usual interval between exposures


class CameraStep(LinearEffect):
    """at: times of the changes, s.

    By default the pauses in which a strip or a flight ends; where there is none, or more than
    `_STEPS` are, `_STEPS` times with as many images between any two.
    """

    slug = "camera_step"
    title = "Focal length and principal point that change at a moment and stay changed"
    called = "a sudden and lasting change of the camera"
    place = "camera"
    needs = ("images.time_s",)
    generic = True
    revealed_by = "GNSS or control before and after the change"
    unobservable_when = "the change lies between two flights whose lever arms are free"

    def __init__(self, group: str | None = None, at: tuple[float, ...] | None = None):
        super().__init__(group)
        self.at = at

    def moments(self, images: Images) -> np.ndarray:
        """Times of the changes, s, none of them that of an image."""
        if self.at is not None:
            return np.asarray(self.at, dtype=float)
        times = np.unique(images.time[np.isfinite(images.time)])
        if len(times) < 2:
            return np.zeros(_STEPS)
        count = min(_STEPS, len(times) - 1)
        pause = np.diff(times)
        after = 1 + np.flatnonzero(pause > _PAUSE * np.median(pause))
        if not 0 < len(after) <= count:
            after = np.round(np.linspace(0, len(times), count + 2)[1:-1]).astype(int)
        return (times[after - 1] + times[after]) / 2

    def parameters(self, block):
        count = len(self.moments(Images.of(block)))
        return [
            Parameter(f"{name}_{k + 1}", "px", scale=2.0) for name in _MOVED for k in range(count)
        ]

    def derivative(self, context):
        """f, cx, cy move by the sum of all steps before the image was taken."""
        moments = self.moments(context.images)
        time = context.images.time[context.image][:, None]
        after = np.where(np.isnan(time), np.nan, time > moments)
        return of_interior(context, **dict.fromkeys(_MOVED, after))
