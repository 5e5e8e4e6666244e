"""The GNSS positions are all wrong by the same vector (measured minus true).

A base station with wrong coordinates, another realisation of the datum, a wrong antenna height.

Source: Zhou 2019, section 5.6 (height bias of GNSS-assisted blocks).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class GnssBias(LinearEffect):
    slug = "gnss_bias"
    title = "Constant error of the GNSS positions"
    called = "a constant error of the GNSS positions"
    place = "antenna"
    datum = True
    needs = ("gnss.x", "gnss.y", "gnss.z")
    revealed_by = "ground control, with lever arms held or a camera that turns about its axis"
    unobservable_when = (
        "there is no control (a common shift of the control looks the same), or one heading and "
        "free lever arms"
    )
    unknowns = [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """The predicted antenna moves by the bias itself."""
        return np.broadcast_to(np.eye(3), (len(context), 3, 3))
