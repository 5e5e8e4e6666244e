"""Each control point is off by itself: its survey is worse than its standard deviations say.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class ControlScatter(LinearEffect):
    slug = "control_scatter"
    title = "Errors of all control points, each its own (given minus true)"
    called = "ground control that is less accurate than stated"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    group = "point"
    generic = True
    revealed_by = "GNSS and images that contradict the control, differently at most points"
    unobservable_when = "there are few control points, or no GNSS"
    remedy = (
        "state how accurate the control is: sx, sy, sz of ground.csv, or control_m in block.toml"
    )
    # An RTK rover is good to 1 to 3 cm; what is worse than that is stated as worse.
    unknowns = [Parameter(axis, "m", scale=0.03) for axis in "xyz"]

    def derivative(self, context):
        """The given coordinates move by the values themselves."""
        return np.broadcast_to(np.eye(3), (len(context), 3, 3))
