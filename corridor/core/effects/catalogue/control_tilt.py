"""The given heights lean: a geoid that slopes under the corridor, beside GNSS above the ellipsoid.

Heights above the ellipsoid and above the geoid differ by an undulation that is not the same all
along a corridor: one offset that was taken off everywhere leaves its slope, as a rule 1 to 5 cm in
a kilometre, in the mountains up to 30.

Source: Hofmann-Wellenhof and Moritz 2006, "Physical Geodesy", section 2.20 (the deflection of the
vertical is the slope of the geoid).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class ControlTilt(LinearEffect):
    slug = "control_tilt"
    title = "Slope of the heights of the ground control (given minus true)"
    called = "a slope of the heights of the ground control"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    revealed_by = "GNSS along the corridor, and control at more than its ends"
    unobservable_when = "there is no GNSS: the whole block leans with its control"
    unknowns = [
        Parameter("east", "1", scale=2e-4, text="metres up a metre to the east", most=1e-3),
        Parameter("north", "1", scale=2e-4, text="metres up a metre to the north", most=1e-3),
    ]

    def derivative(self, context):
        """Given heights rise by east (x - M_x) + north (y - M_y), M the middle of the images."""
        derivative = np.zeros((len(context), 3, 2))
        derivative[:, 2] = (context.position - context.images.middle)[:, :2]
        return derivative
