"""The GNSS antenna does not sit where it was said to sit, in all flights alike.

Source: Zhou 2019, eq. 5.2 (its theta is our -a).
"""

from corridor.core.effects.contract import LinearEffect, Parameter, Variant

_PER_FLIGHT = Variant(
    slug="lever_arm_per_flight",
    group="flight",
    title="Lever arm of the GNSS antenna in each flight, to be added to the stated one",
    called="a correction of the GNSS antenna's lever arm, another in each flight",
    revealed_by="images of several headings and tilts in each flight, with control",
    unobservable_when=(
        "a flight keeps one heading: its arm is a bias of its GNSS; nadir images leave z to the "
        "focal length"
    ),
    about="""The GNSS antenna sits elsewhere in each flight: the camera was remounted between them.

    Source: Zhou 2019, eq. 5.2 (its theta is our -a).
    """,
)


class LeverArm(LinearEffect):
    slug = "lever_arm"
    title = "Lever arm of the GNSS antenna, to be added to the stated one, 0 if none is"
    called = "a correction of the lever arm of the GNSS antenna"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z")
    revealed_by = "images of several headings and tilts with control, flights both ways"
    unobservable_when = (
        "the camera keeps one heading: the arm is a bias of the GNSS; or it turns with the strip "
        "at one speed: the arm is a clock offset; nadir images leave z to the focal length"
    )
    variants = (_PER_FLIGHT,)
    # An arm left out altogether: antennas sit within half a metre of the lens of a drone.
    unknowns = [Parameter(axis, "m", scale=0.05, most=0.5) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """The antenna moves by R' a; its derivative is R'."""
        return context.rotation.transpose(0, 2, 1)
