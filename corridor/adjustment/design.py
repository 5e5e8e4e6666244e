"""The design matrix at a state, for the right sides of many sets of measurements at once.

With A the rows by images and by what they share, P those by the points, all weighted, and e the
weighted residuals, the points eliminated:

    t = A' (e - P V^-1 P' e),  V = P' P,    and back    dp = V^-1 P' (e - A dx)

The rows are those of the assembly (`kernels.jacobian_rows`), some points at a time.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from corridor.adjustment.kernels import invert_cholesky
from corridor.adjustment.linear_system import LinearSystem
from corridor.adjustment.normal import Loss, Normal
from corridor.adjustment.rays import U, fill_rows, make_room, row_length, three
from corridor.compiled import KERNEL, compiled
from corridor.panels import PANEL

# Observations whose rows are made together.
CHUNK = 8192


class _Out(NamedTuple):
    """Where rows go, all flat but the last: by the image, by the point, by what is shared; inverse
    of the Cholesky factor of V (points, 6)."""

    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    root: np.ndarray


class Rays(NamedTuple):
    """Rays of the observations of some points, two an observation, as kernels make them.

    image (n,); start (points + 1,): where the rays of each point begin. own (2 n, d): by the
    image's unknowns; point (2 n, 3): by the point. root (points, 6): L^-1 of V = L L', as of
    `invert_cholesky`.
    """

    image: np.ndarray
    start: np.ndarray
    own: np.ndarray
    point: np.ndarray
    root: np.ndarray


class Part(NamedTuple):
    """Rows of some points: points, rows, own_at: which of the problem's, and of images' unknowns.

    own (2 n, of own_at), point (2 n, 3 points); shared (2 n, q): by what images share. root
    (points, 3, 3): L^-1 of V = L L'.
    """

    points: slice
    rows: slice
    own_at: slice
    own: csr_array
    point: csr_array
    shared: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, points: slice, rows: slice, rays: Rays, shared: np.ndarray) -> Part:
        """The rows of rays, as matrices."""
        d, count = rays.own.shape[1], len(rays.root)
        low, high = int(rays.image.min()), int(rays.image.max()) + 1
        of_point = np.repeat(np.arange(count), 2 * np.diff(rays.start))
        root = np.zeros((count, 3, 3))
        root[:, [0, 1, 1, 2, 2, 2], [0, 0, 1, 0, 1, 2]] = rays.root
        return cls(
            points,
            rows,
            slice(low * d, high * d),
            _blocks(rays.own, np.repeat(rays.image - low, 2), high - low),
            _blocks(rays.point, of_point, count),
            shared,
            root,
        )


def _blocks(values: np.ndarray, block: np.ndarray, count: int) -> csr_array:
    """Sparse matrix (n, count * width) of rows (n, width), each in its block of columns (n,)."""
    rows, width = values.shape
    column = (block[:, None] * width + np.arange(width)).ravel()
    begin = np.arange(0, rows * width + 1, width)
    return csr_array((values.ravel(), column, begin), shape=(rows, count * width))


class Sets(NamedTuple):
    """Residuals of k sets of measurements: of images (2 n, k), weighted; of control (3 c, k), m."""

    image: np.ndarray
    control: np.ndarray


class Design:
    """The rows of a system at its state, with the stated weights: its loss has no part in them.

    weight (n,): root of the weight of each observation. kept: rows stay from one pass to the next.
    followed (f,): points of which `back` tells where they go.
    """

    def __init__(self, system: LinearSystem, kept: bool = False, followed: Sequence[int] = ()):
        self.system = system = replace(system, loss=Loss())
        p = self._problem = system.problem
        self._normal = Normal(p, system.loss)
        self._view = self._normal.view(system.state)
        self._modelled = self._normal.modelled_at(system.state)
        self.weight = np.broadcast_to(p.weight, len(p.img))
        self._control = system.control
        self._control_weight = self._control.sigma.reshape(-1, 1) ** -2.0
        # Points with a row of their own: the control, and those that are followed.
        controls = len(p.control_rows)
        self._row = p.control.astype(np.int64)
        followed = np.array(followed, dtype=np.int64)
        fresh = np.unique(followed[p.control[followed] < 0])
        self._row[fresh] = controls + np.arange(len(fresh))
        self._followed = self._row[followed]
        self._numbered = controls + len(fresh)
        self._kept = list(self._made()) if kept else None

    def _parts(self) -> Iterator[Part]:
        yield from self._made() if self._kept is None else self._kept

    def _made(self) -> Iterator[Part]:
        p, normal = self._problem, self._normal
        # Kernels move it on.
        modelled = self._modelled.copy()
        ptr, kernel = p.ptr, rows_for(p.d, normal.sighted)
        weight = np.zeros((self._numbered + 1, 3))
        weight[: len(p.control_rows)] = p.control_weight
        room = make_room(normal.longest, p.d, p.wide)
        first, count = 0, len(ptr) - 1
        while first < count:
            upto = int(np.searchsorted(ptr, ptr[first] + CHUNK, side="right")) - 1
            last = min(max(upto, first + 1), count)
            rows = slice(2 * int(ptr[first]), 2 * int(ptr[last]))
            n = rows.stop - rows.start
            own, point, shared = np.zeros(n * p.d), np.zeros(n * 3), np.zeros(n * p.wide)
            root = np.zeros((last - first, 6))
            scene = normal.scene(self._view, modelled, first, last)
            to = _Out(own, point, shared, root)
            kernel(first, last, scene, weight[self._row[first:last]], to, room)
            rays = Rays(
                p.img[rows.start // 2 : rows.stop // 2],
                ptr[first : last + 1] - ptr[first],
                own.reshape(n, p.d),
                point.reshape(n, 3),
                root,
            )
            shared = shared.reshape(n, p.wide)[:, : p.shared_count]
            yield Part.of(slice(first, last), rows, rays, shared)
            first = last

    def right(self, sets: Sets) -> np.ndarray:
        """What image points and control say (columns, k), as `LinearSystem.right` has it."""
        p, k = self._problem, sets.image.shape[1]
        own = np.zeros((p.image_count * p.d, k))
        shared = np.zeros((p.shared_count, k))
        heavy, moved = self._heavy(sets.control), np.zeros((self._numbered, 3, k))
        for part in self._parts():
            left = sets.image[part.rows]
            left = left - self._followed_by(part, left, heavy, moved)
            own[part.own_at] += part.own.T @ left
            shared += part.shared.T @ left
        out = np.concatenate([own, shared, np.zeros((len(self.system.columns), k))])
        out = out[: len(self.system.columns)]
        if len(self._control.names):
            left = sets.control - moved[: len(self._control.names)].reshape(-1, k)
            out += self._control.jacobian.T @ (self._control_weight * left)
        return out

    def back(self, sets: Sets, step: np.ndarray) -> tuple[Sets, np.ndarray]:
        """What a step (columns, k) leaves of residuals, the points following it.

        Also by how much the followed points move (f, 3, k), m.
        """
        p, k = self._problem, step.shape[1]
        n = p.image_count * p.d
        own, shared = step[:n], step[n : n + p.shared_count]
        control = sets.control - self._control.jacobian @ step
        heavy, moved = self._heavy(control), np.zeros((self._numbered, 3, k))
        image = np.empty_like(sets.image)
        for part in self._parts():
            left = sets.image[part.rows] - part.shared @ shared - part.own @ own[part.own_at]
            image[part.rows] = left - self._followed_by(part, left, heavy, moved)
        control = control - moved[: len(self._control.names)].reshape(-1, k)
        return Sets(image, control), moved[self._followed]

    def _followed_by(
        self, part: Part, left: np.ndarray, heavy: np.ndarray, moved: np.ndarray
    ) -> np.ndarray:
        """What of residuals left (2 n, k) their points follow: P V^-1 (P' left + heavy).

        moved (numbered, 3, k): gets how far points with a row of their own go.
        """
        row, k = self._row[part.points], left.shape[1]
        numbered = np.flatnonzero(row >= 0)
        right = (part.point.T @ left).reshape(-1, 3, k)
        right[numbered] += heavy[row[numbered]]
        step = part.root.transpose(0, 2, 1) @ (part.root @ right)
        moved[row[numbered]] = step[numbered]
        return part.point @ step.reshape(-1, k)

    def _heavy(self, control: np.ndarray) -> np.ndarray:
        """Weighted residuals (numbered, 3, k) of the points with a row of their own."""
        k = control.shape[1]
        out = np.zeros((self._numbered, 3, k))
        out[: len(self._control.names)] = (self._control_weight * control).reshape(-1, 3, k)
        return out


@lru_cache
def rows_for(d: int, sighted: bool):
    """The kernel that makes the rows, for images with `d` unknowns; arguments as of the assembly's.

    It gets the weight (points, 3) of control, where rows go (`_Out`), and room for a point's rays.
    """

    row = row_length(d)

    @compiled(**KERNEL)
    def core(first, last, scene, weight, to, room):
        start, wide = scene.observations.start, scene.columns.wide
        # Rows by the point, negative.
        by_point, apart = (room.point, PANEL) if sighted else (room.own, row)
        for p in range(first, last):
            fill_rows(p, p + 1, scene, room, (0, wide), d)
            v0, v2, v5 = weight[p - first, 0], weight[p - first, 1], weight[p - first, 2]
            v1, v3, v4 = 0.0, 0.0, 0.0
            for k in range(2 * (start[p + 1] - start[p])):
                n = 2 * (start[p] - start[first]) + k
                for c in range(d):
                    to.own[n * d + c] = room.own[k * row + c]
                for c in range(wide):
                    to.shared[n * wide + c] = room.shared[k * wide + c]
                a0, a1, a2 = three(by_point, U(k * apart))
                to.point[3 * n], to.point[3 * n + 1], to.point[3 * n + 2] = -a0, -a1, -a2
                v0 += a0 * a0
                v1 += a1 * a0
                v2 += a1 * a1
                v3 += a2 * a0
                v4 += a2 * a1
                v5 += a2 * a2
            i0, i1, i2, i3, i4, i5, _ = invert_cholesky((v0, v1, v2, v3, v4, v5))
            to.root[p - first, 0], to.root[p - first, 1], to.root[p - first, 2] = i0, i1, i2
            to.root[p - first, 3], to.root[p - first, 4], to.root[p - first, 5] = i3, i4, i5

    return core
