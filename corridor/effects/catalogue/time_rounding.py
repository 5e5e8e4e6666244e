"""Each exposure has its own small error of time: rounded stamps, a trigger that jitters.

Source: Zhou 2019, section 5.2 (synchronisation of camera and receiver).
"""

from corridor.effects.catalogue.clock_offset import ClockOffset
from corridor.effects.contract import Parameter


class TimeRounding(ClockOffset):
    slug = "time_rounding"
    title = "Error of the exposure time of each image (true minus stated)"
    called = "an error in the exposure time of each image"
    group = "image"
    refines = "clock_offset"
    revealed_by = "GNSS residuals along the flight that other directions do not share"
    unobservable_when = (
        "the drone hovers, or the error times the speed is below the noise of the GNSS"
    )

    def parameters(self, block):
        return [Parameter("offset", "s", scale=0.030)]
