"""One epoch: an adjusted block as a cloud of points whose errors are known together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, eye_array, kron

from corridor.adjustment import Adjustment, PointGains, point_gains
from corridor.geometry import Similarity


class Epoch:
    """What an adjustment says of points, and how their errors hang together.

    With P = own - K' u (see `corridor.adjustment.point_gains`) a linear function F P has the
    variance F V^-1 F' + S Q S', S = -F K', Q the covariance of the unknowns.

    laid: a similarity that takes the adjusted points to where they are compared.
    """

    def __init__(self, adjustment: Adjustment, laid: Similarity | None = None):
        self.adjustment, self.laid = adjustment, laid
        self.system, self.sigma0 = adjustment.system, adjustment.sigma0
        self._gains: PointGains | None = None
        self._number = np.full(len(self.xyz), -1)

    @cached_property
    def xyz(self) -> np.ndarray:
        """Adjusted points (n, 3), m, where they are compared."""
        points = self.system.state.points
        return points if self.laid is None else self.laid.apply(points)

    @property
    def turn(self) -> np.ndarray:
        """How points (3, 3) move, where they are compared, with the adjusted ones."""
        return np.eye(3) if self.laid is None else self.laid.scale * self.laid.rotation

    @cached_property
    def names(self) -> np.ndarray:
        """Names (n,) of the points."""
        return self.system.points.names

    @cached_property
    def marks(self) -> np.ndarray:
        """Positions of the points that were measured as marks."""
        return np.flatnonzero(self.system.points.mark)

    @cached_property
    def rays(self) -> np.ndarray:
        """In how many images each point was measured (n,)."""
        return np.bincount(self.system.image_rows.point, minlength=len(self.xyz))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Covariances (n, k) of the unknowns with sums of them, unit weight."""
        return self.adjustment.covariance.solve(right)

    def gains(self, points: np.ndarray) -> tuple[PointGains, np.ndarray]:
        """V^-1 and K of at least these points, and the number of each of them there."""
        missing = points[self._number[points] < 0]
        if len(missing):
            known = np.zeros(0, np.int64) if self._gains is None else self._gains.points
            every = np.union1d(known, missing)
            self._gains = point_gains(self.system, every)
            self._number[every] = np.arange(len(every))
        return self._gains, self._number[points]

    def own(self, points: np.ndarray) -> np.ndarray:
        """Covariances (k, 3, 3) of points at given unknowns, unit weight."""
        gains, number = self.gains(points)
        return self.turn @ gains.own[number] @ self.turn.T

    def spread(self, rows: csr_array) -> Spread:
        """How the errors of linear functions (r, 3 n) of the points come about."""
        rows = csr_array(rows)
        if self.laid is not None:
            rows = csr_array(rows @ kron(eye_array(len(self.xyz)), csr_array(self.turn)))
        used = np.unique(rows.indices // 3)
        gains, number = self.gains(used)
        axis = np.arange(3)
        columns = (3 * number[:, None] + axis).ravel()
        part = csr_array(rows[:, (3 * used[:, None] + axis).ravel()])
        through = csr_array(-(part @ gains.gain[:, columns].T))
        through.sum_duplicates()
        return Spread(part, gains.own[number], used, through)


@dataclass(frozen=True)
class Spread:
    """Linear functions of some points: rows (r, 3k); own (k, 3, 3), m^2; points (k,); through
    (r, n): S, what they take over from the unknowns.
    """

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
