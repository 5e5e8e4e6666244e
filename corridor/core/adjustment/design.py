"""The design matrix at a state, for the right sides of many sets of measurements at once.

With A the rows by images and by what they share, P those by the points, all weighted, and e the
weighted residuals, the points eliminated:

    t = A' (e - P V^-1 P' e),  V = P' P,    and back    dp = V^-1 P' (e - A dx)

The rows are those of the assembly (`kernels.jacobian_rows`), some points at a time.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import Loss, Normal
from corridor.core.engine.compiled import KERNEL, compiled
from corridor.core.engine.kernels import invert_cholesky
from corridor.core.engine.panels import PANEL, panel, plus, put, zeros
from corridor.core.engine.rays import U, fill_rows, make_room, row_length, three

# Observations whose rows are made together.
CHUNK = 4096


class _Out(NamedTuple):
    """Where rows go, all flat but the last: by the image, by the point, by what is shared; inverse
    of the Cholesky factor of V (points, 6)."""

    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    root: np.ndarray


class Rays(NamedTuple):
    """Rays of the observations of some points, two rows an observation, as kernels make them.

    image (n,); start (points + 1,): where the rays of each point begin. own (2 n, d): by the
    image's unknowns; point (2 n, 3): by the point; shared (2 n, q): by what images share. root
    (points, 6): L^-1 of V = L L', as of `invert_cholesky`. row (points,): where points with a row
    of their own have it, else -1.
    """

    image: np.ndarray
    start: np.ndarray
    own: np.ndarray
    point: np.ndarray
    shared: np.ndarray
    root: np.ndarray
    row: np.ndarray


class _Passing(NamedTuple):
    """What sets of residuals meet on their way through the points; flat, `sets` numbers a row.

    sets: how many, in whole panels. heavy (numbered, 3, sets): weighted residuals of points with a
    row; moved, likewise: gets how far they go. unknowns (columns, sets): of the images, `shared`
    from that row on; with `taken` a step, which is taken away first; without, they get what is
    left, summed by the unknowns.
    """

    sets: int
    heavy: np.ndarray
    moved: np.ndarray
    unknowns: np.ndarray
    shared: int
    taken: bool

    def moves(self, k: int) -> np.ndarray:
        """How far (numbered, 3, k) points with a row of their own went, m."""
        return self.moved.reshape(-1, 3, self.sets)[..., :k]


class Sets(NamedTuple):
    """Residuals of k sets of measurements: of images, k times (2 n,); of control (3 c, k), m.

    seen: makes of those of images (some, k), in place, what the equations see of them, weighted;
    None: they are weighted. Of large blocks they weigh most of all, and never lie there twice.
    """

    image: Sequence[np.ndarray]
    control: np.ndarray
    seen: Callable[[slice, np.ndarray], None] | None = None


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
        self._turn = p.control_turn
        # Points with a row of their own: the control, and those that are followed.
        controls = len(p.control_given)
        self._row = p.control.astype(np.int64)
        asked = np.array(followed, dtype=np.int64)
        fresh = np.unique(asked[p.control[asked] < 0])
        self._row[fresh] = controls + np.arange(len(fresh))
        self._followed = self._row[asked]
        self._numbered = controls + len(fresh)
        self._kept = list(self._made()) if kept else None

    def _parts(self) -> Iterator[tuple[slice, Rays]]:
        """Some of the problem's rows after others: which, and their rays."""
        yield from self._made() if self._kept is None else self._kept

    def _made(self) -> Iterator[tuple[slice, Rays]]:
        ptr, room = self._problem.ptr, self._made_room()
        first, count = 0, len(ptr) - 1
        while first < count:
            upto = int(np.searchsorted(ptr, ptr[first] + CHUNK, side="right")) - 1
            last = min(max(upto, first + 1), count)
            yield slice(2 * int(ptr[first]), 2 * int(ptr[last])), self._rays(first, last, room)
            first = last

    def rays_of(self, points: Sequence[int]) -> Iterator[Rays]:
        """The rays of some points (k,), one point after the other."""
        room = self._made_room()
        for point in points:
            yield self._rays(int(point), int(point) + 1, room)

    def _made_room(self) -> tuple:
        """What kernels move on, the weights of points with a row, and room for a point's rays."""
        p = self._problem
        weight = np.zeros((self._numbered + 1, 6))
        weight[: len(p.control_given)] = self._normal.control_weight[0]
        return self._modelled.copy(), weight, make_room(self._normal.longest, p.d, p.wide)

    def _rays(self, first: int, last: int, room: tuple) -> Rays:
        p, normal = self._problem, self._normal
        modelled, weight, room = room
        ptr, kernel = p.ptr, rows_for(p.d, normal.sighted)
        n = 2 * int(ptr[last] - ptr[first])
        own, point, shared = np.zeros(n * p.d), np.zeros(n * 3), np.zeros(n * p.wide)
        root = np.zeros((last - first, 6))
        scene = normal.scene(self._view, modelled, first, last)
        kernel(
            first, last, scene, weight[self._row[first:last]],
            _Out(own, point, shared, root), room,
        )  # fmt: skip
        return Rays(
            p.img[ptr[first] : ptr[last]],
            ptr[first : last + 1] - ptr[first],
            own.reshape(n, p.d),
            point.reshape(n, 3),
            shared.reshape(n, p.wide)[:, : p.shared_count],
            root,
            self._row[first:last],
        )

    def right(self, sets: Sets) -> np.ndarray:
        """What image points and control say (columns, k), as `LinearSystem.right` has it."""
        k = len(sets.image)
        unknowns = np.zeros((len(self.system.columns), _padded(k)))
        passing = self._passing(sets.control, unknowns, taken=False)
        for rows, rays in self._parts():
            _pass_points(rays, _seen(sets, rows).ravel(), passing)
        out = np.ascontiguousarray(unknowns[:, :k])
        if len(self._control.names):
            left = sets.control - self._turned(passing.moves(k)).reshape(-1, k)
            out += self._control.jacobian.T @ (self._control_weight * left)
        return out

    def back(self, sets: Sets, step: np.ndarray) -> tuple[Sets, np.ndarray, np.ndarray]:
        """What a step (columns, k) leaves of residuals, the points following it.

        Those of images change where they lie. Also by how much the followed points move (f, 3, k),
        m, and the sum of squares (k,) of what has changed of images.
        """
        control, k = sets.control - self._control.jacobian @ step, step.shape[1]
        passing = self._passing(control, _in_panels(step), taken=True)
        square = np.zeros(passing.sets)
        for rows, rays in self._parts():
            change = _seen(sets, rows)
            left = change.copy()
            _pass_points(rays, left.ravel(), passing)
            change -= left
            square += np.einsum("nk,nk->k", change, change)
            for one, less in zip(sets.image, change.T, strict=False):
                one[rows] -= less
        moved = passing.moves(k)
        control = control - self._turned(moved).reshape(control.shape)
        return sets._replace(control=control), moved[self._followed], square[:k]

    def _passing(self, control: np.ndarray, unknowns: np.ndarray, taken: bool) -> _Passing:
        """unknowns (columns, sets): those of the images, what they share, and others."""
        p, heavy = self._problem, _in_panels(self._heavy(control)).ravel()
        sets, first = unknowns.shape[1], p.image_count * p.d
        return _Passing(sets, heavy, np.zeros_like(heavy), unknowns.ravel(), first, taken)

    def _heavy(self, control: np.ndarray) -> np.ndarray:
        """Weighted residuals (numbered, 3, k) of the points with a row of their own."""
        k = control.shape[1]
        out = np.zeros((self._numbered, 3, k))
        heavy = (self._control_weight * control).reshape(-1, 3, k)
        out[: len(self._control.names)] = self._turn.transpose(0, 2, 1) @ heavy
        return out

    def _turned(self, moved: np.ndarray) -> np.ndarray:
        """Moves (numbered, 3, k) of the control in the coordinates of its rows (c, 3, k)."""
        return self._turn @ moved[: len(self._control.names)]


