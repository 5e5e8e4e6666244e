"""The measured attitude lags behind the camera's, about each axis by a time of its own.

A gimbal's loops have another bandwidth about each axis; what they report is filtered. For slow
turns a first-order lag is its time constant times the rate.

Source: Franklin, Powell and Emami-Naeini 2015, "Feedback control of dynamic systems", section 4.2
(velocity error of a tracking loop).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class GimbalLag(LinearEffect):
    slug = "gimbal_lag"
    title = "Attitudes that lag behind the camera's turns, axis by axis"
    called = "a lag of the measured attitudes behind the turns of the camera"
    place = "attitude"
    # A lag for each axis in place of one.
    refines = "attitude_clock_offset"
    needs = ("attitudes.image", "images.wx", "images.wy", "images.wz")
    revealed_by = "images that turn about each axis while they are taken, both ways, with rates"
    unobservable_when = (
        "the camera hardly turns; lags that are equal are an offset between the clocks"
    )
    unknowns = [Parameter(axis, "s", scale=0.050) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """About its axis i the attitude is w_i lag_i behind a camera that turns at its rate w."""
        return -np.eye(3) * context.angular_rate[:, :, None]
