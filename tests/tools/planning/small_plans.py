"""Plans of a hundred metres, solved in a tenth of a second."""

import time

from corridor.core.simulation import Flight, Noise, Plan, TiePoints

SIGMAS = Noise(tie_px=0.5, mark_px=0.5, gnss_m=(0.0084, 0.0055, 0.0096), control_m=0.002)


def plan_of(*flights, **changes):
    """A dike of 120 m, 60 tie points an image."""
    return Plan(
        **{
            "name": "small",
            "flights": flights,
            "axis_m": ((0.0, 0.0), (0.0, 120.0)),
            "tie_points": TiePoints(60),
            "noise": SIGMAS,
        }
        | changes
    )


NADIR = Flight("nadir", 50.0, images=30)
OBLIQUE = Flight("oblique", 50.0, images=30, tilt_deg=23.0, lever_arm_m=(0.6, 0.1, 0.15))
LOW_HIGH = Flight("low_high", (30.0, 70.0), strips=2, images=24)


def quickest(call, times=20):
    """Seconds of the quickest of some calls: other work may share the core."""
    took = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        took.append(time.perf_counter() - began)
    return min(took)
