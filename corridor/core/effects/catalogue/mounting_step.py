"""A member of a rig is knocked: from a moment on it hangs turned, and stays so.

The moment is the longest pause between exposures: a landing, or the turn between two strips.

Source: Rupnik, Nex and Remondino 2014 (stability of the relative orientation); the moment: this
project.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class MountingStep(LinearEffect):
    slug = "mounting_step"
    title = "Mountings of a rig's members that turn at the longest pause between exposures"
    called = "a sudden and lasting turn of the rig's cameras against each other"
    place = "motion"
    group = "member"
    needs = ("rig.member", "images.time_s")
    row_degree = 0
    revealed_by = "tie points that members share, before and after"
    unobservable_when = "members see nothing that another one sees"
    unknowns = [Parameter(f"turn_{axis}", "rad", scale=0.002) for axis in "xyz"]

    def derivative(self, context):
        """After the pause the member is turned about its axes by w, before it by -w."""
        derivative = np.zeros((len(context), 6, 3))
        times = np.unique(context.images.time)
        longest = np.argmax(np.diff(times)) if len(times) > 1 else 0
        side = np.where(context.images.time[context.image] > times[longest], 1.0, -1.0)
        hangs = context.group("member") >= 0
        derivative[:, 3:] = np.eye(3) * np.where(hangs, side, 0.0)[:, None, None]
        return derivative
