"""One dike flown twice: a perfect block, draws of its noise, and what is compared."""

from dataclasses import asdict, replace
from functools import cache

import numpy as np

import corridor
from corridor import effects
from corridor.change import Chosen, Joint, clouds, moved_ground
from corridor.simulation import Noise, TiePoints, add_noise, perfect_block, read_plan

PLAN = "data_synthetic/dike.toml"
NOISE = Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005)


@cache
def perfect(seed=1, per_image=120):
    """The dike of the shipped plan with fewer tie points, without any error."""
    from pathlib import Path

    plan = read_plan(Path(__file__).parents[2] / PLAN)
    return perfect_block(replace(plan, tie_points=TiePoints(per_image)), seed)


def flown(draw, motion=None, added=None, block=None):
    """One flight over the dike, after its ground has moved, with effects of the camera.

    The control is surveyed anew each time.
    """
    block = block or perfect()
    if motion is not None:
        block = moved_ground(block, motion)
    if added:
        block = effects.add(block, added)
    return add_noise(block, **asdict(NOISE), seed=draw)


@cache
def adjusted(draw):
    """A flight over the dike at rest, adjusted."""
    return corridor.adjust(flown(draw))


def joint(first, second, same_ties=True, **options):
    """Both dates with the covariance of all their points."""
    return Joint(*clouds(first, second, Chosen(), same_ties), **options)


def middle():
    """The middle (2,) of the dike, m."""
    return tuple(np.median(perfect().points[["x", "y"]].to_numpy(float), axis=0))
