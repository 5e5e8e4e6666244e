"""Seven-parameter similarity (Helmert transformation) between two sets of points.

Source: Umeyama 1991, IEEE PAMI 13(4), eqs 34 to 43 (with weights, after Horn 1987).
"""

from dataclasses import dataclass

import numpy as np

from corridor.core.errors import InputError

# A line of points leaves the turn about itself open. Coordinates of 1e6 m hold 1e-10 m, so that an
# exact line of 10 m shows a width of 1e-11 of its length; a surveyed one is never below 1e-7.
_LINE = 1e-8


@dataclass(frozen=True)
class Similarity:
    """target = scale rotation source + translation.

    scale: no unit. rotation: (3, 3), determinant +1. translation: (3,), units of the target.
    """

    scale: float
    rotation: np.ndarray
    translation: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points of the source frame in the target frame, (n, 3) or (3,)."""
        return self.scale * np.asarray(points, dtype=float) @ self.rotation.T + self.translation

    def apply_to_rotations(self, rotations: np.ndarray) -> np.ndarray:
        """Rotations source to camera, (n, 3, 3), as rotations target to camera."""
        return np.asarray(rotations, dtype=float) @ self.rotation.T

    def inverse(self) -> "Similarity":
        """The similarity from target to source."""
        back = self.rotation.T / self.scale
        return Similarity(1.0 / self.scale, self.rotation.T, -back @ self.translation)


def similarity(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None
) -> Similarity:
    """Similarity that takes source to target with the least weighted sum of squares.

    source, target: (n, 3), one point a row; rows with an unknown (NaN) coordinate do not count.
    weights: (n,), one over variance, 0 leaves a point out; default: all alike.
    The rotation is proper: mirrored sets get the best turn, never a reflection.
    Raises InputError with fewer than three points, and where they lie on one line.
    Source: Umeyama 1991, eqs 39 to 43.
    """
    source = np.asarray(source, dtype=float)
    target = np.asarray(target, dtype=float)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
        raise InputError(
            "a similarity needs two (n, 3) arrays of the same points, "
            f"not {source.shape} and {target.shape}"
        )
    weights = np.ones(len(source)) if weights is None else np.array(weights, dtype=float)
    if weights.shape != (len(source),) or not np.all(weights >= 0):
        raise InputError("a similarity needs one weight for each point, and none may be negative")
    used = np.isfinite(source).all(1) & np.isfinite(target).all(1) & (weights > 0)
    if used.sum() < 3:
        raise InputError(
            f"a similarity needs at least 3 points known in both frames, there are {used.sum()}"
        )
    source, target, weights = source[used], target[used], weights[used] / weights[used].sum()

    source_mean, target_mean = weights @ source, weights @ target
    from_mean, to_mean = source - source_mean, target - target_mean
    for points in (from_mean, to_mean):
        spread = np.linalg.svd(np.sqrt(weights)[:, None] * points, compute_uv=False)
        if spread[1] <= _LINE * spread[0]:
            raise InputError(
                "the points of a similarity lie on one line: the turn about it is open; "
                "add a point beside the line"
            )
    u, singular, vt = np.linalg.svd(to_mean.T @ (weights[:, None] * from_mean))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = (u * sign) @ vt
    scale = float(singular @ sign / (weights @ (from_mean**2).sum(1)))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def helmert_motions(points: np.ndarray, middle: np.ndarray | None = None) -> np.ndarray:
    """How points (n, 3) move by a small similarity about a middle (default: their mean): (n, 3, 7).

    Columns: shift along x, y, z; turn about x, y, z; growth.
    """
    away = points - (points.mean(axis=0) if middle is None else middle)
    out = np.zeros((len(points), 3, 7))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:6] = np.cross(np.eye(3), away[:, None]).transpose(0, 2, 1)
    out[:, :, 6] = away
    return out


def relative_width(points: np.ndarray) -> float:
    """How far points spread to the side, as a share of their length; 0 on one line."""
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return float(spread[1] / spread[0]) if spread[0] > 0 else 0.0
