"""Surfaces laid together on what stands still.

Where the datum of an epoch is weak (GNSS of metres, a free network), its whole surface floats. A
motion g t of the second epoch is taken out so that the stable core points agree; g is what the
motions G(x) of its points do to the change at a core point. t is itself a linear function of the
points, so every variance stays exact:

    L~ = L - g t,   var L~ = var L - 2 g cov(t, L) + g cov(t) g'
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from corridor.change.clouds import Cloud, Functions
from corridor.change.joint import Joint
from corridor.change.stable import motions_at, s_transformation, stable_weights
from corridor.geometry import robust_scale

# Core points whose covariance tells how many of them are independent.
SOME = 100
# What the median of sizes is worth, against the mean square (Rousseeuw and Croux 1993).
EFFICIENCY = 0.367


@dataclass(frozen=True, eq=False)
class Laying:
    """A motion that was taken out of changes. kind: of `stable.MOTIONS`; middle (3,), m: of the
    rotation; gain (k, m): of the changes by it; found: it as functions of the points; motion (m,):
    m, rad, share; stable (k,): which changes carry the datum. scale: how many times as much as
    their standard deviations say the changes scatter, at least 1; freedom: degrees of freedom of
    that.
    """

    kind: str
    middle: np.ndarray
    gain: np.ndarray
    found: Functions
    motion: np.ndarray
    stable: np.ndarray
    scale: float = 1.0
    freedom: float = np.inf

    def scaled(self, left: np.ndarray, independent: float) -> Laying:
        """The laying with the scale of changes over their standard deviations, left (k,).

        Most core points stand still: what they scatter beyond their sigma is error that the
        adjustments do not know, as of GNSS of metres, which is not white. independent: how many
        of the changes are. Scatter below the stated one is chance and does not count.
        """
        scale = float(robust_scale(left, least=1.0))
        return replace(self, scale=scale, freedom=max(EFFICIENCY * independent, 1.0))

    def independent(self, joint: Joint, functions: Functions, sampling: np.ndarray) -> float:
        """How many of the changes without the motion are independent, by their covariance.

        sampling (k,): variances that are of each alone. Source: Satterthwaite 1946.
        """
        some = np.unique(np.linspace(0, len(functions) - 1, SOME).astype(int))
        few, gain = functions[some], self.gain[some]
        across = joint.covariance(few, self.found) @ gain.T
        covariance = joint.covariance(few) - across - across.T
        covariance += gain @ joint.covariance(self.found) @ gain.T + np.diag(sampling[some])
        sigma = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        return float(len(some) ** 2 / np.sum((covariance / sigma[:, None] / sigma) ** 2))

    def elsewhere(self, functions: Functions, after: Cloud) -> Laying:
        """The same motion for other changes of the same dates."""
        return replace(self, gain=_gain(functions, after, self.kind, self.middle))

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
    distance: np.ndarray, sigma: np.ndarray, functions: Functions, after: Cloud, kind: str
) -> Laying:
    """The motion of the second cloud that makes most changes (k,) none, robustly.

    sigma (k,): of each alone.
    """
    middle = after.xyz.mean(axis=0)
    gain = _gain(functions, after, kind, middle)
    weight = stable_weights(distance, gain, sigma)
    stable = np.ones(len(distance), dtype=bool)
    for _ in range(10):
        finder = s_transformation(gain, weight)
        left = distance - gain @ (finder @ distance)
        usual = robust_scale(left[stable] / sigma[stable], least=1e-12)
        new = np.abs(left) < 3.0 * usual * sigma
        weight = new / sigma**2
        if np.array_equal(new, stable):
            break
        stable = new
    finder = s_transformation(gain, weight)
    return Laying(kind, middle, gain, functions.combined(finder), finder @ distance, stable)


def _gain(functions: Functions, after: Cloud, kind: str, middle: np.ndarray) -> np.ndarray:
    """Changes (k, m) by a motion of the second date."""
    xyz = after.epoch.xyz
    return functions.after @ motions_at(xyz, kind, middle).reshape(3 * len(xyz), -1)
