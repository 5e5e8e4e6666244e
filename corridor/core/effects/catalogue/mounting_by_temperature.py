"""The head of a rig bends as it warms: the mountings of its members follow the temperature.

Source: Rupnik, Nex and Remondino 2014 (stability of the relative orientation), linear in
temperature.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class MountingByTemperature(LinearEffect):
    slug = "mounting_by_temperature"
    title = "Mountings of a rig's members that follow the temperature"
    called = "a turn of the rig's cameras against each other with the temperature"
    place = "motion"
    group = "member"
    needs = ("rig.member", "images.temperature_c")
    row_degree = 0
    revealed_by = "exposures at several temperatures, tie points that members share"
    unobservable_when = "members see nothing that another one sees, or the temperature is the same"
    # Half a millimetre on a head of 0.2 m bends by 0.1 degrees over 20 degrees.
    unknowns = [Parameter(f"turn_{axis}", "rad/C", scale=1e-4) for axis in "xyz"]

    def derivative(self, context):
        """The member turns about its axes with the temperature T from the block's middle: r T."""
        derivative = np.zeros((len(context), 6, 3))
        warm = context.temperature - context.images.mid_temperature
        hangs = context.group("member") >= 0
        derivative[:, 3:] = np.eye(3) * np.where(hangs, warm, 0.0)[:, None, None]
        return derivative
