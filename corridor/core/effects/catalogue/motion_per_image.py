"""Every image moves and turns on its own while it is read: six parameters an image.

What Pix4D and Metashape estimate where a rolling shutter is to be corrected and nobody knows
velocities. Give it priors, or it takes what poses and camera need.

Source: Vautherin et al. 2016, [dRx, dRy, dRz, dTx, dTy, dTz]; Zhou 2019, section 7.6.4.3.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class MotionPerImage(LinearEffect):
    slug = "motion_per_image"
    title = "Motion of each image during its readout: translation and rotation, 6 an image"
    called = "a motion and turn of the camera while the rows are read, another in each image"
    place = "motion"
    group = "image"
    generic = True
    # Velocities, a rotation an image and shifted rows say the same and say why.
    searched = False
    revealed_by = "a block of crossing strips with many tie points over all rows of every image"
    unobservable_when = (
        "the ground is flat or the flight is a corridor: each image's pose and the camera do what "
        "its motion does"
    )
    # 5 m/s and 0.3 degrees a second for 30 ms.
    unknowns = [Parameter(axis, "m", scale=0.15) for axis in "xyz"] + [
        Parameter(f"turn_{axis}", "rad", scale=np.radians(0.3) * 0.030) for axis in "xyz"
    ]

    def derivative(self, context):
        """Centre (world) and rotation (camera frame) by values s; the row s from -1/2 to 1/2."""
        return context.row[:, None, None] * np.eye(6)
