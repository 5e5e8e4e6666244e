"""Candidates after poses, camera and lever arms have had their say.

With B the candidates' columns, W the weights and Q = I - A (A'WA)^-1 A'W what poses, points and
nuisance A leave, the candidates meet

    M = B'WQB,    g = B'WQr

M theta = g is one more step of Newton's; under the null hypothesis g ~ N(0, M).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_array, issparse

from corridor.diagnosis.candidates import Group
from corridor.diagnosis.equations import Equations


@dataclass
class Reduced:
    """M and g of the core (c, c), (c,), of each block of per-image columns, and between them.

    between: of each block with the core; mutual: (i, j) -> of two blocks, i < j.

    g is that of no effect at all: where candidates stand at a value, their part has been put
    back. here: (c,) values of the core's parameters at the linearisation, in prior sigmas;
    own_here: of the per-image blocks.
    """

    M: np.ndarray
    g: np.ndarray
    own_matrix: list[np.ndarray]
    own_g: list[np.ndarray]
    between: list[np.ndarray]
    mutual: dict[tuple[int, int], np.ndarray]
    groups: list[Group]
    here: np.ndarray
    own_here: list[np.ndarray]


class Elimination:
    """Poses and nuisance of equations eliminated, for one covariance of the GNSS."""

    def __init__(self, equations: Equations, noise):
        """noise: `GnssNoise`; or None for the stated standard deviations."""
        self.equations, self.noise = equations, noise
        e = equations
        matrix = e.matrix.copy()
        self.right = e.right.copy()
        self.heavy = csr_array((0, len(e.right)))
        if len(e.residual):
            self.heavy = self.weigh(e.jacobian)
            matrix += (e.jacobian.T @ self.heavy).toarray()
            self.right += self.heavy.T @ e.residual
        if e.free_motions is not None:
            g = e.free_motions / np.linalg.norm(e.free_motions, axis=0)
            matrix += np.median(np.diag(matrix)) * (g @ g.T)
        # In units of their own weight, or metres and radians would meet.
        self.unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        matrix *= self.unit[:, None]
        matrix *= self.unit
        self.factor = _factor(matrix)
        self.half_right = self.half(self.right)

    def weigh(self, rows):
        """Inverse covariance of the antenna positions times rows (3k, ...)."""
        if self.noise is None:
            weight = self.equations.stated**-2.0
            if issparse(rows):
                return csr_array(rows.multiply(weight[:, None]))
            return rows * (weight[:, None] if rows.ndim == 2 else weight)
        return self.noise.weigh(rows)

    def half(self, right: np.ndarray) -> np.ndarray:
        """L^-1 right; products of two halves are what the elimination takes away."""
        right = right.toarray() if issparse(right) else right
        scaled = right * (self.unit[:, None] if right.ndim == 2 else self.unit)
        return solve_triangular(self.factor, scaled, lower=True, check_finite=False)

    def columns(self, block):
        """Of one block of columns: half solution (n, p), weighted antenna (3k, p), right (p,)."""
        e = self.equations
        if not len(e.residual):
            half = self.half(block.cross)
            return half, np.zeros((0, half.shape[1])), block.right - half.T @ self.half_right
        heavy = self.weigh(block.antenna)
        heavy = heavy.toarray() if issparse(heavy) else heavy
        cross = block.cross.toarray() if issparse(block.cross) else block.cross
        half = self.half(cross + e.jacobian.T @ heavy)
        right = block.right + heavy.T @ e.residual - half.T @ self.half_right
        return half, heavy, right

    def reduce(self) -> Reduced:
        """M and g of all candidates."""
        e = self.equations
        half, heavy, g = self.columns(e.core)
        M = e.core.inside + e.core.antenna.T @ heavy if len(e.residual) else e.core.inside
        M = M - half.T @ half
        here = e.core.value
        g = g + M @ here
        own_matrix, own_g, between, own_here = [], [], [], []
        mutual, halves = {}, []
        for n, (block, cross) in enumerate(zip(e.own, e.between, strict=True)):
            mine, own_heavy, own_right = self.columns(block)
            for i, other in enumerate(halves):
                both = -(other.T @ mine)
                if (i, n) in e.mutual:
                    both += e.mutual[i, n].toarray()
                if len(e.residual):
                    both += _dense(e.own[i].antenna.T @ own_heavy)
                mutual[i, n] = both
            halves.append(mine)
            inside = _dense(block.inside) - mine.T @ mine
            with_core = cross - mine.T @ half
            if len(e.residual):
                inside = inside + _dense(block.antenna.T @ own_heavy)
                with_core = with_core + _dense(block.antenna.T @ heavy)
            value = block.value
            # What has been estimated counts as missing again: in all that is tested.
            own_right = own_right + inside @ value + with_core @ here
            g = g + with_core.T @ value
            own_matrix.append(inside)
            own_g.append(own_right)
            between.append(with_core)
            own_here.append(value)
        for (i, j), both in mutual.items():
            own_g[i] += both @ own_here[j]
            own_g[j] += both.T @ own_here[i]
        return Reduced(M, g, own_matrix, own_g, between, mutual, e.groups, here, own_here)

    def antennas(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray | None]]:
        """M (3k, 3k) and g (3k,) of one unit column for each antenna coordinate.

        They say all that the rest of the block knows of the GNSS noise; like those of `reduce`
        they are of no effect at all. Then M between them and the core (3k, c), and between them
        and each block of per-image columns, None where the block cannot touch the antenna much.
        """
        e = self.equations
        unit = self.weigh(np.eye(len(e.residual)))
        half = self.half(e.jacobian.T @ unit)
        g = unit @ e.residual - half.T @ self.half_right
        core_half, core_heavy, _ = self.columns(e.core)
        core = core_heavy - half.T @ core_half
        g = g + core @ e.core.value
        own = []
        for block in e.own:
            mine, heavy, _ = self.columns(block)
            across = heavy - half.T @ mine
            g = g + across @ block.value
            # Several values for each image tell of the picture; the antenna hardly feels them.
            own.append(across if len(block.value) <= e.problem.image_count else None)
        return unit - half.T @ half, g, core, own


def _dense(matrix):
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)


def _factor(matrix: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor; what nothing determines is held a little."""
    try:
        return cholesky(matrix, lower=True, check_finite=False)
    except np.linalg.LinAlgError:
        held = matrix + 1e-10 * np.eye(len(matrix))
        return cholesky(held, lower=True, check_finite=False)
