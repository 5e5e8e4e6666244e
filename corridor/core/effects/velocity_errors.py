"""What velocities are off while rows are read: each by itself, and all together.

They stand beside an effect that moves the camera by the velocity of its image, never alone, and
are not in the catalogue: `corridor.adjustment` adds them where a block says that its velocities
are uncertain, with the priors that follow from how uncertain they are.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter

# Columns of images.csv: standard deviations, m/s and rad/s, and a common error of one sigma, m/s.
VELOCITY_SIGMA, RATE_SIGMA = ("svx", "svy", "svz"), ("swx", "swy", "swz")
COMMON = ("dvx", "dvy", "dvz")


class OwnVelocityError(LinearEffect):
    """Each image moves, and with `turns` turns, by an amount of its own."""

    slug = "own_velocity_error"
    title = "What the velocity of each image is off"
    called = "errors of the velocities"
    place = "motion"
    group = "image"
    generic = True
    searched = False
    turns = False

    def parameters(self, block):
        moved = [Parameter(axis, "m", scale=0.01) for axis in "xyz"]
        turned = [Parameter(f"turn_{axis}", "rad", scale=1e-4) for axis in "xyz"]
        return moved + (turned if self.turns else [])

    def derivative(self, context):
        """Centre (world) and rotation (camera frame) by values s; the row s from -1/2 to 1/2."""
        return context.row[:, None, None] * np.eye(6, 6 if self.turns else 3)


class CommonVelocityError(LinearEffect):
    """All images move by one number times the common error of their velocities."""

    slug = "common_velocity_error"
    title = "What all velocities are off together"
    called = "a common error of the velocities"
    place = "motion"
    generic = True
    searched = False
    needs = tuple(f"images.{axis}" for axis in COMMON)
    unknowns = [Parameter("seconds", "s", scale=0.03, text="readout time, times sigmas")]

    def derivative(self, context):
        """Centre by dv s, with dv the error of one sigma (world) and the row s from -1/2 to 1/2."""
        derivative = np.zeros((len(context), 6, 1))
        common = np.nan_to_num(context.images.velocity_error[context.image])
        derivative[:, :3, 0] = common * context.row[:, None]
        return derivative
