"""Every image moves on its own while it is read: three parameters an image, known to nobody.

What a program can do without velocities: the motion of each image is estimated from its tie
points alone. Give it priors (readout times the sigma of a speed), or it takes what poses and
camera need.

Source: Vautherin et al. 2016 (Pix4D's linear motion, translation only).
"""

import numpy as np

from corridor.core.effects.catalogue.motion_per_image import MotionPerImage
from corridor.core.effects.contract import Parameter


class TranslationPerImage(MotionPerImage):
    slug = "translation_per_image"
    title = "Motion of each image during its readout: translation, 3 parameters an image"
    called = "a motion of the camera while the rows are read, another in each image"
    # 5 m/s for 30 ms.
    unknowns = [Parameter(axis, "m", scale=0.15) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """Centre by values s, world axes, with the row s from -1/2 to 1/2."""
        return context.row[:, None, None] * np.eye(6, 3)
