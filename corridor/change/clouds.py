"""The points of one date that are compared, and linear functions of two clouds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import block_array, csr_array

from corridor.change.epoch import Epoch


@dataclass(frozen=True, eq=False)
class Cloud:
    """What one date shows: some points of an epoch.

    surface (k,): positions in the epoch of the tie points that stand for the ground. named: name
    -> position of the points that both dates may show. date: what the epoch's names begin with
    where it holds both dates. roughness (n, 3, 3), m^2, of all points of the epoch: how far the
    ground itself leaves what its points stand for (see `with_roughness`).
    """

    epoch: Epoch
    surface: np.ndarray
    named: dict[str, int]
    date: str = ""
    roughness: np.ndarray | None = field(default=None, repr=False)

    @property
    def xyz(self) -> np.ndarray:
        """The surface's points (k, 3), m."""
        return self.epoch.xyz[self.surface]

    @property
    def surface_names(self) -> list[str]:
        """Names (k,) of the surface's points, as they are at this date."""
        return [str(name)[len(self.date) :] for name in self.epoch.names[self.surface]]


@dataclass(frozen=True)
class Functions:
    """Linear functions (r,): their derivatives (r, 3n) by the points of the epochs before, after.

    The points enter with their sign: a change is after minus before.
    """

    before: csr_array
    after: csr_array

    def __len__(self) -> int:
        return self.before.shape[0]

    def combined(self, matrix) -> Functions:
        """Sums of the functions, by a matrix (s, r)."""
        matrix = csr_array(matrix)
        return Functions(csr_array(matrix @ self.before), csr_array(matrix @ self.after))

    def __getitem__(self, rows) -> Functions:
        return Functions(csr_array(self.before[rows]), csr_array(self.after[rows]))

    def minus(self, other: Functions) -> Functions:
        """The difference of as many functions."""
        return Functions(csr_array(self.before - other.before), csr_array(self.after - other.after))

    @classmethod
    def stack(cls, parts: list[Functions]) -> Functions:
        """The functions of all parts, one below the other."""
        return cls(
            csr_array(block_array([[part.before] for part in parts])),
            csr_array(block_array([[part.after] for part in parts])),
        )


def displacements(before: Cloud, after: Cloud, names: list[str]) -> Functions:
    """After minus before (3k,) of points by name (k,)."""

    def part(cloud: Cloud, sign: float) -> csr_array:
        points = np.array([cloud.named[name] for name in names], dtype=np.int64)
        column = (3 * points[:, None] + np.arange(3)).ravel()
        shape = (len(column), 3 * len(cloud.epoch.xyz))
        return csr_array(
            (np.full(len(column), sign), (np.arange(len(column)), column)), shape=shape
        )

    return Functions(part(before, -1.0), part(after, 1.0))
