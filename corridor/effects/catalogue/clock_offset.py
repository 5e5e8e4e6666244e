"""The camera's clock and the receiver's clock disagree: true time = time_s + offset.

The GNSS position was taken at the stated time; at the true one the antenna is v offset further.

Source: Zhou 2019, section 5.2 (synchronisation of camera and receiver).
"""

from corridor.effects.contract import LinearEffect, Parameter, Variant

_PER_IMAGE = Variant(
    slug="time_rounding",
    group="image",
    title="Error of the exposure time of each image (true minus stated)",
    called="an error in the exposure time of each image",
    revealed_by="GNSS residuals along the flight that other directions do not share",
    unobservable_when=(
        "the drone hovers, or the error times the speed is below the noise of the GNSS"
    ),
    about="""Each exposure has its own small error of time: rounded stamps, a trigger that jitters.

    Source: Zhou 2019, section 5.2 (synchronisation of camera and receiver).
    """,
)


class ClockOffset(LinearEffect):
    slug = "clock_offset"
    title = "Offset between the clocks of camera and GNSS receiver"
    called = "an offset between the clocks of camera and GNSS receiver"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.vx", "images.vy", "images.vz")
    revealed_by = "strips flown both ways or at different speeds, with GNSS"
    unobservable_when = (
        "one speed and a camera that turns with the strip: a lever arm does the same"
    )
    variants = (_PER_IMAGE,)

    def parameters(self, block):
        return [Parameter("offset", "s", scale=0.030 if self.group == "image" else 0.050)]

    def derivative(self, context):
        """The measured antenna lies v offset behind the camera's."""
        return -context.velocity[:, :, None]
