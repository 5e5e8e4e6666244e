"""The boresight follows the temperature: the mount of the camera bends as it warms.

Source: Skaloud and Lichti 2006 (stability of the boresight), linear in temperature.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class BoresightByTemperature(LinearEffect):
    slug = "boresight_by_temperature"
    title = "Boresight that follows the temperature"
    called = "a turn of the measured attitudes against the camera with the temperature"
    place = "attitude"
    needs = ("attitudes.image", "images.temperature_c")
    revealed_by = "temperatures that go up and down while attitudes are measured"
    unobservable_when = "the temperature only rises: a drift with time does the same"
    # Half a degree over the 20 degrees of a flight; rad/C about the camera's axes.
    unknowns = [Parameter(axis, "rad/C", scale=np.radians(0.5) / 20) for axis in "xyz"]

    def derivative(self, context):
        """A turn about the camera's axes with the temperature T from the block's middle: r T."""
        return np.eye(3) * (context.temperature - context.images.mid_temperature)[:, None, None]
