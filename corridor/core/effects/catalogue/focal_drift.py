"""The focal length drifts while the flight goes on.

What follows temperature is another effect; this one knows the clock only.

Source: Zhou 2019, section 4.3 (a drift of 0.0275 px an image).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, of_interior


class FocalDrift(LinearEffect):
    slug = "focal_drift"
    title = "Focal length that drifts with time, linear and quadratic"
    called = "a drift of the focal length with time"
    place = "camera"
    needs = ("images.time_s",)
    revealed_by = "flights of many minutes with GNSS or control, oblique images or two heights"
    unobservable_when = "nadir images whose GNSS may drift in height: scale and height go together"
    # 2 px in 10 minutes; the bend is as large over a flight of 20 minutes.
    unknowns = [
        Parameter("rate", "px/s", scale=2.0 / 600.0, text="in the middle of the block"),
        Parameter("bend", "px/s^2", scale=2.0 / 600.0**2, text="half the change of the rate"),
    ]

    def derivative(self, context):
        """f moves by rate t + bend t^2, t in seconds from the middle of the block."""
        t = context.time
        return of_interior(context, f=np.stack([t, t * t], axis=1))
