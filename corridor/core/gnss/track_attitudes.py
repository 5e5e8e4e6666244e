"""Attitudes of a track at the moments of exposure: the table attitudes.csv of a block."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from corridor.core.block import ANGLE_SIGMAS, ANGLES, QUATERNION
from corridor.core.geometry import (
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_roll_pitch_yaw,
    rotation_from_vector,
    vector_from_rotation,
)
from corridor.core.gnss.coordinates import Local
from corridor.core.gnss.track import Track

# Between epochs a turn is taken as even. A drone turns by up to 100 degrees a second per second: it
# is then off by an eighth of that by the square of the step, 0.03 degrees here; log at 20 Hz.
_STEP_S = 0.05
_ROUNDED_S = 1e-6
# A way over the ground by which north and east of a place are seen in other coordinates, degrees.
_WAY_DEG = 1e-4


def stated(track: Track) -> bool:
    """Whether the track has roll, pitch and yaw."""
    return set(ANGLES[0]) <= set(track.table)


def attitudes_at(
    track: Track, images: np.ndarray, time: np.ndarray, axes: np.ndarray
) -> pd.DataFrame:
    """image, qw, qx, qy, qz (world to a camera that looks down, the top of its picture forward),
    and the sigmas that the track states; images between epochs too far apart are left out.

    images: names (n,). time: (n,), s, of the track. axes: (n, 3, 3), columns east, north, up at
    each image in the coordinates of the block, in which the attitudes come.
    """
    table = track.table
    epoch = table["time_s"].to_numpy(float)
    later = np.clip(np.searchsorted(epoch, time), 1, len(epoch) - 1)
    step = epoch[later] - epoch[later - 1]
    part = (time - epoch[later - 1]) / step
    angles = table[list(ANGLES[0])].to_numpy(float)
    one, other = (rotation_from_roll_pitch_yaw(angles[k], "body") for k in (later - 1, later))
    turn = vector_from_rotation(other @ one.transpose(0, 2, 1))
    rotation = rotation_from_vector(part[:, None] * turn) @ one @ axes.transpose(0, 2, 1)
    found = pd.DataFrame({"image": images})
    found[list(QUATERNION)] = quaternion_from_rotation(rotation)
    if set(ANGLE_SIGMAS) <= set(table):
        sigma = table[list(ANGLE_SIGMAS)].to_numpy(float)
        found[list(ANGLE_SIGMAS)] = np.maximum(sigma[later - 1], sigma[later])
    inside = (part >= 0) & (part <= 1) & (step <= _STEP_S + _ROUNDED_S)
    known = np.isfinite(rotation).all(axis=(1, 2))
    return found[inside & known].reset_index(drop=True)


def axes_at(points: np.ndarray, own: Local | None, to_block: Callable) -> np.ndarray:
    """Columns east, north, up (n, 3, 3) at points (n, 3) in the coordinates of a block.

    own: the frame of the points; None: it has no place in the world, and y is north. to_block:
    from that frame to the block's.
    """
    if own is None:
        return np.broadcast_to(np.eye(3), (len(points), 3, 3))
    here = own.to_geographic(points)
    ways = _WAY_DEG * np.eye(3)[:, None] * np.ones((len(points), 1))
    ways[0, :, 0] /= np.cos(np.radians(here[:, 1]))
    ways[2] *= 111_195.0  # metres of a degree
    start = to_block(points)
    away = np.stack([to_block(own.from_geographic(here + way)) - start for way in ways], axis=2)
    return nearest_rotation(away / np.linalg.norm(away, axis=1, keepdims=True))
