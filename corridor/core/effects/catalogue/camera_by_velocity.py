"""Focal length and principal point follow the speed: blur, vibration or a shutter at work.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.splines import CameraCurve


class CameraByVelocity(CameraCurve):
    slug = "camera_by_velocity"
    title = (
        "Focal length and principal point as smooth curves of the velocity along the rows' order"
    )
    called = "a camera that changes with its velocity"
    needs = ("images.vx", "images.vy", "images.vz")
    revealed_by = "strips flown at different speeds, or both ways without turning the camera"
    unobservable_when = "the drone always flies at one speed"

    def quantity(self, images):
        """Velocity along the axis of the picture in which rows follow each other, m/s."""
        own = np.einsum("nij,nj->ni", images.start_rotation, images.velocity)
        return images.row_sign * own[np.arange(len(own)), images.row_axis]
