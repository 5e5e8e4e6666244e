"""The GNSS positions are turned about the vertical against the ground: another north.

Grid north and true north differ by the meridian convergence: in a UTM zone up to 3 degrees times
the sine of the latitude, and at 500 m from the middle of a block one hundredth of a degree is 9 cm.

Source: Snyder 1987, "Map projections - a working manual", chapter 8 (convergence).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class GnssRotation(LinearEffect):
    slug = "gnss_rotation"
    title = "Rotation of the GNSS positions about the vertical (measured against true)"
    called = "a rotation of the GNSS positions about the vertical"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z")
    revealed_by = "ground control along the corridor"
    unobservable_when = "no control: the whole block turns with its GNSS"
    unknowns = [Parameter("z", "rad", scale=3e-4, text="anticlockwise from above", most=0.06)]

    def derivative(self, context):
        """The measured antenna moves by z x (C - M), M the middle of the stated centres."""
        x, y, _ = (context.centre - context.images.middle).T
        return np.stack([-y, x, np.zeros(len(x))], axis=1)[:, :, None]
