"""Given heights follow the earth, the block's heights a plane: a point far out is given too high.

At the distance d from the middle the earth has fallen away by d^2 / 2R.

Source: Kraus 2007, "Photogrammetry", earth curvature; R is the mean radius of the earth.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter

RADIUS = 6.371e6  # m


class EarthCurvature(LinearEffect):
    slug = "earth_curvature"
    title = "Curvature of the earth in the heights of the ground control"
    called = "the curvature of the earth"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    revealed_by = "a corridor of many kilometres, control along it, camera and GNSS without bends"
    unobservable_when = (
        "the corridor is short: 28 mm at 600 m from the middle, 0.2 mm at 50 m; or the GNSS "
        "heights follow the earth as well"
    )
    unknowns = [Parameter("fraction", "1", 1.0, text="1: nobody has allowed for it", most=4.0)]

    def derivative(self, context):
        """Given heights rise by fraction d^2 / 2R, d the distance in plan from the middle."""
        away = (context.position - context.images.middle)[:, :2]
        derivative = np.zeros((len(context), 3, 1))
        derivative[:, 2, 0] = (away**2).sum(axis=1) / (2.0 * RADIUS)
        return derivative
