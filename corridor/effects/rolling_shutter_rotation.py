"""The camera turns during the readout, and nobody has measured how fast.

One small rotation an image, from the first row to the last, about each axis of the camera.

Source: thesis, section 4.3.3 (rolling shutter, rotation apart from translation).
"""

import numpy as np

from corridor.effects.contract import Effect, Parameter


class RollingShutterRotation(Effect):
    slug = "rolling_shutter_rotation"
    title = "Rolling shutter: rotation of the camera during the readout, an image"
    called = "the camera's rotation while the rows are read"
    place = "motion"
    group = "image"
    revealed_by = "many tie points in every image, over all of its rows"
    unobservable_when = "an image has few points, or points in few rows"

    def parameters(self, block):
        # 0.3 degrees a second for 25 ms.
        scale = np.radians(0.3) * 0.025
        return [Parameter(axis, "rad", scale=scale) for axis in ("x", "y", "z")]

    def shift(self, context, values):
        """Rotation of the camera by values (row - middle row) / (rows - 1)."""
        derivative = np.zeros((len(context), 6, 3))
        for axis in range(3):
            derivative[:, 3 + axis, axis] = context.row
        shift = np.zeros((len(context), 6))
        shift[:, 3:] = context.row[:, None] * values
        return shift, derivative
