"""How the images of a block moved, and what of it the adjustment is to doubt."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from corridor.core.block import VELOCITY, Block
from corridor.core.effects import COMMON, RATE_SIGMA, VELOCITY_SIGMA, Images
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.preparation import derived, rounding

# Drones brake and speed up by 2 to 3 m/s^2; where between two photographs, nobody knows.
_BRAKING_M_S2 = 3.0
_ANY_BRAKING = _BRAKING_M_S2 / np.sqrt(12)
# A speed that changed by less than this was not braked.
_STEADY_M_S = 0.5
# Photographs further apart than this say nothing of the acceleration.
_NEAR_S = 5.0
# Stamps in whole seconds make steps of nothing.
_LEAST_STEP_S = 0.5
# The speed a flight controller writes comes up to 0.3 s late.
DELAY_S = 0.2
# Steps in which speeds are written, m/s.
_STEPS = (1.0, 0.1, 0.01)
# What the receiver of a small drone knows of its velocity, m/s (u-blox NEO-M8 data sheet).
_RECEIVER_M_S = 0.05
# How fast a gimbal shakes, rad/s: by 0.02 degrees (specification of DJI's Phantom 4) five times a
# second; and what the rates of a gyroscope are good to.
_SHAKEN, _GYRO = np.radians(0.02) * 2 * np.pi * 5.0, np.radians(0.02)


@dataclass(frozen=True)
class Motion:
    """What is known of how the images moved, in the order of images.csv.

    velocity, sigma (m, 3) m/s; turning (m, 3) rad/s, camera frame: standard deviation of what the
    angular rate is off; common (m, 3) m/s: an error of one sigma that all velocities share: they
    were written late by DELAY_S, or a drone brakes between two positions. source: what the
    velocities are from, for a reader; given: they stood in images.csv; measured: they were given,
    or come from a receiver's own epochs.
    """

    velocity: np.ndarray
    sigma: np.ndarray
    turning: np.ndarray
    common: np.ndarray
    source: str
    given: bool
    measured: bool

    def on(self, block: Block) -> Block:
        """The block with what is to be doubted, as `corridor.adjust` takes it."""
        block = block.copy()
        block.put("images", VELOCITY_SIGMA, self.sigma)
        block.put("images", RATE_SIGMA, self.turning)
        block.put("images", COMMON, self.common)
        return block


def motion_of(block: Block) -> Motion:
    """The motion of the images of a prepared block.

    Raises InputError without velocities, and where rates.csv leaves images out.
    """
    velocity = block.numbers("images", *VELOCITY)
    if not np.isfinite(velocity).all():
        lost = int((~np.isfinite(velocity).all(axis=1)).sum())
        raise InputError(
            f"{lost} of {len(velocity)} images have no velocity, and none can be derived: give "
            "time_s with gnss.csv or track.csv, or vx, vy, vz in images.csv"
        )
    gyroscope = Images.of(block).gyroscope
    unheard = 0 if gyroscope is None else int((gyroscope.record_of_image < 0).sum())
    if unheard:
        raise InputError(
            f"rates.csv: {unheard} of {len(velocity)} images have no record of how the camera "
            "turned: add theirs, remove these images, or remove rates.csv"
        )
    origin = {one.column: one.source for one in derived(block)}.get("images.vx")
    sigma = block.numbers("images", *VELOCITY_SIGMA)
    common = np.nan_to_num(block.numbers("images", *COMMON))
    if origin is None:
        steps = [s for s in _STEPS if np.allclose(velocity / s, np.round(velocity / s), atol=1e-6)]
        written = np.hypot(_RECEIVER_M_S, (steps[0] if steps else 0.0) / np.sqrt(12))
        acceleration, uncertain = _accelerations(block, velocity)
        sigma = np.hypot(np.where(np.isfinite(sigma), sigma, written), DELAY_S * uncertain)
        common = common - DELAY_S * acceleration
    return Motion(
        velocity=velocity,
        sigma=np.where(np.isfinite(sigma), sigma, _RECEIVER_M_S),
        turning=_turning(block),
        common=common,
        source=f"derived from {origin}" if origin else "given (vx, vy, vz)",
        given=origin is None,
        measured=origin in (None, "track.csv"),
    )


def on_one_clock(block: Block) -> tuple[Block, list[str]]:
    """The block without rates.csv where rounded stamps do not find its epochs, and a sentence.

    A record of each image's own was cut around that image, whatever its stamp says.
    """
    step = rounding(block.column("images", "time_s"))
    if not step or not len(block.rates) or block.has("rates.image"):
        return block, []
    block = block.copy()
    block.rates = block.rates.iloc[:0]
    return block, [
        f"The images have time stamps of {step:g} s, which do not say where in rates.csv they "
        "were taken: the rotations of the camera are left out."
    ]


def _neighbours(block: Block) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows of each flight and camera in order of time; steps (n - 1, 1) s; whether they are near.

    Nothing where an image has no time.
    """
    time = block.column("images", "time_s")
    if not np.isfinite(time).all():
        return
    paths = np.stack([block.image_flight, block.images["camera"].astype("category").cat.codes], 1)
    for path in np.unique(paths, axis=0):
        rows = np.flatnonzero((paths == path).all(axis=1))
        rows = rows[np.argsort(time[rows], kind="stable")]
        step = np.diff(time[rows])[:, None]
        yield rows, np.maximum(step, _LEAST_STEP_S), step < _NEAR_S


def _both_sides(steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What lies between neighbours (n - 1, 3), before and after each image (n, 3)."""
    nothing = np.zeros((1, *steps.shape[1:]), steps.dtype)
    return np.concatenate([nothing, steps]), np.concatenate([steps, nothing])


def _accelerations(block: Block, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration and its standard deviation (m, 3), m/s^2, from the images before and after."""
    value, sigma = np.zeros_like(velocity), np.full_like(velocity, _ANY_BRAKING)
    for rows, step, near in _neighbours(block):
        change = np.diff(velocity[rows], axis=0)
        rate = np.where(near, np.clip(change / step, -_BRAKING_M_S2, _BRAKING_M_S2), 0.0)
        before, after = _both_sides(rate)
        value[rows] = (before + after) / 2
        braked = np.logical_or(*_both_sides(np.abs(change) > _STEADY_M_S))
        least = np.where(braked, _ANY_BRAKING, 0.0)
        sigma[rows] = np.maximum(least, np.abs(before - after) / 2)
    return value, sigma


def _turning(block: Block) -> np.ndarray:
    """What angular rates (m, 3) are off: all of them, by the attitudes of neighbours on the side
    that turned more and by what a gimbal shakes; or what a gyroscope leaves open."""
    sigma = np.zeros((len(block.images), 3))
    given = block.numbers("images", "wx", "wy", "wz")
    rotation = rotation_from_quaternion(block.numbers("images", "qw", "qx", "qy", "qz"))
    for rows, step, near in _neighbours(block):
        between = rotation[rows[1:]] @ rotation[rows[:-1]].transpose(0, 2, 1)
        rate = np.where(near, np.abs(Rotation.from_matrix(between).as_rotvec()) / step, 0.0)
        sigma[rows] = np.maximum(*_both_sides(rate))
    return np.where(np.isfinite(given), _GYRO, np.hypot(sigma, _SHAKEN))
