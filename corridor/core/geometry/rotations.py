"""Rotations from world to camera: matrices, quaternions qw qx qy qz, vectors, angles.

COLMAP's order and sense of the quaternion.
"""

import numpy as np
from scipy.spatial.transform import Rotation


def rotation_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3), world to camera, of quaternions qw qx qy qz (n, 4) of any length > 0.

    NaN where a quaternion has one.
    """
    q = np.asarray(quaternion, dtype=float)
    known = np.isfinite(q).all(axis=-1)[..., None]
    matrix = Rotation.from_quat(np.where(known, q, 1.0), scalar_first=True).as_matrix()
    return np.where(known[..., None], matrix, np.nan)


def quaternion_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions qw qx qy qz (n, 4) with qw >= 0 of rotations (n, 3, 3); NaN of NaN."""
    r = np.asarray(rotation, dtype=float)
    known = np.isfinite(r).all(axis=(-1, -2))[..., None]
    found = Rotation.from_matrix(np.where(known[..., None], r, np.eye(3)))
    return np.where(known, found.as_quat(canonical=True, scalar_first=True), np.nan)


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) about the vectors (n, 3), radians (Rodrigues)."""
    return Rotation.from_rotvec(np.asarray(vector, dtype=float)).as_matrix()


def rotation_from_angles(omega: float, phi: float, kappa: float) -> np.ndarray:
    """Rx(omega) Ry(phi) Rz(kappa), (3, 3), of angles in degrees, as aerial photogrammetry has it.

    Which frames it joins is the file's: most often camera (y up, z back) to world.
    """
    return Rotation.from_euler("XYZ", [omega, phi, kappa], degrees=True).as_matrix()


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) nearest to a matrix, never a reflection."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
