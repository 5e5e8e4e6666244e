"""Focal length and principal point follow the height above ground: focus, or a wrong scale.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.splines import CameraCurve


class CameraByDepth(CameraCurve):
    slug = "camera_by_depth"
    title = "Focal length and principal point as smooth curves of the height above ground"
    called = "a camera that changes with the height above ground"
    revealed_by = "strips at two heights or more, with GNSS or control"
    unobservable_when = "all images have one height, or their heights rest on the images alone"

    def quantity(self, images):
        """Stated height of the camera above the mean ground, m."""
        return images.start_centre[:, 2] - images.ground
