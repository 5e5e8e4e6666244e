"""The GNSS antenna sits elsewhere in each flight: the camera was remounted between them.

Source: Zhou 2019, eq. 5.2 (its theta is our -a).
"""

from corridor.effects.catalogue.lever_arm import LeverArm


class LeverArmPerFlight(LeverArm):
    slug = "lever_arm_per_flight"
    title = "Lever arm of the GNSS antenna in each flight, to be added to the stated one"
    called = "a correction of the GNSS antenna's lever arm, another in each flight"
    group = "flight"
    refines = "lever_arm"
    revealed_by = "images of several headings and tilts in each flight, with control"
    unobservable_when = (
        "a flight keeps one heading: its arm is a bias of its GNSS; nadir images leave z to the "
        "focal length"
    )
