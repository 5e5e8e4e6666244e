"""Seven-parameter similarity between two sets of points, and check-point statistics.

Source of the similarity: Umeyama 1991, IEEE PAMI 13(4), eqs 34 to 43 (with weights, after Horn
1987). Source of the statistics: Zhou 2019, tables 4.2, 4.3, 5.3 and 7.4 to 7.15.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from corridor.errors import InputError

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
        raise InputError("a similarity needs one weight for each point, none of them negative")
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


class Parts(NamedTuple):
    """One statistic in planimetry, altimetry and space, metres."""

    xy: float
    z: float
    d3: float


class CheckStatistics(NamedTuple):
    """RMS, mean and STD of check-point differences, each a Parts."""

    rms: Parts
    mean: Parts
    std: Parts


def check_table(differences: np.ndarray) -> CheckStatistics:
    """RMS, mean and STD of check-point differences, as the tables of Zhou 2019 have them.

    differences: (n, 3), adjusted minus given, metres; rows with NaN do not count.

    xy and 3D are statistics of the *lengths* sqrt(dx^2 + dy^2) and sqrt(dx^2 + dy^2 + dz^2), z of
    the signed dz. RMS is about zero, STD unbiased about the mean (NaN for fewer than two points).
    The mean in xy and 3D is therefore a mean length and never negative; it is not the length of the
    mean vector. Zhou 2019 does not write this definition down; its figures leave no other: in
    table 4.3 (translation, case a) the STD are 0.62 (xy), 2.50 (z) and 1.51 cm (3D), and 3D could
    not be below z if it were summed over components; in tables 7.4 to 7.7 only z has negative
    means, and RMS^2 = mean^2 + (n - 1)/n STD^2 holds within the rounding for all three.
    """
    differences = np.asarray(differences, dtype=float).reshape(-1, 3)
    differences = differences[np.isfinite(differences).all(1)]
    if len(differences) == 0:
        nothing = Parts(np.nan, np.nan, np.nan)
        return CheckStatistics(nothing, nothing, nothing)
    values = np.column_stack(
        [
            np.hypot(differences[:, 0], differences[:, 1]),
            differences[:, 2],
            np.linalg.norm(differences, axis=1),
        ]
    )
    rms = np.sqrt(np.mean(values**2, axis=0))
    mean = values.mean(axis=0)
    std = values.std(axis=0, ddof=1) if len(values) > 1 else np.full(3, np.nan)
    return CheckStatistics(*(Parts(*map(float, row)) for row in (rms, mean, std)))


class Checked:
    """Statistics of `check_points`, a table with dx, dy, dz (adjusted minus given, metres)."""

    @cached_property
    def _check(self) -> CheckStatistics:
        return check_table(self.check_points[["dx", "dy", "dz"]].to_numpy(float))

    @property
    def check_rms(self) -> Parts:
        """RMS about zero of the check points: xy, z, d3, metres."""
        return self._check.rms

    @property
    def check_mean(self) -> Parts:
        """Mean of the check points: xy, z, d3, metres."""
        return self._check.mean

    @property
    def check_std(self) -> Parts:
        """Unbiased standard deviation of the check points about their mean: xy, z, d3, metres."""
        return self._check.std
