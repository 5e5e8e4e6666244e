"""Small blocks with a known truth, for the diagnosis's tests."""

from dataclasses import replace

import numpy as np
from strips import corridor_block

import corridor
from corridor.core.effects import add
from corridor.core.simulation import CAMLIGHT, add_noise

NOISE = {"tie_px": 0.3, "mark_px": 0.3, "gnss_m": 0.010, "control_m": 0.004}


def flown(
    effects=None, noise=None, seed=1, calibrated=False, constants=None, apart=False, **options
):
    """36 images in two flights at two heights, warming up; effects and noise on top.

    apart: control and check points are of two surveys.
    """
    options = {
        "images": 36,
        "strips": 4,
        "flights": 2,
        "height": (45.0, 55.0, 45.0, 55.0),
    } | options
    block = corridor_block(
        observations_per_image=90, control=5, check=4, seed=seed, relief=6.0,
        camera=replace(CAMLIGHT, calibrated=calibrated), turned=False, **options,
    )  # fmt: skip
    if constants:
        block.extra["effect"] = constants
    if apart:
        block.ground["group"] = block.ground["role"]
    count = len(block.images)
    block.images["temperature_c"] = 25 + 8 * np.sin(np.arange(count) / 5)
    return add_noise(add(block, effects or {}), **(NOISE | (noise or {})), seed=seed)


def believed(block, *effects, **options):
    """Adjusted with ten camera parameters, or none where the camera is calibrated."""
    calibrated = all(camera.calibrated for camera in block.cameras.values())
    # As in a diagnosis: what contradicts the stated noise is not taken into it.
    options = {"camera": "fixed" if calibrated else "fraser10", "weights": "stated"} | options
    return corridor.adjust(block, effects=effects, **options)
