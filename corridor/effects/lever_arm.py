"""The GNSS antenna does not sit where it was said to sit.

Source: thesis, eq. 5.2 (its theta is our -a).
"""

import numpy as np

from corridor.effects.contract import Effect, Parameter


class LeverArm(Effect):
    slug = "lever_arm"
    title = "Lever arm of the GNSS antenna, to be added to the stated one"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z")
    # The camera is remounted between flights, not during one.
    group = "flight"

    def parameters(self, block):
        return [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def shift(self, context, values):
        """The antenna moves by R' a; its derivative is R'."""
        to_world = context.rotation.transpose(0, 2, 1)
        values = np.broadcast_to(values, (len(context), 3))
        return np.einsum("nij,nj->ni", to_world, values), to_world