def _padded(sets: int) -> int:
    return -(-sets // PANEL) * PANEL


def _seen(sets: Sets, rows: slice) -> np.ndarray:
    """What the equations see of some rows of all sets (rows, sets), in whole panels."""
    out = np.zeros((rows.stop - rows.start, _padded(len(sets.image))))
    for to, one in zip(out.T, sets.image, strict=False):
        to[:] = one[rows]
    if sets.seen is not None:
        sets.seen(rows, out)
    return out


def _in_panels(values: np.ndarray) -> np.ndarray:
    """A copy of values (..., k) with as many sets as whole panels have."""
    out = np.zeros((*values.shape[:-1], _padded(values.shape[-1])))
    out[..., : values.shape[-1]] = values
    return out


@compiled(**KERNEL)
def _pass_points(rays, left, to):
    """Residuals left, in place, less what the points follow: P V^-1 (P' left + heavy)."""
    d, q, sets = rays.own.shape[1], rays.shared.shape[1], to.sets
    for p in range(len(rays.root)):
        row, first, last = rays.row[p], 2 * rays.start[p], 2 * rays.start[p + 1]
        i0, i1, i2 = rays.root[p, 0], rays.root[p, 1], rays.root[p, 2]
        i3, i4, i5 = rays.root[p, 3], rays.root[p, 4], rays.root[p, 5]
        for at in range(0, sets, PANEL):
            x = y = z = zeros()
            if row >= 0:
                x = panel(to.heavy, U(3 * row * sets + at))
                y = panel(to.heavy, U((3 * row + 1) * sets + at))
                z = panel(to.heavy, U((3 * row + 2) * sets + at))
            for n in range(first, last):
                e = panel(left, U(n * sets + at))
                if to.taken:
                    image = rays.image[n // 2]
                    for c in range(d):
                        step = panel(to.unknowns, U((image * d + c) * sets + at))
                        e = plus(e, -rays.own[n, c], step)
                    for c in range(q):
                        step = panel(to.unknowns, U((to.shared + c) * sets + at))
                        e = plus(e, -rays.shared[n, c], step)
                    put(left, U(n * sets + at), e)
                x = plus(x, rays.point[n, 0], e)
                y = plus(y, rays.point[n, 1], e)
                z = plus(z, rays.point[n, 2], e)
            z = i3 * x + i4 * y + i5 * z
            y = i1 * x + i2 * y
            x = i0 * (i0 * x) + i1 * y + i3 * z
            y = i2 * y + i4 * z
            z = i5 * z
            if row >= 0:
                put(to.moved, U(3 * row * sets + at), x)
                put(to.moved, U((3 * row + 1) * sets + at), y)
                put(to.moved, U((3 * row + 2) * sets + at), z)
            for n in range(first, last):
                e = panel(left, U(n * sets + at))
                e = plus(e, -rays.point[n, 0], x)
                e = plus(e, -rays.point[n, 1], y)
                e = plus(e, -rays.point[n, 2], z)
                put(left, U(n * sets + at), e)
                if not to.taken:
                    image = rays.image[n // 2]
                    for c in range(d):
                        here = U((image * d + c) * sets + at)
                        put(to.unknowns, here, plus(panel(to.unknowns, here), rays.own[n, c], e))
                    for c in range(q):
                        here = U((to.shared + c) * sets + at)
                        put(to.unknowns, here, plus(panel(to.unknowns, here), rays.shared[n, c], e))


@lru_cache
def rows_for(d: int, sighted: bool):
    """The kernel that makes the rows, for images with `d` unknowns; arguments as of the assembly's.

    It gets the weight (points, 6) of control, where rows go (`_Out`), and room for a point's rays.
    """

    row = row_length(d)

    @compiled(**KERNEL)
    def core(first, last, scene, weight, to, room):
        start, wide = scene.observations.start, scene.columns.wide
        # Rows by the point, negative. No literals: `fill_rows` would be compiled for them alone.
        by_point, apart = (room.point, PANEL) if sighted else (room.own, row)
        for p in range(first, last):
            fill_rows(p, p + 1, scene, room, (np.int64(0), wide), np.int64(d))
            v0, v1, v2 = weight[p - first, 0], weight[p - first, 1], weight[p - first, 2]
            v3, v4, v5 = weight[p - first, 3], weight[p - first, 4], weight[p - first, 5]
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
