"""Candidates after poses, camera and lever arms have had their say.

With B the candidates' columns, W the weights and Q = I - A (A'WA)^-1 A'W what poses, points and
nuisance A leave, the candidates meet

    M = B'WQB,    g = B'WQr

M theta = g is one more step of Newton's; under the null hypothesis g ~ N(0, M).
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import issparse

from corridor.diagnosis.candidates import Group
from corridor.diagnosis.equations import Equations

# Columns of the antenna's part that are made together.
CHUNK = 600


@dataclass
class Reduced:
    """M and g of the core (c, c), (c,), of each block of per-image columns, and between them.

    between: of each block with the core; mutual: (i, j) -> of two blocks, i < j.

    g is that of no effect at all: where candidates stand at a value, their part has been put
    back. Blocks that were left out are None.
    """

    M: np.ndarray
    g: np.ndarray
    own_matrix: list[np.ndarray | None]
    own_g: list[np.ndarray | None]
    between: list[np.ndarray | None]
    mutual: dict[tuple[int, int], np.ndarray]
    groups: list[Group]


class Antennas(NamedTuple):
    """One unit column for each antenna coordinate, reduced: all that the block knows of its noise.

    P (3k, 3k), rho (3k,): their M and g. core (3k, c), own: M between them and the candidates;
    None where a block of per-image columns cannot touch the antenna much.
    """

    P: np.ndarray
    rho: np.ndarray
    core: np.ndarray
    own: list[np.ndarray | None]


class Elimination:
    """Poses and nuisance of equations eliminated, for one covariance of the GNSS."""

    def __init__(self, equations: Equations, noise):
        """noise: `GnssNoise`; or None for the stated standard deviations."""
        self.equations, self.noise = equations, noise
        e = equations
        self.right = e.right.copy()
        if len(e.residual):
            self.right += e.jacobian.T @ self.weigh(e.residual)
        try:
            self.unit, self.factor = self._factor(0.0)
        except np.linalg.LinAlgError:
            # What nothing determines is held a little.
            self.unit, self.factor = self._factor(1e-10)
        self.half_right = self.half(self.right)

    def _factor(self, held: float) -> tuple[np.ndarray, np.ndarray]:
        """Units (n,) and lower Cholesky factor (n, n).

        In units of their own weight, or metres and radians would meet. With a thousand images the
        matrix is a third of a gigabyte: there is this one, and no copy of it.
        """
        e = self.equations
        matrix = e.matrix.toarray(order="F")
        if len(e.residual):
            self._add_antenna(matrix)
        if e.free_motions is not None:
            g = e.free_motions / np.linalg.norm(e.free_motions, axis=0)
            matrix += np.median(np.diag(matrix)) * (g @ g.T)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix *= unit[:, None]
        matrix *= unit
        matrix[np.diag_indices_from(matrix)] += held
        return unit, cholesky(matrix, lower=True, check_finite=False, overwrite_a=True)

    def _add_antenna(self, matrix: np.ndarray) -> None:
        """Add J' Sigma^-1 J, a few columns at a time."""
        jacobian = self.equations.jacobian.tocsc()
        for first in range(0, matrix.shape[1], CHUNK):
            some = slice(first, first + CHUNK)
            matrix[:, some] += jacobian.T @ self.weigh(jacobian[:, some].toarray())

    def weigh(self, rows):
        """Inverse covariance of the antenna positions times rows (3k, ...)."""
        if self.noise is None:
            weight = self.equations.stated**-2.0
            return rows * (weight[:, None] if rows.ndim == 2 else weight)
        return self.noise.weigh(rows)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right; products of two halves are what the elimination takes away."""
        right = right.toarray(order="F") if issparse(right) else np.array(right, order="F")
        right *= self.unit[:, None] if right.ndim == 2 else self.unit
        return solve_triangular(
            self.factor, right, lower=True, check_finite=False, overwrite_b=True
        )

    def solve(self, right: np.ndarray) -> np.ndarray:
        """What poses and nuisance (n, k) do about right (n, k)."""
        half = solve_triangular(
            self.factor, self.half(right), lower=True, trans=1, check_finite=False, overwrite_b=True
        )
        return half * self.unit[:, None]

    def columns(self, block):
        """Of one block of columns: half solution (n, p), weighted antenna (3k, p), right (p,).

        The weighted antenna is None where the columns do not touch it.
        """
        e = self.equations
        touched = block.antenna.nnz if issparse(block.antenna) else block.antenna.size
        if not touched:
            half = self.half(block.cross)
            return half, None, block.right - half.T @ self.half_right
        heavy = self.weigh(_dense(block.antenna))
        half = self.half(_dense(block.cross) + e.jacobian.T @ heavy)
        right = block.right + heavy.T @ e.residual - half.T @ self.half_right
        return half, heavy, right

    def reduce(self, but: Container[int] = ()) -> Reduced:
        """M and g of all candidates, but for some of the blocks of per-image columns."""
        e = self.equations
        half, heavy, g = self.columns(e.core)
        M = e.core.inside - half.T @ half
        if heavy is not None:
            M += e.core.antenna.T @ heavy
        here = e.core.value
        g = g + M @ here
        count = len(e.own)
        out = Reduced(
            M,
            g,
            [None] * count,
            [None] * count,
            [None] * count,
            {},
            e.groups,
        )
        halves: dict[int, np.ndarray] = {}
        for n, (block, cross) in enumerate(zip(e.own, e.between, strict=True)):
            if n in but:
                continue
            mine, own_heavy, right = self.columns(block)
            for i, other in halves.items():
                both = -(other.T @ mine)
                if (i, n) in e.mutual:
                    both += e.mutual[i, n]
                if own_heavy is not None:
                    both += _dense(e.own[i].antenna.T @ own_heavy)
                out.mutual[i, n] = both
            halves[n] = mine
            inside = -(mine.T @ mine)
            inside += block.inside
            with_core = cross - mine.T @ half
            if own_heavy is not None:
                inside += _dense(block.antenna.T @ own_heavy)
            if heavy is not None:
                with_core = with_core + _dense(block.antenna.T @ heavy)
            # What has been estimated counts as missing again: in all that is tested.
            out.own_g[n] = right + inside @ block.value + with_core @ here
            out.g = out.g + with_core.T @ block.value
            out.own_matrix[n], out.between[n] = inside, with_core
        for (i, j), both in out.mutual.items():
            out.own_g[i] += both @ e.own[j].value
            out.own_g[j] += both.T @ e.own[i].value
        return out

    def antennas(self) -> Antennas:
        """M and g of the antenna positions; like those of `reduce` they are of no effect at all."""
        e = self.equations
        unit = self.weigh(np.eye(len(e.residual)))
        half = self.half(e.jacobian.T @ unit)
        g = unit @ e.residual - half.T @ self.half_right
        core_half, core_heavy, _ = self.columns(e.core)
        core = core_heavy - half.T @ core_half
        g = g + core @ e.core.value
        own = []
        for block in e.own:
            # Several values for each image tell of the picture; the antenna hardly feels them.
            few = len(block.value) <= len(e.system.columns.images)
            across = None
            if few or block.value.any():
                mine, heavy, _ = self.columns(block)
                across = -(half.T @ mine)
                if heavy is not None:
                    across += heavy
                g = g + across @ block.value
            own.append(across if few else None)
        unit -= half.T @ half
        return Antennas(unit, g, core, own)


def _dense(matrix):
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)
