"""The clock of the attitudes disagrees with the camera's: true time = attitude's time + offset.

The attitude was taken at the stated time; at the true one the camera has turned on by w offset.

Source: Zhou 2019, section 5.2, for positions; a turn in place of a way.
"""

from corridor.core.effects.contract import LinearEffect, Parameter


class AttitudeClockOffset(LinearEffect):
    slug = "attitude_clock_offset"
    title = "Offset between the clocks of camera and attitudes"
    called = "an offset between the clocks of camera and attitudes"
    place = "attitude"
    needs = ("attitudes.image", "images.wx", "images.wy", "images.wz")
    revealed_by = "images that turn while they are taken, both ways, with their angular rates"
    unobservable_when = "the camera hardly turns, or only at one rate: the boresight does the same"
    unknowns = [Parameter("offset", "s", scale=0.050)]

    def derivative(self, context):
        """The measured attitude is w offset behind that of a camera that turns at its rate w."""
        return -context.angular_rate[:, :, None]
