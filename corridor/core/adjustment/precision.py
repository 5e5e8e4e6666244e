"""How precise points and poses are among themselves: covariances in a datum of one's choice.

With G the small similarities of everything, C the covariance of everything and B what the datum
says, B' z = 0 (of the points that carry it, or of a photograph and a base),

    C' = S C S',   S = 1 - G (B' G)^-1 B'

is what remains: the same for every datum from which one starts. Of C the blocks that are asked for
are needed, and C B, which is seven solutions of the equations.
Source: Baarda 1973 (S-transformation); James, Robson and Smith 2017 (precision of shape).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.linear_system import motions
from corridor.core.adjustment.regression import point_regression
from corridor.core.errors import InputError
from corridor.core.geometry import helmert_motions

# Of a river's points every so many-th stands for all.
MOST = 100_000
# Times the usual size from which on the error of a point is no part of the datum.
FAR = 10.0


@dataclass(frozen=True)
class InDatum:
    """Covariances for unit weight in a datum; the points that are looked at are `points` (k,).

    on_points (3k, t), on_poses (m d, t): B. middle (3,): about which G turns and grows. scale:
    whether the datum has the scale, too; without, it is that of the measurements (a distance, say).
    """

    covariance: Covariance
    points: np.ndarray
    on_points: np.ndarray
    on_poses: np.ndarray
    middle: np.ndarray
    scale: bool = True

    @classmethod
    def of_points(
        cls, covariance: Covariance, points: np.ndarray, carrying: np.ndarray, scale: bool = True
    ) -> "InDatum":
        """The datum lies on those of the points (k,) that are `carrying` (k,).

        Raises InputError where these points leave a rotation or the scale open.
        """
        xyz = covariance.state.points[points]
        middle = xyz[carrying].mean(axis=0) if carrying.any() else np.zeros(3)
        nothing = np.zeros((0, 0))
        found = cls(covariance, points, nothing, nothing, middle, scale)
        carried = found._moved_points * np.repeat(carrying, 3)[:, None]
        size = np.sqrt(np.einsum("nk,nk->k", carried, carried))
        if not size.all() or np.linalg.cond(carried / size) > 1e4:
            raise InputError(
                "these points lie on a line, or are too few: they cannot carry a datum; name three "
                "or more that lie around the block"
            )
        p = covariance.system.problem
        nothing = np.zeros((p.image_count * p.d, carried.shape[1]))
        return cls(covariance, points, carried / size, nothing, middle, scale)

    @classmethod
    def of_base(
        cls, covariance: Covariance, points: np.ndarray, base: tuple[int, int], scale: bool = True
    ) -> "InDatum":
        """The pose of the first photograph of a base is held and, with the scale, its length.

        Raises InputError where the two stand at one place.
        """
        p, centre = covariance.system.problem, covariance.state.centre
        first, second = base
        along = centre[second] - centre[first]
        length = float(np.linalg.norm(along))
        if scale and not length > 0:
            raise InputError("the two photographs of a base stand at one place: name others")
        held = np.zeros((p.image_count * p.d, 7 if scale else 6))
        held[first * p.d + np.arange(6), np.arange(6)] = 1.0
        if scale:
            held[second * p.d + np.arange(3), 6] = along / length
            held[first * p.d + np.arange(3), 6] = -along / length
        nothing = np.zeros((3 * len(points), held.shape[1]))
        return cls(covariance, points, nothing, held, centre[first], scale)

    @cached_property
    def _moved_points(self) -> np.ndarray:
        """G of the points (3k, t)."""
        xyz = self.covariance.state.points[self.points]
        return helmert_motions(xyz, self.middle).reshape(-1, 7)[:, : 7 if self.scale else 6]

    @cached_property
    def _moved_poses(self) -> np.ndarray:
        """G of the poses (m d, t)."""
        state, d = self.covariance.state, self.covariance.system.problem.d
        return motions(state, d, self.middle)[:, : 7 if self.scale else 6]

    @cached_property
    def _gains(self):
        return point_regression(self.covariance.system, self.points)

    @cached_property
    def _seen(self) -> np.ndarray:
        """What the unknowns of the equations do to B' z (n, t), the points following them."""
        out = -(self._gains.gain @ self.on_points)
        out[: len(self.on_poses)] += self.on_poses
        return out

    @cached_property
    def _with_unknowns(self) -> np.ndarray:
        """C B of the unknowns of the equations (n, t)."""
        return self.covariance.solve(self._seen)

    @cached_property
    def _with_points(self) -> np.ndarray:
        """C B of the points (3k, t)."""
        own = self._gains.own @ self.on_points.reshape(len(self.points), 3, -1)
        return own.reshape(self.on_points.shape) - self._gains.gain.T @ self._with_unknowns

    @cached_property
    def _inner(self) -> np.ndarray:
        """B' C B (t, t)."""
        own = self._gains.own @ self.on_points.reshape(len(self.points), 3, -1)
        of_points = self.on_points.T @ own.reshape(self.on_points.shape)
        return self._seen.T @ self._with_unknowns + of_points

    @cached_property
    def _inverse(self) -> np.ndarray:
        """(B' G)^-1."""
        return np.linalg.inv(
            self.on_points.T @ self._moved_points + self.on_poses.T @ self._moved_poses
        )

    @cached_property
    def point_variances(self) -> np.ndarray:
        """Variances (k, 3), m^2."""
        taken, sums = self._moved_points @ self._inverse, self._with_points
        variance = self.covariance.points(self.points)[:, [0, 2, 5]].ravel()
        variance = variance - 2 * np.einsum("nk,nk->n", taken, sums)
        variance += np.einsum("nk,kl,nl->n", taken, self._inner, taken)
        return np.maximum(variance, 0.0).reshape(-1, 3)

    @cached_property
    def poses(self) -> np.ndarray:
        """Covariances (m, d, d) of each pose."""
        d = self.covariance.system.problem.d
        taken = (self._moved_poses @ self._inverse).reshape(-1, d, self.on_poses.shape[1])
        sums = self._with_unknowns[: len(self.on_poses)].reshape(taken.shape)
        mixed = taken @ sums.transpose(0, 2, 1)
        both = taken @ self._inner @ taken.transpose(0, 2, 1)
        return self.covariance.each_pose - mixed - mixed.transpose(0, 2, 1) + both

    @cached_property
    def poses_shared(self) -> np.ndarray:
        """Covariances (m, d, q) of each pose with what images share, which no datum moves."""
        d = self.covariance.system.problem.d
        taken = self._moved_poses @ self._inverse
        q = self.covariance.poses_shared.shape[1]
        first = len(self.on_poses)
        moved = taken @ self._with_unknowns[first : first + q].T
        return (self.covariance.poses_shared - moved).reshape(-1, d, q)


def chosen(names: Iterable[str], wanted: Iterable[str] | None, sound: np.ndarray) -> np.ndarray:
    """Mask (n,) of the points that carry a datum: those named, or by default all sound ones.

    Raises InputError for a name that no point has.
    """
    if wanted is None:
        return sound
    wanted = [wanted] if isinstance(wanted, str) else list(wanted)
    names = np.asarray(names, dtype=object)
    unknown = [name for name in wanted if name not in set(names)]
    if unknown:
        raise InputError(f"no adjusted point is called {', '.join(unknown)}: name measured points")
    return np.isin(names, wanted)
