"""A member of a rig fires late: it has moved on, and turned, since its rig's exposure.

Source: Rupnik, Nex and Remondino 2014, section 3 (synchronisation of the members); motion as of
Zhou 2019, section 5.2.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class MemberDelay(LinearEffect):
    slug = "member_delay"
    title = "Members of a rig that fire late"
    called = "a delay of the rig's cameras against each other"
    place = "motion"
    group = "member"
    needs = ("rig.member", "images.vx", "images.vy", "images.vz")
    takes = ("images.wx", "images.wy", "images.wz")
    row_degree = 0
    revealed_by = "strips both ways, or several speeds, with tie points that members share"
    unobservable_when = (
        "one speed in the frame of the head, whose mounting is free: a shift along the flight does "
        "the same"
    )
    unknowns = [Parameter("delay", "s", scale=0.010)]

    def derivative(self, context):
        """The centre has gone v t further and the camera has turned by w t."""
        derivative = np.zeros((len(context), 6, 1))
        hangs = context.group("member") >= 0
        derivative[hangs, :3, 0] = context.velocity[hangs]
        if context.images.turns:
            derivative[hangs, 3:, 0] = np.nan_to_num(context.angular_rate[hangs])
        return derivative
