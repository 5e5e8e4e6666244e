"""Velocities that are known badly are not called those of other images."""

import numpy as np
from strips import corridor_block

from corridor.core.preparation import velocity_warnings


def flown(sigma):
    """Two of four images have a velocity across their way; all are good to sigma, m/s, if any."""
    block = corridor_block(images=24, strips=2, observations_per_image=20, seed=1).copy()
    velocity = block.numbers("images", "vx", "vy", "vz")
    wrong = np.arange(len(velocity)) % 4 < 2
    velocity[wrong] = velocity[wrong][:, [1, 0, 2]] * [1.0, -1.0, 1.0]
    block.put("images", ("vx", "vy", "vz"), velocity)
    if sigma is not None:
        block.put("images", ("svx", "svy", "svz"), np.full(velocity.shape, sigma))
    return block


def test_velocities_across_the_way_are_told_where_they_are_good():
    for sigma in (None, 0.05):
        (told,) = velocity_warnings(flown(sigma))
        assert "point elsewhere than the way from image to image" in told


def test_those_of_some_metres_a_second_are_not():
    assert not velocity_warnings(flown(5.0))
