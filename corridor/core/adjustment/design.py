"""The design matrix at a state, for the right sides of many sets of measurements at once.

With A the rows by images and by what they share, P those by the points, all weighted, and e the
weighted residuals, the points eliminated:

    t = A' (e - P V^-1 P' e),  V = P' P,    and back    dp = V^-1 P' (e - A dx)

The rows are those of the assembly, some points at a time.
Source: Triggs et al. 2000, section 6 (elimination of the points).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.adjustment.normal import CHUNK, Loss, Modelled, Normal
from corridor.core.engine.scene import PANEL, Passing, Rays


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
        # Of points with a row, and of none, which is the last.
        self._point_weight = np.zeros((self._numbered + 1, 6))
        self._point_weight[:controls] = self._normal.control_weight[0]
        self._kept = list(self._made()) if kept else None

    def _parts(self) -> Iterator[tuple[slice, Rays]]:
        """Some of the problem's rows after others: which, and their rays."""
        yield from self._made() if self._kept is None else self._kept

    def _made(self) -> Iterator[tuple[slice, Rays]]:
        ptr, modelled = self._problem.ptr, self._modelled.copy()
        for first, last in self._normal.chunks(0, len(ptr) - 1, CHUNK):
            yield slice(2 * int(ptr[first]), 2 * int(ptr[last])), self._rays(first, last, modelled)

    def rays_of(self, points: Sequence[int]) -> Iterator[Rays]:
        """The rays of some points (k,), one point after the other."""
        modelled = self._modelled.copy()
        for point in points:
            yield self._rays(int(point), int(point) + 1, modelled)

    def _rays(self, first: int, last: int, modelled: Modelled) -> Rays:
        scene = self._normal.scene(self._view, modelled, first, last)
        row = self._row[first:last]
        made = self._normal.engine.rows(scene, row, self._point_weight[row])
        shared = np.ascontiguousarray(made.shared[:, : self._problem.shared_count])
        return made._replace(shared=shared)

    def right(self, sets: Sets) -> np.ndarray:
        """What image points and control say (columns, k), as `LinearSystem.right` has it."""
        k = len(sets.image)
        unknowns = np.zeros((len(self.system.columns), _padded(k)))
        passing = self._passing(sets.control, unknowns, taken=False)
        for rows, rays in self._parts():
            self._normal.engine.follow(rays, _seen(sets, rows), passing)
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
            self._normal.engine.follow(rays, left, passing)
            change -= left
            square += np.einsum("nk,nk->k", change, change)
            for one, less in zip(sets.image, change.T, strict=False):
                one[rows] -= less
        moved = passing.moves(k)
        control = control - self._turned(moved).reshape(control.shape)
        return sets._replace(control=control), moved[self._followed], square[:k]

    def _passing(self, control: np.ndarray, unknowns: np.ndarray, taken: bool) -> Passing:
        """unknowns (columns, sets): those of the images, what they share, and others."""
        p, heavy = self._problem, _in_panels(self._heavy(control)).ravel()
        sets, first = unknowns.shape[1], p.image_count * p.d
        return Passing(sets, heavy, np.zeros_like(heavy), unknowns.ravel(), first, taken)

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
