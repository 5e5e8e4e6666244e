"""The camera's clock and the receiver's clock disagree: true time = time_s + offset.

The GNSS position was taken at the stated time; at the true one the antenna is v offset further.

Source: Zhou 2019, section 5.2 (synchronisation of camera and receiver).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, Variant

# Missed where the positions are late by so many sigmas, and that explains this part of the squares.
_LATE_SIGMAS, _LATE_SHARE = 5.0, 0.3

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
_PER_FLIGHT = Variant(
    slug="clock_offset_per_flight",
    group="flight",
    title="Offset between the clocks of camera and GNSS receiver in each flight",
    called="an offset between the clocks of camera and receiver, another in each flight",
    revealed_by="strips flown both ways or at different speeds in each flight, with GNSS",
    unobservable_when=(
        "a flight keeps one speed and its camera turns with the strip: a lever arm of each flight "
        "does the same"
    ),
    about="""The clocks disagree by another amount in each flight: one was set or started anew.

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
    variants = (_PER_IMAGE, _PER_FLIGHT)

    def parameters(self, block):
        return [Parameter("offset", "s", scale=0.030 if self.group == "image" else 0.050)]

    def missed(self, found):
        late = _late(found)
        if late is None:
            return []
        delay, sigma = late
        return [
            f"The GNSS positions are {1000 * abs(delay):.0f} +- {1000 * sigma:.0f} ms "
            f"{'ahead of' if delay > 0 else 'behind'} the images along the flight: --effect "
            f"{self.slug} estimates it; leaving positions out (--reject-gnss) does not help."
        ]

    def derivative(self, context):
        """The measured antenna lies v offset behind the camera's."""
        return -context.velocity[:, :, None]


def _late(found):
    """By how much the antenna positions come late, s, and its sigma; None where they do not.

    By their residuals along the flight.
    """
    images = found.block.images.set_index("image").reindex(found.gnss["image"].astype(str))
    if not len(images) or not {"vx", "vy", "vz"} <= set(images):
        return None
    # Of all positions alike: those of one direction, as far off as the others, hardly count alone.
    sigmas = np.median(found.gnss[["sx", "sy", "sz"]].to_numpy(), axis=0)
    v = found.gnss[["vx", "vy", "vz"]].to_numpy() / sigmas
    speed = images[["vx", "vy", "vz"]].to_numpy(float) / sigmas
    known = np.isfinite(speed).all(axis=1)
    if known.sum() < 8:
        return None
    # The block follows what all positions share, or those of the direction that has more.
    v, speed = (part[known] - part[known].mean(axis=0) for part in (v, speed))
    square = float(np.sum(speed**2))
    if not square > 0:
        return None
    delay = float(np.sum(v * speed)) / square
    left = v - delay * speed
    share = 1 - float(np.sum(left**2) / np.sum(v**2))
    sigma = float(np.sqrt(np.sum(left**2) / left.size / square))
    return (delay, sigma) if abs(delay) > _LATE_SIGMAS * sigma and share > _LATE_SHARE else None
