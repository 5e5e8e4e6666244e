"""Heat acts on the image plane: the picture grows, bends and shifts with every degree.

Nothing moves in the middle of the block's temperatures. What a held camera lacks there, because
it was calibrated at another one, is the focal length's and the principal point's.

Source: Daakir et al. 2019, "Improvement of photogrammetric accuracy by modeling and correcting the
thermal effect on camera calibration".
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class Thermal(LinearEffect):
    slug = "thermal"
    title = "Thermal expansion of the image plane: scale, cubic and shift per degree"
    called = "the thermal expansion of the image plane"
    place = "image"
    needs = ("images.temperature_c",)
    revealed_by = "a camera that warms by several degrees between images of the same ground"
    unobservable_when = (
        "the temperature hardly changes, or changes as time does and a drift of the camera is "
        "modelled; the shift hides in poses unless GNSS or control holds them"
    )
    unknowns = [
        Parameter("scale", "px/C", 0.1, text="growth at the end of the long side"),
        Parameter("cubic", "px/C", 0.1, text="growth there with the cube of the distance"),
        Parameter("x", "px/C", 0.1, text="shift of the whole picture"),
        Parameter("y", "px/C", 0.1, text="shift of the whole picture"),
    ]

    def derivative(self, context):
        """dT (scale p + cubic r^2 p + (x, y)), p from the picture's middle, 1 at its edge.

        scale, cubic: px per degree, outwards at the end of the long side; x, y: of the whole
        picture. dT: from the middle of the block's temperatures.
        """
        place = context.plane
        warmer = context.temperature - context.images.mid_temperature
        derivative = np.zeros((len(context), 2, 4))
        derivative[:, :, 0] = place
        derivative[:, :, 1] = place * (place**2).sum(axis=1, keepdims=True)
        derivative[:, 0, 2] = derivative[:, 1, 3] = 1.0
        derivative *= warmer[:, None, None]
        return derivative
