"""How the images of a block moved, with all that is uncertain of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, diags_array, eye_array
from scipy.spatial.transform import Rotation

from corridor.core.block import Block
from corridor.core.effects import Images
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.preparation import (
    Prepared,
    derived,
    prepare,
    record_derived,
    rounding,
    strips_of,
)

_VELOCITY, _SIGMA = ("vx", "vy", "vz"), ("svx", "svy", "svz")
# Drones brake and speed up by 2 to 3 m/s^2; where between two photographs, nobody knows.
_BRAKING_M_S2 = 3.0
_ANY_BRAKING = _BRAKING_M_S2 / np.sqrt(12)
# A speed that changed by less than this was not braked.
_STEADY_M_S = 0.5
# Photographs further apart than this say nothing of the acceleration.
_NEAR_S = 5.0
# Stamps in whole seconds make steps of nothing.
_LEAST_STEP_S = 0.5
# Of angular rates that are given, rad/s.
_GYRO = np.radians(0.02)
# The speed a flight controller writes, and positions of a receiver, come up to 0.3 s late.
DELAY_S = 0.2
# Steps in which speeds are written, m/s.
_STEPS = (1.0, 0.1, 0.01)
_LEAST_SIGMA = 0.03
# An interval so many times the usual one is a pause, which is no part of any rhythm.
_PAUSE = 3.0
# What it costs to leave a stamp, beside what it costs to change the interval: settles ties only.
_STAY = 0.01


@dataclass(frozen=True)
class Motion:
    """What is known of how the images moved, in the order of images.csv.

    velocity, sigma (m, 3) m/s; sigma: of what is stated. acceleration, acceleration_sigma (m, 3)
    m/s^2; turning (m, 3) rad/s, camera frame: standard deviation of the angular rate. delay_s:
    standard deviation of the delay with which all velocities were written. stretched (k, m, 3)
    m/s: what an error of one sigma of the interval of each strip does, where stamps are rounded.
    source: what the velocities are from, for a reader; given: they stood in images.csv; measured:
    they were given, or come from a receiver's own epochs.
    """

    velocity: np.ndarray
    sigma: np.ndarray
    acceleration: np.ndarray
    acceleration_sigma: np.ndarray
    turning: np.ndarray
    delay_s: float
    stretched: np.ndarray
    source: str
    given: bool
    measured: bool

    @property
    def independent(self) -> np.ndarray:
        """Standard deviation (m, 3), m/s, of what images do not share."""
        return np.hypot(self.sigma, self.delay_s * self.acceleration_sigma)

    @property
    def shared(self) -> np.ndarray:
        """Errors (k, m, 3), m/s, of one sigma each, that images share; the delay is the first."""
        return np.concatenate([-self.delay_s * self.acceleration[None], self.stretched])

    def rows(self, order: np.ndarray) -> Motion:
        """The same of images in another order."""
        names = ("velocity", "sigma", "acceleration", "acceleration_sigma", "turning")
        mine = {name: getattr(self, name)[order] for name in names}
        return replace(self, stretched=self.stretched[:, order], **mine)


def motion_of(block: Block) -> Motion:
    """The motion of the images of a prepared block.

    Raises InputError without velocities, and where rates.csv leaves images out.
    """
    velocity = np.stack([block.column("images", axis) for axis in _VELOCITY], axis=1)
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
    sigma = np.stack([block.column("images", axis) for axis in _SIGMA], axis=1)
    origin = {one.column: one.source for one in derived(block)}.get("images.vx")
    steps = [s for s in _STEPS if np.allclose(velocity / s, np.round(velocity / s), atol=1e-6)]
    written = max(steps[0] / np.sqrt(12), _LEAST_SIGMA) if steps else _LEAST_SIGMA
    sigma = np.where(np.isfinite(sigma), sigma, written)
    acceleration, uncertain = _accelerations(block, velocity)
    return Motion(
        velocity=velocity,
        sigma=sigma,
        acceleration=acceleration,
        acceleration_sigma=uncertain,
        turning=_turning(block),
        delay_s=DELAY_S,
        stretched=_stretched(block, velocity) if origin else np.zeros((0, *velocity.shape)),
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


def with_velocities(block: Block) -> Prepared:
    """The block prepared; where stamps are rounded, by times as regular as those allow.

    Velocities are then those of the positions at the regular times, whose scatter says how good
    they are; the stamps stay as they were given.
    """
    time = block.column("images", "time_s").copy()
    step = rounding(time)
    named = all(block.has(f"images.{axis}") for axis in _VELOCITY)
    if named or len(block.track) or not step or not np.isfinite(time).all():
        return prepare(block)
    regular = block.copy()
    for path, _, _ in _neighbours(block):
        time[path] = unrounded(time[path], step)
    place = np.stack([block.column("images", axis) for axis in "xyz"], axis=1)
    if len(block.gnss):
        rows = block.image_rows("gnss")
        known = rows >= 0
        place[rows[known]] = block.gnss[["x", "y", "z"]].to_numpy(float)[known]
    regular.gnss = regular.gnss.iloc[:0]
    regular.images = regular.images.assign(time_s=time, **dict(zip("xyz", place.T, strict=True)))
    found = prepare(regular)
    columns = [c for c in (*_VELOCITY, *_SIGMA) if c in found.block.images]
    if len(columns) < 6:
        return prepare(block)
    made = block.copy()
    made.images = made.images.assign(**{c: found.block.images[c].to_numpy() for c in columns})
    source = "gnss.csv" if len(block.gnss) else "the poses of images.csv"
    sigma = made.images[list(_SIGMA)].to_numpy(float)
    text = (
        f"Velocities are derived from {source}, at times as regular as the rounded stamps allow: "
        f"sigma {np.median(sigma):.2g} m/s (median), {sigma.max():.2g} m/s (largest)."
    )
    for axis in _VELOCITY:
        record_derived(made, f"images.{axis}", source, sigma, text)
    return prepare(made)


def unrounded(stamps: np.ndarray, step: float) -> np.ndarray:
    """Times (n,) s within half a rounding step of sorted stamps, as regular as they can be.

    A timer, or a steady flight past even distances, makes even intervals: of all times that
    stamps of `step` seconds allow, these change their interval least, by the sum of amounts, but
    for pauses. A constant offset stays: whether a camera rounds or cuts off is unknown. The stamps
    themselves where there are fewer than three.
    """
    stamps = np.asarray(stamps, dtype=float)
    count = len(stamps)
    if count < 3:
        return stamps
    interval = np.diff(stamps)
    usual = max(float(np.mean(interval[interval <= _PAUSE * np.median(interval) + step])), 0.1)
    pause = interval > _PAUSE * usual + step
    weight = np.where(pause[1:] | pause[:-1], 0.0, 1.0)
    since = stamps - stamps[0]
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    order = diags_array([1.0, -1.0], offsets=[0, 1], shape=(count - 1, count))
    one, other = eye_array(count - 2), eye_array(count)
    # |bend t| and |t - stamp| are below what is to become small; times stand in order.
    rows = block_array(
        [
            [bend, -one, None], [-bend, -one, None],
            [other, None, -other], [-other, None, -other],
            [order, None, None],
        ]
    )  # fmt: skip
    most = np.concatenate(
        [np.zeros(2 * (count - 2)), since, -since, np.full(count - 1, -0.05 * step)]
    )
    cost = np.concatenate([np.zeros(count), weight, np.full(count, _STAY)])
    bounds = [(t - step / 2, t + step / 2) for t in since] + [(0, None)] * (2 * count - 2)
    found = linprog(cost, A_ub=rows.tocsc(), b_ub=most, bounds=bounds, method="highs")
    return found.x[:count] + stamps[0] if found.success else stamps


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
    """Angular rates (m, 3) that the attitudes of neighbours show, the larger of both sides."""
    sigma = np.zeros((len(block.images), 3))
    given = np.stack([block.column("images", axis) for axis in ("wx", "wy", "wz")], axis=1)
    turns = np.stack([block.column("images", axis) for axis in ("qw", "qx", "qy", "qz")], axis=1)
    rotation = rotation_from_quaternion(turns)
    for rows, step, near in _neighbours(block):
        between = rotation[rows[1:]] @ rotation[rows[:-1]].transpose(0, 2, 1)
        rate = np.where(near, np.abs(Rotation.from_matrix(between).as_rotvec()) / step, 0.0)
        sigma[rows] = np.maximum(*_both_sides(rate))
    return np.where(np.isfinite(given), _GYRO, sigma)


def _stretched(block: Block, velocity: np.ndarray) -> np.ndarray:
    """What rounded stamps leave of each strip's duration: one rounding error over it."""
    step = rounding(block.column("images", "time_s"))
    if not step:
        return np.zeros((0, *velocity.shape))
    time = block.column("images", "time_s")
    out = []
    for _, rows in strips_of(block):
        mine = np.zeros_like(velocity)
        mine[rows] = velocity[rows] * step / np.sqrt(12) / max(np.ptp(time[rows]), step)
        out.append(mine)
    return np.array(out)
