"""The measured frame is not parallel to the camera's: A = Exp(-b) R.

Source: Skaloud and Lichti 2006, "Rigorous approach to bore-sight self-calibration", eq. 2;
Zhou 2019, section 3.3.2.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter

# No mount is off by this by mistake; frames that are mixed up differ by 90 degrees or more.
_FAR_DEG = 20.0


class Boresight(LinearEffect):
    slug = "boresight"
    title = "Boresight: how the measured attitudes are turned against the camera"
    called = "a turn of the measured attitudes against the camera"
    place = "attitude"
    group = "flight"
    needs = ("attitudes.image",)
    revealed_by = "images of several headings, with control or GNSS on both sides of the line"
    unobservable_when = (
        "all images stand alike: a turn of the whole block does the same; nadir images of one "
        "height leave x and y to the principal point"
    )
    # Frames of mounts are parallel to some degrees; rad about the camera's axes.
    unknowns = [Parameter(axis, "rad", scale=0.02) for axis in ("x", "y", "z")]

    def believed(self, block):
        """Wherever there are attitudes, unless they are of a frame that was calibrated."""
        stated = block.extra.get("attitudes", {})
        return len(block.attitudes) > 0 and not stated.get("calibrated", False)

    def doubts(self, block, found):
        """A boresight of tens of degrees: another frame was stated than the one that is given."""
        out = []
        for flight, rows in found.groupby("group"):
            turned = np.degrees(np.linalg.norm(rows["value"]))
            if turned > _FAR_DEG:
                out.append(
                    f"The attitudes of {flight} are turned by {turned:.0f} degrees against the "
                    "camera: correct frame in [attitudes] of block.toml (body or camera), "
                    "unless the camera is mounted that way."
                )
        return out

    def derivative(self, context):
        """The measured frame is turned about the camera's axes by the vector b."""
        return np.tile(np.eye(3), (len(context), 1, 1))
