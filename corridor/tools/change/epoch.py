"""One date: an adjusted block as a cloud of points whose errors are known together.

A change is a row of a sparse matrix (r, 3 (n + m)) over the coordinates of all points of both
dates, of the first before those of the second; points enter with their sign.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, eye_array, kron
from scipy.spatial import cKDTree

from corridor.core.adjustment import Adjustment, PointRegression, point_regression
from corridor.core.geometry import Similarity, robust_scale
from corridor.tools.change.matching import between_strips

# What the names of points, images ... begin with where one adjustment holds both dates.
BEFORE, AFTER = "before:", "after:"
# Tie points further than so many usual distances from the ground around them are wrong matches.
WILD = 8.0
_AROUND = 9


class Epoch:
    """What an adjustment says of points, and how their errors hang together.

    With P = own - K' u (see `corridor.adjustment.point_regression`) a linear function F P has the
    variance F V^-1 F' + S Q S', S = -F K', Q the covariance of the unknowns.

    laid: a similarity that takes the adjusted points to where they are compared.
    """

    def __init__(self, adjustment: Adjustment, laid: Similarity | None = None):
        self.adjustment, self.laid = adjustment, laid
        self.system = adjustment.system
        # What changes hang on is the shape of the block, which strips have together.
        self.overdispersion = between_strips(adjustment)
        self.sigma0 = adjustment.sigma0 * self.overdispersion
        self.names = self.system.points.names
        self._gains: PointRegression | None = None
        self._number = np.full(len(self.names), -1)

    @cached_property
    def xyz(self) -> np.ndarray:
        """Adjusted points (n, 3), m, where they are compared."""
        points = self.system.state.points
        return points if self.laid is None else self.laid.apply(points)

    @property
    def turn(self) -> np.ndarray:
        """How points (3, 3) move, where they are compared, with the adjusted ones."""
        return np.eye(3) if self.laid is None else self.laid.scale * self.laid.rotation

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Covariances (n, k) of the unknowns with sums of them, unit weight."""
        return self.adjustment.covariance.solve(right)

    def regression(self, points: np.ndarray) -> tuple[PointRegression, np.ndarray]:
        """V^-1 and K of at least these points, and the number of each of them there."""
        missing = points[self._number[points] < 0]
        if len(missing):
            known = np.zeros(0, np.int64) if self._gains is None else self._gains.points
            every = np.union1d(known, missing)
            self._gains = point_regression(self.system, every)
            self._number[every] = np.arange(len(every))
        return self._gains, self._number[points]

    def own(self, points: np.ndarray) -> np.ndarray:
        """Covariances (k, 3, 3) of points at given unknowns, unit weight."""
        regression, number = self.regression(points)
        return self.turn @ regression.own[number] @ self.turn.T

    def spread(self, rows: csr_array) -> Spread:
        """How the errors of linear functions (r, 3 n) of the points come about."""
        rows = csr_array(rows)
        if self.laid is not None:
            rows = csr_array(rows @ kron(eye_array(len(self.names)), csr_array(self.turn)))
        used = np.unique(rows.indices // 3)
        regression, number = self.regression(used)
        axis = np.arange(3)
        columns = (3 * number[:, None] + axis).ravel()
        part = csr_array(rows[:, (3 * used[:, None] + axis).ravel()])
        through = csr_array(-(part @ regression.gain[:, columns].T))
        through.sum_duplicates()
        return Spread(self, part, regression.own[number], used, through)


@dataclass(frozen=True, eq=False)
class Spread:
    """Linear functions of some points of an epoch: rows (r, 3k); own (k, 3, 3), m^2, unit weight;
    points (k,); through (r, n): S, what they take over from the unknowns.
    """

    epoch: Epoch
    rows: csr_array
    own: np.ndarray
    points: np.ndarray
    through: csr_array

    def weighted(self, own: np.ndarray) -> csr_array:
        """F V^-1 (r, 3k) with V^-1 = own (k, 3, 3)."""
        at = 3 * np.arange(len(own))[:, None, None]
        row = np.broadcast_to(at + np.arange(3)[:, None], own.shape)
        column = np.broadcast_to(at + np.arange(3), own.shape)
        size = 3 * len(own)
        entries = (own.ravel(), (row.ravel(), column.ravel()))
        return csr_array(self.rows @ csr_array(entries, shape=(size, size)))

    def variance(self, own: np.ndarray) -> np.ndarray:
        """F V^-1 F' (r,), of each function alone."""
        return np.asarray(self.weighted(own).multiply(self.rows).sum(axis=1)).ravel()


@dataclass(frozen=True, eq=False)
class Cloud:
    """What one date shows: some points of an epoch.

    surface (k,): positions in the epoch of the tie points that stand for the ground. named: name
    -> position of the points that both dates may show. date: what the epoch's names begin with
    where it holds both dates.
    """

    epoch: Epoch
    surface: np.ndarray
    named: dict[str, int]
    date: str = ""

    @classmethod
    def of(cls, epoch: Epoch, rays: int, date: str = "") -> Cloud:
        """The points of an epoch whose names begin with `date`, which is no part of them.

        rays: how many images at least show a point that stands for the ground.
        """
        system = epoch.system
        mine = np.array([str(name).startswith(date) for name in epoch.names], dtype=bool)
        marks = system.points.mark
        shown = np.bincount(system.image_rows.point, minlength=len(epoch.names))
        surface = np.flatnonzero(mine & ~marks & (shown >= rays))
        named = {str(epoch.names[k])[len(date) :]: int(k) for k in np.flatnonzero(mine & marks)}
        return cls(epoch, surface[sound(epoch.xyz[surface])], named, date)

    @property
    def xyz(self) -> np.ndarray:
        """The surface's points (k, 3), m."""
        return self.epoch.xyz[self.surface]

    @property
    def surface_names(self) -> list[str]:
        """Names (k,) of the surface's points, as they are at this date."""
        return [str(name)[len(self.date) :] for name in self.epoch.names[self.surface]]


def clouds(
    before: Adjustment, after: Adjustment, same_ties: bool = False, rays: int = 3
) -> tuple[Cloud, Cloud]:
    """The clouds of two adjustments.

    same_ties: tie points of the same name are the same points of the ground; the others go.
    rays: see `Cloud.of`.
    """
    sides = tuple(Cloud.of(Epoch(adjustment), rays) for adjustment in (before, after))
    return _paired(*sides) if same_ties else sides


def together_clouds(
    adjustment: Adjustment, same_ties: bool = False, rays: int = 3
) -> tuple[Cloud, Cloud]:
    """The clouds of both dates in one adjustment, named as they were in each; see `clouds`."""
    epoch = Epoch(adjustment)
    sides = tuple(Cloud.of(epoch, rays, date) for date in (BEFORE, AFTER))
    return _paired(*sides) if same_ties else sides


def _paired(before: Cloud, after: Cloud) -> tuple[Cloud, Cloud]:
    """The clouds with those surface points only that both name, one for one."""
    places = [dict(zip(one.surface_names, one.surface, strict=True)) for one in (before, after)]
    both = [name for name in places[0] if name in places[1]]
    first, second = (np.array([place[n] for n in both], dtype=np.int64) for place in places)
    return replace(before, surface=first), replace(after, surface=second)


def sound(xyz: np.ndarray) -> np.ndarray:
    """Which points (n,) lie on the ground around them, as far as can be seen.

    The usual distance is that of all points, or that of the neighbours among themselves where it
    is larger: the crest of a dike is no wrong match.
    """
    if len(xyz) <= _AROUND:
        return np.ones(len(xyz), dtype=bool)
    near = cKDTree(xyz[:, :2]).query(xyz[:, :2], _AROUND)[1][:, 1:]
    around = xyz[near, 2]
    away = xyz[:, 2] - np.median(around, axis=1)
    usual = np.maximum(robust_scale(around, centred=True, axis=1), robust_scale(away, least=1e-6))
    return np.abs(away) <= WILD * usual


def coordinates(epoch: Epoch, points: np.ndarray) -> csr_array:
    """The coordinates of points (k,) as functions (3k, 3n) of those of all."""
    column = (3 * points[:, None] + np.arange(3)).ravel()
    entries = (np.ones(len(column)), (np.arange(len(column)), column))
    return csr_array(entries, shape=(len(column), 3 * len(epoch.names)))
