"""The principal point drifts while the flight goes on.

A warming mount shifts the lens against the sensor.

Source: Daakir et al. 2019, section 3 (displacement of the principal point with temperature).
"""

from corridor.core.effects.contract import LinearEffect, Parameter, of_interior


class PrincipalPointDrift(LinearEffect):
    slug = "principal_point_drift"
    title = "Principal point that drifts with time"
    called = "a drift of the principal point with time"
    place = "camera"
    needs = ("images.time_s",)
    revealed_by = "the same ground minutes apart and from both directions, with GNSS or control"
    unobservable_when = "one heading and a GNSS that may drift: all points of an image move alike"
    unknowns = [Parameter(name, "px/s", scale=2.0 / 600.0) for name in ("x_rate", "y_rate")]

    def derivative(self, context):
        """cx, cy move by rate t, t in seconds from the middle of the block."""
        return of_interior(context, cx=context.time, cy=context.time)
