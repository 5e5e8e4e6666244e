"""Surfaces laid together on what stands still.

Where the datum of an epoch is weak (GNSS of metres, a free network), its whole surface floats. A
motion g t of the second epoch, g = n . G(x) at each core point, is taken out so that the stable
core points agree; t is itself a linear function of the points, so every variance stays exact:

    L~ = L - g t,   var L~ = var L - 2 g cov(t, L) + g cov(t) g'
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.change.clouds import Functions
from corridor.change.joint import Joint
from corridor.change.stable import motions_at, s_transformation, stable_weights


@dataclass(frozen=True, eq=False)
class Laying:
    """A motion that was taken out of changes. kind: of `stable.MOTIONS`; gain (k, m): of the
    changes by it; found: it as functions of the points; motion (m,): m, rad, share; stable (k,):
    which changes carry the datum.
    """

    kind: str
    gain: np.ndarray
    found: Functions
    motion: np.ndarray
    stable: np.ndarray

    def apply(self, change: np.ndarray) -> np.ndarray:
        """Changes (k,) without the motion."""
        return change - self.gain @ self.motion

    def variance(self, joint: Joint, functions: Functions, plain: np.ndarray) -> np.ndarray:
        """Variances (k,) of the changes without the motion; plain: of those with it."""
        both = joint.covariance(functions, self.found)
        inner = joint.covariance(self.found)
        out = plain - 2.0 * np.einsum("km,km->k", self.gain, both)
        return out + np.einsum("km,mn,kn->k", self.gain, inner, self.gain)

    def sums(self, functions: Functions, matrix) -> Functions:
        """Sums of the changes without the motion, by a matrix (s, k); dense."""
        return functions.combined(matrix).minus(self.found.combined(matrix @ self.gain))


def lay(distance: np.ndarray, sigma: np.ndarray, functions: Functions, cores, kind: str) -> Laying:
    """The motion that makes most core points stand still, robustly. sigma (k,): of each alone."""
    xyz, normal = cores.xyz, cores.normal
    gain = np.einsum("kx,kxm->km", normal, motions_at(xyz, kind).reshape(len(xyz), 3, -1))
    weight = stable_weights(distance, gain, sigma)
    stable = np.ones(len(distance), dtype=bool)
    for _ in range(10):
        finder = s_transformation(gain, weight)
        left = distance - gain @ (finder @ distance)
        usual = 1.4826 * np.median(np.abs(left[stable] / sigma[stable]))
        new = np.abs(left) < 3.0 * max(usual, 1e-12) * sigma
        weight = new / sigma**2
        if np.array_equal(new, stable):
            break
        stable = new
    finder = s_transformation(gain, weight)
    return Laying(kind, gain, functions.combined(finder), finder @ distance, stable)
