"""One ground control point was surveyed wrongly, or its mark has moved (given minus true).

Source: Baarda 1968, "A testing procedure for use in geodetic networks".
"""

import numpy as np

from corridor.effects.contract import Effect, Parameter, linear


class ControlBlunder(Effect):
    slug = "control_blunder"
    title = "Wrong coordinates of one control point"
    called = "an error in the given coordinates of a control point"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    group = "point"
    revealed_by = "the other control points and the GNSS, which agree without this one"
    unobservable_when = (
        "neither GNSS nor enough other control points determine the block without it"
    )

    def parameters(self, block):
        return [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def shift(self, context, values):
        """The given coordinates move by the values themselves."""
        derivative = np.broadcast_to(np.eye(3), (len(context), 3, 3))
        return linear(derivative, values), derivative
