"""The camera is held at a focal length that is not the true one.

Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
photogrammetry" (focal length against height in flat blocks).
"""

import numpy as np

from corridor.camera import INTERIOR
from corridor.effects.contract import Effect, Parameter, linear


class Focal(Effect):
    slug = "focal"
    title = "Focal length that differs from the stated one (true minus stated)"
    called = "a correction of the stated focal length"
    place = "camera"
    group = "camera"
    stands_in_for = ("f",)
    revealed_by = (
        "GNSS and ground control together, or two heights, or oblique images: scale and height "
        "then disagree"
    )
    unobservable_when = (
        "all images look straight down from one height and GNSS or control is absent"
    )

    def parameters(self, block):
        return [Parameter("f", "px", scale=10.0)]

    def shift(self, context, values):
        """f moves by the value itself."""
        derivative = np.zeros((len(context), len(INTERIOR), 1))
        derivative[:, INTERIOR.index("f")] = 1.0
        return linear(derivative, values), derivative
