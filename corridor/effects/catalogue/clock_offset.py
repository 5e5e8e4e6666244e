"""The camera's clock and the receiver's clock disagree: true time = time_s + offset.

The GNSS position was taken at the stated time; at the true one the antenna is v offset further.

Source: Zhou 2019, section 5.2 (synchronisation of camera and receiver).
"""

from corridor.effects.contract import Effect, Parameter


class ClockOffset(Effect):
    slug = "clock_offset"
    title = "Offset between the clocks of camera and GNSS receiver"
    called = "an offset between the clocks of camera and GNSS receiver"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.vx", "images.vy", "images.vz")
    revealed_by = "strips flown both ways or at different speeds, with GNSS"
    unobservable_when = (
        "one speed and a camera that turns with the strip: a lever arm does the same"
    )

    def parameters(self, block):
        return [Parameter("offset", "s", scale=0.050)]

    def shift(self, context, values):
        """The measured antenna lies v offset behind the camera's."""
        derivative = -context.velocity[:, :, None]
        return derivative[:, :, 0] * values, derivative
