"""The principal point is another one in each flight: the lens sits anew, a stabiliser has parked.

Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
photogrammetry" (block-variant and photo-variant parameters).
"""

from corridor.core.effects.contract import LinearEffect, Parameter, of_interior


class PrincipalPointPerFlight(LinearEffect):
    slug = "principal_point_per_flight"
    title = "Principal point of each flight (true minus stated)"
    called = "a principal point of its own in each flight"
    place = "camera"
    group = "flight"
    stands_in_for = ("cx", "cy")
    revealed_by = "strips flown both ways with GNSS or control, images turned about their axis"
    unobservable_when = (
        "all images of a flight have one heading and its lever arm is free: they move alike"
    )
    unknowns = [Parameter(name, "px", scale=5.0) for name in ("cx", "cy")]

    def derivative(self, context):
        """cx, cy move by the values themselves."""
        return of_interior(context, cx=1.0, cy=1.0)
