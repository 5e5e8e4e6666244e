"""The GNSS positions wander in each flight in a way that no named effect has.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import AlongAxes, Parameter
from corridor.core.effects.splines import coefficients, curve

_MOST = 6


class GnssSpline(AlongAxes):
    slug = "gnss_spline"
    title = "GNSS positions that wander with time, smoothly, in each flight"
    called = "a slow wandering of the GNSS positions"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.time_s")
    group = "flight"
    generic = True
    revealed_by = "ground control, or strips that see the same ground at different times"
    unobservable_when = "one strip without control follows its GNSS wherever it goes"

    def parameters(self, block):
        count = self._count(Images.of(block))
        return [Parameter(f"{a}_{k}", "m", scale=0.05) for a in "xyz" for k in range(1, count)]

    def terms(self, context):
        """Each axis moves by sum_k value_k curve_k(time), over the times of the image's flight."""
        images = context.images
        count = self._count(images)
        curves = np.full((len(images.time), count - 1), np.nan)
        for flight in range(len(images.flight_names)):
            mine = images.flight == flight
            curves[mine] = curve(images.time[mine], images.time[mine], count)
        return curves[context.image]

    @staticmethod
    def _count(images):
        """The shortest flight sets how many coefficients all have."""
        flights = range(len(images.flight_names))
        return min(coefficients(images.time[images.flight == f], _MOST) for f in flights)
