"""One scale bar or tape was measured, or written down, wrongly (given minus true).

Source: Baarda 1968, "A testing procedure for use in geodetic networks".
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class DistanceBlunder(LinearEffect):
    slug = "distance_blunder"
    title = "Wrong value of one measured distance"
    called = "an error of a measured distance"
    place = "distance"
    needs = ("distances.distance",)
    group = "distance"
    revealed_by = "other distances, control or GNSS, which agree without this one"
    unobservable_when = "nothing else gives the block its scale, or only one other distance does"
    # A digit or a mark of a tape misread.
    unknowns = [Parameter("error", "m", scale=0.1)]

    def derivative(self, context):
        """The given distance is longer by the value itself."""
        return np.ones((len(context), 1, 1))
