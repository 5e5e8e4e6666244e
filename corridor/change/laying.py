"""Surfaces laid together on what stands still.

Where the datum of an epoch is weak (GNSS of metres, a free network), its whole surface floats. A
motion g t of the second epoch, g = n . G(x) at each core point, is taken out so that the stable
core points agree; t is itself a linear function of the points, so every variance stays exact:

    L~ = L - g t,   var L~ = var L - 2 g cov(t, L) + g cov(t) g'
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from corridor.change.clouds import Functions
from corridor.change.cores import Cores
from corridor.change.joint import Joint
from corridor.change.stable import motions_at, s_transformation, stable_weights

# Neighbouring core points err together, as some ten independent ones: by chance their scatter is
# beyond 1.5 times what it should be once in eighty (chi square of ten).
DOUBTLESS = 1.5


@dataclass(frozen=True, eq=False)
class Laying:
    """A motion that was taken out of changes. kind: of `stable.MOTIONS`; middle (3,), m: of the
    rotation; gain (k, m): of the changes by it; found: it as functions of the points; motion (m,):
    m, rad, share; stable (k,): which changes carry the datum. scale: how many times as much as
    their standard deviations say the changes scatter; 1 unless that is beyond doubt.
    """

    kind: str
    middle: np.ndarray
    gain: np.ndarray
    found: Functions
    motion: np.ndarray
    stable: np.ndarray
    scale: float = 1.0

    def scaled(self, left: np.ndarray) -> Laying:
        """The laying with the scale of changes over their standard deviations, left (k,).

        Most core points stand still: what they scatter beyond their sigma is error that the
        adjustments do not know, as of GNSS of metres, which is not white.
        """
        scale = float(1.4826 * np.median(np.abs(left)))
        return replace(self, scale=scale if scale > DOUBTLESS else 1.0)

    def elsewhere(self, cores: Cores) -> Laying:
        """The same motion for the changes at other core points."""
        return replace(self, gain=_gain(cores, self.kind, self.middle))

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


def lay(
    distance: np.ndarray, sigma: np.ndarray, functions: Functions, cores: Cores, kind: str
) -> Laying:
    """The motion that makes most core points stand still, robustly. sigma (k,): of each alone."""
    middle = cores.xyz.mean(axis=0)
    gain = _gain(cores, kind, middle)
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
    return Laying(kind, middle, gain, functions.combined(finder), finder @ distance, stable)


def _gain(cores: Cores, kind: str, middle: np.ndarray) -> np.ndarray:
    """Changes (k, m) along the normals by a motion of the second date."""
    motions = motions_at(cores.xyz, kind, middle).reshape(len(cores), 3, -1)
    return np.einsum("kx,kxm->km", cores.normal, motions)
