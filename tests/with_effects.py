"""Small blocks on which every effect shows, and values of the size that each states."""

from dataclasses import replace
from functools import cache

import numpy as np
from rigged import rig_table, rigged_block
from strips import CAMLIGHT, corridor_block

from corridor.core.effects import every_effect
from corridor.core.effects.forward import gather

# Those of distances are tested with them, in test_distances.
EVERY = [effect.slug for effect in every_effect() if effect.place != "distance"]
OF_RIGS = [effect.slug for effect in every_effect() if effect.needs[:1] == ("rig.member",)]
ONE = [slug for slug in EVERY if slug not in OF_RIGS]


def flown(slugs=(), **options):
    """One camera, or for effects of rigs a head of three."""
    if not set(slugs) & set(OF_RIGS):
        return _flown(**options).copy()
    block = _head().copy()
    if not any(effect.believed(block) for effect in every_effect() if effect.slug in slugs):
        # How the cameras hang is known exactly.
        block.extra["rig"] = rig_table(sigma_m=0.0, sigma_deg=0.0)
    return block


@cache
def _head():
    block = rigged_block(exposures=4, points=220)
    rng = np.random.default_rng(2)
    time = block.images["time_s"].to_numpy()
    block.images[["vx", "vy", "vz"]] = rng.normal([6.0, 0.5, 0.1], 1.0, (len(time), 3))
    block.images[["wx", "wy", "wz"]] = 0.05 * rng.standard_normal((len(time), 3))
    block.images["temperature_c"] = 25 + 10 * np.sin(time)
    return measured_by_imu(block)


def measured_by_imu(block):
    """With attitudes whose boresight is known."""
    block.extra["attitudes"] = {"calibrated": True}
    block.attitudes = block.images[["image", "qw", "qx", "qy", "qz"]]
    return block.with_()


@cache
def _flown(images=10, observations=60, seed=8, **options):
    camera = replace(CAMLIGHT, readout_s=0.030, calibrated=True)
    block = corridor_block(
        images=images, strips=2, flights=2, camera=camera, observations_per_image=observations,
        relief=6.0, interval_s=1.0, angular_rate_deg_s=3.0, seed=seed, **options,
    )  # fmt: skip
    block.extra["effect"] = {"water_refraction": {"level": 1.0}}
    return measured_by_imu(block)


def at_scale(block, slugs):
    """Values (groups, parameters) of every effect, of the size it states, signs mixed."""
    rng = np.random.default_rng(1)
    stack, start = gather(block, {slug: {} for slug in slugs})
    return {
        slug: rng.uniform(0.5, 1.5, start[slug].shape)
        * rng.choice([-1, 1], start[slug].shape)
        * [parameter.scale for parameter in stack.members[slug].parameters]
        for slug in slugs
    }


def started(problem, values):
    """The problem's start state with effects switched on; images are in the problem's order."""
    state = problem.start
    for slug, given in values.items():
        own = problem.stack.members[slug].effect.group == "image"
        state.effects[slug][:] = given[problem.order] if own else given
    return state
