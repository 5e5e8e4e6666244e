"""Focal length and principal point follow a curve of temperature that is not a straight line.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.splines import CameraCurve


class CameraByTemperature(CameraCurve):
    slug = "camera_by_temperature"
    title = "Focal length and principal point as smooth curves of temperature"
    called = "a camera that changes with temperature"
    needs = ("images.temperature_c",)
    revealed_by = "a camera whose temperature changes by several degrees, up and down"
    unobservable_when = "the temperature hardly changes, or only as time does"

    def quantity(self, images):
        """Temperature, degrees Celsius."""
        return images.temperature
