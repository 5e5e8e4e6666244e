"""Rotations from world to camera: matrices, quaternions qw qx qy qz, vectors, angles.

COLMAP's order and sense of the quaternion.
"""

import warnings

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


def angles_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """omega, phi, kappa (n, 3), degrees, of rotations (n, 3, 3): undoes the above."""
    return Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True)


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotations (..., 3, 3) nearest to matrices, never reflections."""
    u, _, vt = np.linalg.svd(matrix)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Vectors (n, 3), radians and at most a half turn long, of rotations (n, 3, 3)."""
    return Rotation.from_matrix(rotation).as_rotvec()


def right_jacobian(vector: np.ndarray) -> np.ndarray:
    """J (n, 3, 3) of rotations by vectors (n, 3): Exp(t + q) = Exp(t) Exp(J q) of a small q.

    Source: Solà, Deray and Atchuthan 2018, "A micro Lie theory", eq. 143.
    """
    t = np.asarray(vector, dtype=float)
    a = np.linalg.norm(t, axis=-1)[:, None, None]
    small = a < 1e-4
    a = np.where(small, 1.0, a)
    one = np.where(small, 0.5, (1.0 - np.cos(a)) / a**2)
    two = np.where(small, 1.0 / 6.0, (a - np.sin(a)) / a**3)
    k = skew(t)
    return np.eye(3) - one * k + two * (k @ k)


def skew(vector: np.ndarray) -> np.ndarray:
    """[v]x (n, 3, 3), with [v]x w the vector product of v and w."""
    v = np.asarray(vector, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


# Camera in the frame (x right, y forward, z up) that roll, pitch and yaw turn: looking down with
# the top of the picture forward, or looking forward.
_MOUNTED = {
    "body": np.diag([1.0, -1.0, -1.0]),
    "camera": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}


def rotation_from_roll_pitch_yaw(angles: np.ndarray, frame: str) -> np.ndarray:
    """Rotations (n, 3, 3), world to camera, of roll, pitch, yaw (n, 3), degrees.

    Of a frame x right, y forward, z up: yaw from world y over x, then pitch, nose up, then roll,
    right side down. frame: `body`, which carries the camera looking down, the top of the picture
    forward; `camera`, which looks forward (a gimbal: a pitch of -90 degrees looks down).
    Source: ARINC 705 (order and sense of the angles).
    """
    roll, pitch, yaw = np.asarray(angles, dtype=float).T
    turned = Rotation.from_euler("ZXY", np.stack([-yaw, pitch, roll], axis=1), degrees=True)
    return _MOUNTED[frame] @ turned.as_matrix().transpose(0, 2, 1)


def roll_pitch_yaw_from_rotation(rotation: np.ndarray, frame: str) -> np.ndarray:
    """Roll, pitch, yaw (n, 3), degrees, yaw from 0 to 360: undoes the above.

    Of a frame that points straight up or down roll is zero.
    """
    turned = Rotation.from_matrix((_MOUNTED[frame].T @ rotation).transpose(0, 2, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # roll and yaw are one there
        yaw, pitch, roll = turned.as_euler("ZXY", degrees=True).T
    return np.stack([roll, pitch, -yaw % 360.0], axis=1)
