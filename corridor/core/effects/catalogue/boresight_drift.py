"""The boresight drifts with time: the mount settles, or the attitude's own zero walks.

Source: Skaloud and Lichti 2006 (stability of the boresight), linear in time.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class BoresightDrift(LinearEffect):
    slug = "boresight_drift"
    title = "Boresight that drifts with time, in each flight"
    called = "a drift of the measured attitudes against the camera"
    place = "attitude"
    group = "flight"
    needs = ("attitudes.image", "images.time_s")
    revealed_by = "attitudes of a long flight, strips both ways, with control or GNSS"
    unobservable_when = "the flight is short: the turn stays below the noise of the attitudes"
    # A degree in the twenty minutes of a battery; rad/s about the camera's axes.
    unknowns = [Parameter(axis, "rad/s", scale=np.radians(1.0) / 1200) for axis in "xyz"]

    def derivative(self, context):
        """A turn about the camera's axes that grows with the time t from the flight's middle: r t.

        From the block's middle the drifts of two flights would be two boresights.
        """
        images = context.images
        since = images.time[context.image] - images.mid_time_of_flight[context.group("flight")]
        return np.eye(3) * since[:, None, None]
