"""Focal length and principal point follow a curve of time that no named drift has.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.splines import CameraCurve


class CameraByTime(CameraCurve):
    slug = "camera_by_time"
    title = "Focal length and principal point as smooth curves of time"
    called = "a camera that changes with time"
    needs = ("images.time_s",)
    revealed_by = "flights of many minutes, with GNSS or control"
    unobservable_when = "GNSS and control are too weak to separate the camera from its poses"

    def quantity(self, images):
        """Time, s."""
        return images.time
