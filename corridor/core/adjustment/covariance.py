"""Exact covariances of cameras, effects, lever arms, poses and points.

The band's inverse is needed inside the band only (see `band_inverse`); with it comes every pose and
every point.

Source: Triggs et al. 2000, section 9 (free networks: S-transformation).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from corridor.core.adjustment.datum import centred
from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.matrix import Band, Sparse
from corridor.core.engine.band_inverse import invert_within
from corridor.core.engine.kernels import Storage
from corridor.core.engine.point_covariance import Asked, Inverse, point_covariance
from corridor.core.engine.threads import one_thread

# Points that are asked one by one, of a large network one in so many: each takes as long.
FEW, SHARE = 64, 50


class Covariance:
    """Covariances at a state for unit weight; multiply by sigma naught squared.

    null_space: (n + q, k) of a free network (see `corridor.core.adjustment.datum`), else None.
    Raises Singular where nothing determines an unknown.
    """

    def __init__(self, system: LinearSystem, null_space: np.ndarray | None = None):
        self.system, self.state = system, system.state
        self.normal, self._system = system.factorised
        self._open = null_space
        if null_space is not None:
            n = len(null_space) - self._system.q
            self._poses, self._shared = null_space[:n], null_space[n:]
            self._weights = centred(system, self._poses)
            nothing = np.zeros((self._system.q, null_space.shape[1]))
            self._part = system.solve(np.concatenate([self._weights.T, nothing]))
            self._inner = self._weights @ self._part[:n]

    def __repr__(self) -> str:
        free = "" if self._open is None else " of a free network"
        return (
            f"Covariance{free}: {self.system.problem.image_count} images, "
            f"{self._system.q} shared unknowns"
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
        n, q = self._system.blocks.n, self._system.q
        at = n + np.arange(q)
        return self._system.shared_inverse() + self._datum(at, at)

    @cached_property
    def _across(self) -> np.ndarray:
        """B^-1 E (n, q)."""
        _, system = self.system.factorised  # which another covariance may have used up
        if isinstance(system.blocks, Band):
            return system.blocks.other_half(system.z)
        return system.x

    @cached_property
    def poses_shared(self) -> np.ndarray:
        """Between poses and shared unknowns (n, q)."""
        n, q = self._system.blocks.n, self._system.q
        cross = -self._across @ self._system.shared_inverse()
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

    def poses(self, images: np.ndarray) -> np.ndarray:
        """Of some images together (k * d, k * d), k positions in the problem's order."""
        p = self.system.problem
        rows = (np.asarray(images)[:, None] * p.d + np.arange(p.d)).ravel()
        right = np.zeros((p.image_count * p.d + p.shared_count, len(rows)))
        right[rows, np.arange(len(rows))] = 1.0
        columns = self.system.solve(right)
        return columns[rows] + self._datum(rows, rows)

    @cached_property
    def _near(self) -> np.ndarray:
        """Entries between images that share a point, in the storage of the equations."""
        with one_thread():
            if isinstance(self._system.blocks, Sparse):
                return self._near_sparse(self._system.blocks)
            # In place of the factor, which is as large: who asks for that has it made anew.
            self.shared, self.poses_shared  # noqa: B018, while it is there
            _, system = self.system.factorised
            self.system.let_go_factor()
            blocks = system.blocks
            flat, blocks.flat = blocks.flat, np.zeros(0)
            invert_within(flat, blocks.n, blocks.ld, *self._low_rank())
            return flat

    def _low_rank(self) -> tuple[np.ndarray, np.ndarray]:
        """Border and datum as a sum of products: entry (i, j) gets left[i] . right[j]."""
        x = self._across
        left, right = [x @ self._system.shared_inverse()], [x]
        if self._open is not None:
            g, a = self._poses, self._part[: len(self._poses)]
            left += [g @ self._inner - a, -g]
            right += [g, a]
        return np.concatenate(left, axis=1), np.concatenate(right, axis=1)

    def _near_sparse(self, blocks: Sparse) -> np.ndarray:
        d, out = blocks.d, np.empty_like(blocks.flat)
        left, right = self._low_rank()
        for i in range(blocks.images):
            span = slice(i * d, (i + 1) * d)
            unit = np.zeros((blocks.n, d))
            unit[span] = np.eye(d)
            column = blocks.solve(unit) + left @ right[span].T
            start, stop = blocks.neighbour_start[i : i + 2]
            rows = blocks.neighbour[start:stop, None] * d + np.arange(d)
            out[start * d * d : stop * d * d] = column[rows].transpose(0, 2, 1).ravel()
        return out

    @cached_property
    def each_pose(self) -> np.ndarray:
        """Of every image (m, d, d)."""
        p, blocks = self.system.problem, self._system.blocks
        d = p.d
        out, near = np.empty((p.image_count, d, d)), self._near
        for c in range(d):
            for r in range(c, d):
                if isinstance(blocks, Band):
                    entry = near[c * blocks.ld + r - c :: d * blocks.ld][: p.image_count]
                else:
                    entry = near[blocks.neighbour_start[:-1] * d * d + c * d + r]
                out[:, r, c] = out[:, c, r] = entry
        return out

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
        d, blocks, near = self.system.problem.d, self._system.blocks, self._near
        k, inner = len(images), np.arange(d)
        out = np.empty((k, d, k, d))
        for a, i in enumerate(images):
            for b in range(a, k):
                j = images[b]
                if isinstance(blocks, Band):
                    column = i * d + inner
                    row = j * d + inner[:, None]
                    low, high = np.minimum(row, column), np.maximum(row, column)
                    block = near[low * blocks.ld + high - low]
                else:
                    start, stop = blocks.neighbour_start[i : i + 2]
                    at = start + np.searchsorted(blocks.neighbour[start:stop], j)
                    block = near[at * d * d : (at + 1) * d * d].reshape(d, d).T
                    if i == j:
                        block = np.tril(block) + np.tril(block, -1).T
                out[b, :, a], out[a, :, b] = block, block.T
        return out.reshape(k * d, k * d)

    def _of_points(self, asked: Asked, some: Iterable[int] | None = None) -> None:
        """Fill what is asked for, of some points alone; see `point_covariance`."""
        p, normal, blocks = self.system.problem, self.normal, self._system.blocks
        view = normal.view(self.state)
        modelled = normal.modelled_at(self.state)
        # Without `out` no entry of the images is looked at.
        flat = self._near if len(asked.out) else np.zeros(0)
        storage = Storage(flat, blocks.stride, blocks.neighbour_start, blocks.neighbour)
        q = self._system.q
        known = Inverse(storage, self.poses_shared.ravel(), self.shared.ravel(), q)

        def work(piece: int, start: int, stop: int) -> None:
            for first, last in normal.chunks(start, stop):
                scene = normal.scene(view, modelled, first, last)
                point_covariance(first, last, scene, p.d, known, normal.longest, asked)

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
        out, nothing = np.empty((count, 6)), np.zeros(0, dtype=np.int64)
        self._of_points(Asked(np.full(count, -1), nothing, out, np.zeros((0, 3, 0))), index)
        return out[index]

    @cached_property
    def each_point(self) -> np.ndarray:
        """Of every point (n, 6): xx, yx, yy, zx, zy, zz, metres squared."""
        count = len(self.system.problem.ptr) - 1
        out = np.empty((count, 6))
        nothing = np.zeros(0, dtype=np.int64)
        self._of_points(Asked(np.full(count, -1), nothing, out, np.zeros((0, 3, 0))))
        # What is small beside what all are taken from, as large as the equations, which nobody
        # needs after this.
        _ = self.each_pose, self.of_marked
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

    @property
    def points_shared(self) -> np.ndarray:
        """Between every point and the shared unknowns (n, 3, q)."""
        return self.between(slice(None), range(self._system.q))

    def between(self, points: np.ndarray | slice, columns: Iterable[int]) -> np.ndarray:
        """Between some points and some of the shared unknowns (points, 3, columns)."""
        count = len(self.system.problem.ptr) - 1
        chosen, columns = np.arange(count)[points], np.array(list(columns), dtype=np.int64)
        wanted = np.full(count, -1)
        wanted[chosen] = np.arange(len(chosen))
        cross = np.empty((len(chosen), 3, len(columns)))
        self._of_points(Asked(wanted, columns, np.zeros((0, 6)), cross))
        return cross
