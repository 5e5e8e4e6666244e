"""Exact covariances of cameras, effects, lever arms, poses and points.

The band's inverse is needed inside the band only (see `band_inverse`); with it comes every pose and
every point.

Source: Triggs et al. 2000, section 9 (free networks: S-transformation).
"""

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import block_diag as sparse_diag
from scipy.sparse import csr_array

from corridor.core.adjustment.datum import centred
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.regression import point_regression
from corridor.core.adjustment.rigs import Exposures
from corridor.core.engine.scene import Asked, Inverse, Storage
from corridor.core.engine.threads import one_thread

# Points that are asked one by one, of a large network one in so many: each takes as long.
FEW, SHARE = 64, 50
# Coordinates of control that are solved for together, and numbers that are kept of it.
_TOGETHER, _MOST_KEPT = 48, 2**24
_NOTHING = Storage(np.zeros(0), 0, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


class ControlSight(NamedTuple):
    """What the residuals of c control points, x, y, z in the world, see of the unknowns.

    points (c,): their numbers. own (c, 3, 3): V^-1, m^2, of each at given poses. rows (3 c, n).
    """

    points: np.ndarray
    own: np.ndarray
    rows: csr_array


class Covariance:
    """Covariances at a state for unit weight; multiply by sigma naught squared.

    null_space: (n + q, k) of a free network (see `corridor.core.adjustment.datum`), else None.
    Raises Singular where nothing determines an unknown.
    """

    def __init__(self, system: LinearSystem, null_space: np.ndarray | None = None):
        self.system, self.state = system, system.state
        p = system.problem
        self._n, self._q = p.image_count * p.d, p.shared_count
        self._shared_inverse = system.factor.shared_inverse()
        self._open = null_space
        if null_space is not None:
            n, q = self._n, self._q
            self._poses, self._shared = null_space[:n], null_space[n:]
            self._weights = centred(system, self._poses)
            nothing = np.zeros((q, null_space.shape[1]))
            self._part = system.solve(np.concatenate([self._weights.T, nothing]))
            self._inner = self._weights @ self._part[:n]

    def __repr__(self) -> str:
        free = "" if self._open is None else " of a free network"
        return (
            f"Covariance{free}: {self.system.problem.image_count} images, {self._q} shared unknowns"
        )

    def _datum(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray | float:
        """What the S-transformation adds to the entries (rows, columns)."""
        if self._open is None:
            return 0.0
        g, a = self._open, self._part
        return (
            g[rows] @ self._inner @ g[columns].T - g[rows] @ a[columns].T - a[rows] @ g[columns].T
        )

    @cached_property
    def shared(self) -> np.ndarray:
        """Of the unknowns that images share (q, q): cameras, effects, lever arms."""
        at = self._n + np.arange(self._q)
        return self._shared_inverse + self._datum(at, at)

    @cached_property
    def _across(self) -> np.ndarray:
        """B^-1 E of exposures."""
        return self.system.factor.across()

    @property
    def _exposures(self) -> Exposures:
        """Whose unknowns the factor has."""
        return self.system.exposures

    @cached_property
    def poses_shared(self) -> np.ndarray:
        """Between poses and shared unknowns (n, q)."""
        n, q = self._n, self._q
        cross = -self._exposures.images(self._across) @ self._shared_inverse
        return cross + self._datum(np.arange(n), n + np.arange(q))

    def solve(self, sums: np.ndarray) -> np.ndarray:
        """Covariances of poses and shared unknowns (n + q, k) with any k sums of them.

        sums (n + q, k): the factors of each. Source: x = N^-1 t, the normal equations solved for
        the sums in place of the gradient; N^-1 is the covariance.
        """
        x = self.system.solve(sums)
        if self._open is None:
            return x
        g, a = self._open, self._part
        return x + g @ (self._inner @ (g.T @ sums)) - g @ (a.T @ sums) - a @ (g.T @ sums)

    @cached_property
    def control(self) -> ControlSight:
        """The ground control as the equations see it, its points eliminated."""
        p = self.system.problem
        points = np.flatnonzero((p.control >= 0) & (p.control < len(p.control_rows)))
        points = points[np.argsort(p.control[points])]
        regression = point_regression(self.system, points)
        rows = self.system.control.jacobian[: 3 * len(points)]
        if len(points):
            rows = sparse_diag(list(np.linalg.inv(p.control_turn[: len(points)]))) @ rows
        return ControlSight(points, regression.own, csr_array(rows - regression.gain.T))

    @cached_property
    def _of_control(self) -> np.ndarray | None:
        """Covariances (n, 3 c) of the unknowns with what control sees; None where that is long."""
        rows = self.control.rows
        whole = 0 < rows.shape[0] * rows.shape[1] <= _MOST_KEPT
        return self.solve(rows.T.toarray()) if whole else None

    def with_control(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Some coordinates of control after others, of whole points: which, and covariances
        (n, some) of the unknowns with what these see."""
        rows = self.control.rows
        for first in range(0, rows.shape[0], _TOGETHER):
            some = slice(first, min(first + _TOGETHER, rows.shape[0]))
            kept = self._of_control
            yield some, self.solve(rows[some].T.toarray()) if kept is None else kept[:, some]

    def poses(self, images: np.ndarray) -> np.ndarray:
        """Of some images together (k * d, k * d), k positions in the problem's order."""
        p = self.system.problem
        rows = (np.asarray(images)[:, None] * p.d + np.arange(p.d)).ravel()
        right = np.zeros((p.image_count * p.d + p.shared_count, len(rows)))
        right[rows, np.arange(len(rows))] = 1.0
        columns = self.system.solve(right)
        return columns[rows] + self._datum(rows, rows)

    @cached_property
    def _near(self) -> Storage:
        """Entries between exposures that share a point, in the storage of the equations."""
        _ = self._of_control  # While the factor is there.
        with one_thread():
            left, right = self._low_rank()
            # In place of the factor, which is as large: who asks for that has it made anew.
            return self.system.take_factor().inverse(left, right)

    def _low_rank(self) -> tuple[np.ndarray, np.ndarray]:
        """Border and datum as a sum of products: entry (i, j) gets left[i] . right[j]."""
        x = self._across
        left, right = [x @ self._shared_inverse], [x]
        if self._open is not None:
            g, a = map(self._exposures.of_bases, (self._poses, self._part[: len(self._poses)]))
            left += [g @ self._inner - a, -g]
            right += [g, a]
        return np.concatenate(left, axis=1), np.concatenate(right, axis=1)

    @cached_property
    def each_pose(self) -> np.ndarray:
        """Of every image (m, d, d)."""
        own, turn = self._exposures.unknown, self._exposures.turn
        found = self._near.symmetric(own[:, :, None], own[:, None], self._exposures.size)
        return turn @ found @ turn.transpose(0, 2, 1)

    @cached_property
    def of_marked(self) -> dict[int, np.ndarray]:
        """By the number of each marked point: of the images that show it, as `of_images`."""
        p = self.system.problem
        return {
            point: self.of_images(np.unique(p.img[p.ptr[point] : p.ptr[point + 1]]))
            for point in np.flatnonzero(p.point_kinds).tolist()
        }

    def of_images(self, images: np.ndarray) -> np.ndarray:
        """Of the unknowns (k d, k d) of images (k,) in rising order, of which any two share a
        point."""
        own, turn = self._exposures.unknown[images].ravel(), self._exposures.turn[images]
        turn = block_diag(*turn)
        return turn @ self._near.symmetric(own[:, None], own, self._exposures.size) @ turn.T

    @cached_property
    def _normal(self) -> Normal:
        """The engine at the points."""
        system = self.system
        return Normal(system.problem, system.loss, system.threads, system.storage)

    def _of_points(self, asked: Asked, some: Iterable[int] | None = None) -> None:
        """Fill what is asked for, of some points alone; see `point_covariance`."""
        normal = self._normal
        view = normal.view(self.state)
        modelled = normal.modelled_at(self.state)
        # Without `out` no entry of the images is looked at.
        near = self._near if len(asked.out) else _NOTHING
        across = self._exposures.of_bases(self.poses_shared)
        known = Inverse(near, across.ravel(), self.shared.ravel(), self._q)

        def work(piece: int, start: int, stop: int) -> None:
            for first, last in normal.chunks(start, stop):
                scene = normal.scene_of_exposures(view, modelled, first, last)
                normal.of_exposures.point_covariance(scene, known, asked)

        if some is None:
            normal.pieces.run(work)
            return
        for at in some:
            work(0, int(at), int(at) + 1)

    def points(self, index: np.ndarray) -> np.ndarray:
        """Of some points (k, 6), as `each_point` has them; of few, without asking all others."""
        count = len(self.system.problem.ptr) - 1
        if "each_point" in self.__dict__ or len(index) > max(FEW, count // SHARE):
            return self.each_point[index]
        return self._each_of(index)[index]

    def _each_of(self, some: Iterable[int] | None) -> np.ndarray:
        """`each_point` (n, 6), filled for some of the points, or for all."""
        count, nothing = len(self.system.problem.ptr) - 1, np.zeros(0, dtype=np.int64)
        out = np.empty((count, 6))
        self._of_points(Asked(np.full(count, -1), nothing, out, np.zeros((0, 3, 0))), some)
        return out

    @cached_property
    def each_point(self) -> np.ndarray:
        """Of every point (n, 6): xx, yx, yy, zx, zy, zz, metres squared."""
        out = self._each_of(None)
        # As large as the equations: who asks for more than poses after this has it made anew.
        _ = self.each_pose
        del self._near
        return out

    @cached_property
    def point_variances(self) -> np.ndarray:
        """Of x, y, z of every point (n, 3), m^2; the rest of `each_point` is not kept for it."""
        kept = "each_point" in self.__dict__
        variances = self.each_point[:, [0, 2, 5]]
        if not kept:
            del self.each_point
        return variances

    def between(self, points: np.ndarray | slice, columns: Iterable[int]) -> np.ndarray:
        """Between some points and some of the shared unknowns (points, 3, columns)."""
        count = len(self.system.problem.ptr) - 1
        chosen, columns = np.arange(count)[points], np.array(list(columns), dtype=np.int64)
        wanted = np.full(count, -1)
        wanted[chosen] = np.arange(len(chosen))
        cross = np.empty((len(chosen), 3, len(columns)))
        self._of_points(Asked(wanted, columns, np.zeros((0, 6)), cross))
        return cross
