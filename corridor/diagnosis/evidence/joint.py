"""Groups of a model together: M with what is known of their sizes, as a factor that solves.

    [ D  B ]   D: values for each image, in pieces of the block; their size on the diagonal
    [ B' A ]   A: what images share

Values for each image are many, and models that have them differ in the rest: they are eliminated
once for each size they are given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from corridor.diagnosis.system.elimination import Pieces


class Together:
    """M + 1 / kappa^2 of groups (p, p) as one matrix."""

    def __init__(self, M: np.ndarray, kappa: np.ndarray):
        """kappa (p,): prior standard deviations, in those of the parameters."""
        self._factor = cho_factor(M + np.diag(kappa**-2.0), lower=True, check_finite=False)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (p, ...) for right (p, ...)."""
        return cho_solve(self._factor, right, check_finite=False)

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant."""
        return 2.0 * float(np.log(np.diag(self._factor[0])).sum())

    def taken(self, across: np.ndarray) -> np.ndarray:
        """What the groups take away (q, q) from columns that meet them in `across` (p, q)."""
        return across.T @ self.solve(across)


class OfImages:
    """D + 1 / kappa^2 of one group of values for each image, and what it does to the core.

    matrix (p, p); between (p, c): with the core.
    """

    def __init__(self, matrix: Pieces, between: np.ndarray, kappa: float):
        self._spans, self._factors = matrix.spans, []
        for piece in matrix.blocks:
            piece = piece + np.diag(np.full(len(piece), kappa**-2.0))
            self._factors.append(
                cho_factor(piece, lower=True, check_finite=False, overwrite_a=True)
            )
        self.between, self.kappa = between, kappa
        self.solved = self.solve(between)
        self.light = between.T @ self.solved
        self.logdet = 2.0 * float(sum(np.log(np.diag(f[0])).sum() for f in self._factors))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """D^-1 right (p, ...)."""
        each = zip(self._factors, self._spans, strict=True)
        return np.concatenate([cho_solve(f, right[at], check_finite=False) for f, at in each])

    @cached_property
    def variance(self) -> np.ndarray:
        """Diagonal (p,) of D^-1."""
        out = []
        for factor in self._factors:
            out.append(np.diag(cho_solve(factor, np.eye(len(factor[0])), check_finite=False)))
        return np.concatenate(out)


class BesideImages:
    """M + 1 / kappa^2 of a group of values for each image and of groups of the core.

    own: of the values for each image, group `many`, numbers `at` (k,) of the joint system; core
    (r,): columns of the core, numbers `rest` (r,) of the joint system; M (c, c) of all the core;
    kappa (r,).
    """

    def __init__(self, own: OfImages, many: int, at, rest, core, M: np.ndarray, kappa: np.ndarray):
        self.many = many
        self.own, self.at, self.rest, self.core = own, at, rest, core
        self._M, self._kappa = M, kappa
        self._light = M - own.light
        self.left = self._light[np.ix_(core, core)]
        self._together = Together(self.left, kappa) if len(core) else None

    @property
    def logdet(self) -> float:
        """Logarithm of the determinant."""
        return self.own.logdet + (self._together.logdet if self._together else 0.0)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (p, ...) for right (p, ...)."""
        out = np.empty_like(right)
        mine = self.own.solve(right[self.at])
        if self._together is not None:
            left = right[self.rest] - self.own.between[:, self.core].T @ mine
            out[self.rest] = self._together.solve(left)
            mine = mine - self.own.solved[:, self.core] @ out[self.rest]
        out[self.at] = mine
        return out

    def others(self, groups: Iterable[int]) -> list[int]:
        """Of the groups of the model those that images share."""
        return [n for n in groups if n != self.many]

    def solve_others(self, right: np.ndarray) -> np.ndarray:
        """What the others (r, k) do about right (r, k) of their own, the images having followed."""
        return right if self._together is None else self._together.solve(right)

    def times(self, values: np.ndarray) -> np.ndarray:
        """M of the groups times values (p,) that are zero of each image: of the others alone."""
        out, some = np.empty(len(values)), values[self.rest]
        out[self.at] = self.own.between[:, self.core] @ some
        out[self.rest] = self._M[np.ix_(self.core, self.core)] @ some
        return out

    def determined(
        self, right: np.ndarray, inverse: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, csr_array]:
        """Solution (p,) for right (p,), and covariance (p, p): for each image its diagonal alone.

        inverse: of a symmetric matrix, zero in what it does not determine.
        """
        mine, solved = self.own.solve(right[self.at]), self.own.solved[:, self.core]
        rest = inverse(self.left + np.diag(self._kappa**-2.0))
        out = np.empty(len(right))
        out[self.rest] = rest @ (right[self.rest] - self.own.between[:, self.core].T @ mine)
        out[self.at] = mine - solved @ out[self.rest]
        variance = self.own.variance + np.einsum("ij,ij->i", solved @ rest, solved)
        rows = np.concatenate([self.at, np.repeat(self.rest, len(self.rest))])
        columns = np.concatenate([self.at, np.tile(self.rest, len(self.rest))])
        values = np.concatenate([variance, rest.ravel()])
        return out, csr_array((values, (rows, columns)), shape=(len(right),) * 2)

    def taken(self, across: np.ndarray) -> np.ndarray:
        """What the groups take away from all the core (c, c), which `across` (p, c) is with."""
        if self._together is None:
            return self.own.light
        return self.own.light + self._together.taken(self._light[self.core])
