"""The GNSS antenna does not sit where it was said to sit, in all flights alike.

Source: Zhou 2019, eq. 5.2 (its theta is our -a).
"""

import numpy as np

from corridor.effects.contract import Effect, Parameter


class LeverArm(Effect):
    slug = "lever_arm"
    title = "Lever arm of the GNSS antenna, to be added to the stated one"
    called = "a correction of the stated lever arm of the GNSS antenna"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z")
    revealed_by = "images of several headings and tilts with control, flights both ways"
    unobservable_when = (
        "the camera keeps one heading: the arm is a bias of the GNSS; or it turns with the strip "
        "at one speed: the arm is a clock offset; nadir images leave z to the focal length"
    )

    def parameters(self, block):
        return [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def shift(self, context, values):
        """The antenna moves by R' a; its derivative is R'."""
        to_world = context.rotation.transpose(0, 2, 1)
        values = np.broadcast_to(values, (len(context), 3))
        return np.einsum("nij,nj->ni", to_world, values), to_world
