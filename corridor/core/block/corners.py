"""Where on the ground the corners of each picture lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from corridor.core.camera import undistort
from corridor.core.geometry import rotation_from_quaternion

if TYPE_CHECKING:
    from corridor.core.block.block import Block


def corner_rays(block: Block) -> np.ndarray:
    """Directions (images, 4, 3), world, of the corners of each picture; z of the camera is 1.

    From the top left corner clockwise; NaN where the pose is not known.
    """
    rays = {}
    for name, camera in block.cameras.items():
        right, low = camera.width - 1.0, camera.height - 1.0
        corner = np.array([[0.0, 0.0], [right, 0.0], [right, low], [0.0, low]])
        rays[name] = np.column_stack([undistort(corner, camera.interior), np.ones(4)])
    corners = np.stack([rays[name] for name in block.images["camera"].astype(str)])
    return np.einsum("nij,nci->ncj", rotation_from_quaternion(block.poses[:, 3:]), corners)


def footprints(block: Block, level: float | np.ndarray) -> np.ndarray:
    """Corners (images, 4, 3), m, of each picture on a level plane; NaN where a ray misses it.

    level: height of the plane, m; one number or one an image.
    """
    pose, away = block.poses, corner_rays(block)
    level = np.broadcast_to(np.asarray(level, dtype=float), len(pose))[:, None]
    fall = np.where(away[:, :, 2] < -0.05, away[:, :, 2], np.nan)
    reach = (level - pose[:, None, 2]) / fall
    return pose[:, None, :3] + reach[:, :, None] * away
