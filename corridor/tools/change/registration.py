"""Dates laid together on what stands still.

Where the datum of a date is weak (GNSS of metres, a free network), its whole surface floats. What
the whole block may do moves its points by G, and an S-transformation takes out of changes d the
motion that weighted ones ask for: d~ = S d, S = I - G (G'WG)^-1 G'W. With weights 1 / |d~|, found
again and again, what moves counts less and less, and what stands still carries the datum.

First the second date is moved as a whole until most of it lies on the first (`brought`): else one
linear step would leave the squares of turns of degrees, and a cylinder would look for the surface
where it is not. That motion is a choice of coordinates, not a measurement. Then a motion g t is
taken out of the changes (`lay`); t is itself a linear function of the points, so every variance
stays exact:

    L~ = L - g t,   var L~ = var L - 2 g cov(t, L) + g cov(t) g'

Source: Baarda 1973 (S-transformation); Chen 1983 (iterative weighted similarity transformation);
Chen and Medioni 1992 (distances along the normals).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from corridor.core.geometry import Similarity, helmert_motions, robust_scale, rotation_from_vector
from corridor.tools.change.cores import WANTED, fitted_normals, usual_radius
from corridor.tools.change.epoch import Cloud, Epoch
from corridor.tools.change.joint import Joint

# Motions that a datum can take out: everything, without scale, position alone.
MOTIONS = {"similarity": 7, "rigid": 6, "translation": 3}
# Displacements below this share of their own sigma weigh no more for being smaller.
FLOOR = 0.3
PASSES = 100
# A second date is brought near in so many steps, by so many points at most: enough for a motion
# of seven numbers. The last step moves none of them by more (m).
MOST_ITERATIONS, SAMPLE_SIZE, NEAR_M = 30, 700, 1e-3
# Core points whose covariance tells how many of them are independent.
SOME = 100
# What the median of sizes is worth, against the mean square (Rousseeuw and Croux 1993).
EFFICIENCY = 0.367


def motions_at(xyz: np.ndarray, kind: str, middle: np.ndarray | None = None) -> np.ndarray:
    """G (n, 3, k): what the whole block may do, by its points (n, 3); middle (default: theirs)."""
    return helmert_motions(xyz, middle)[:, :, : MOTIONS[kind]]


def s_transformation(motions: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The k x n matrix that finds the motion in displacements: (G'WG)^-1 G'W."""
    heavy = weight[:, None] * motions
    return np.linalg.pinv(motions.T @ heavy, rcond=1e-12) @ heavy.T


def stable_weights(change: np.ndarray, motions: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Weights (n,) under which the sum of |S d| is least: large where nothing moves.

    change, sigma (n,): numbers with their standard deviations. motions (n, k).
    """
    weight = sigma**-2.0
    for _ in range(PASSES):
        moved = change - motions @ (s_transformation(motions, weight) @ change)
        new = 1.0 / (sigma * np.maximum(np.abs(moved), FLOOR * sigma))
        done = np.abs(new - weight).max() < 1e-6 * new.max()
        weight = new
        if done:
            break
    return weight


def registered(before: Cloud, after: Cloud, kind: str, same_ties: bool) -> Cloud:
    """The second cloud where it lies on the first; kind: of `MOTIONS`.

    same_ties: the surfaces are the same points one for one; else the distances along the normals
    of the first to the points beside in plan count. Too few points stay where they are.
    """
    if min(len(before.surface), len(after.surface)) <= WANTED:
        return after
    few = slice(None, None, max(len(after.surface) // SAMPLE_SIZE, 1))
    there = after.epoch.system.state.points[after.surface[few]]
    beside = None if same_ties else _Beside(before.xyz, after.xyz)
    laid = after.epoch.laid or Similarity(1.0, np.eye(3), np.zeros(3))
    for _ in range(MOST_ITERATIONS):
        here = laid.apply(there)
        motions = motions_at(here, kind)
        if beside is None:
            away = (before.xyz[few] - here).ravel()
            motions = motions.reshape(len(away), -1)
        else:
            away, normal, kept = beside(here)
            motions = np.einsum("nx,nxm->nm", normal, motions[kept])
        if len(away) <= motions.shape[1]:
            break
        weight = stable_weights(away, motions, np.ones(len(away)))
        laid = _moved(laid, s_transformation(motions, weight) @ away, here.mean(axis=0))
        if np.abs(laid.apply(there) - here).max() < NEAR_M:
            break
    return replace(after, epoch=Epoch(after.epoch.adjustment, laid))


class _Beside:
    """The points of the first date that are nearest in plan, along their normals."""

    def __init__(self, before: np.ndarray, after: np.ndarray):
        self.radius = usual_radius(before, after)
        self.xyz, self.tree = before, cKDTree(before[:, :2])

    def __call__(self, here: np.ndarray):
        """How far (k,), m, points (n, 3) are away along normals (k, 3), and which of them count."""
        far, nearest = self.tree.query(here[:, :2])
        kept = np.flatnonzero(far < self.radius)
        beside = self.xyz[nearest[kept]]
        normal = fitted_normals(self.xyz, beside, 1.5 * self.radius)
        return np.einsum("nk,nk->n", normal, beside - here[kept]), normal, kept


def _moved(laid: Similarity, step: np.ndarray, middle: np.ndarray) -> Similarity:
    """The similarity followed by a small motion about a middle: shift, turn, growth."""
    shift, turn, growth = np.split(np.concatenate([step, np.zeros(7 - len(step))]), [3, 6])
    scale, rotation = 1.0 + float(growth[0]), rotation_from_vector(turn)
    translation = scale * rotation @ (laid.translation - middle) + middle + shift
    return Similarity(scale * laid.scale, rotation @ laid.rotation, translation)


@dataclass(frozen=True, eq=False)
class Registration:
    """A motion that was taken out of changes. kind: of `MOTIONS`; middle (3,), m: of the
    rotation; gain (k, m): of the changes by it; found: it as functions of the points; motion (m,):
    m, rad, share; stable (k,): which changes carry the datum. scale: how many times as much as
    their standard deviations say the changes scatter, at least 1; freedom: degrees of freedom of
    that.
    """

    kind: str
    middle: np.ndarray
    gain: np.ndarray
    found: csr_array
    motion: np.ndarray
    stable: np.ndarray
    scale: float = 1.0
    freedom: float = np.inf

    def scaled(
        self, joint: Joint, functions: csr_array, left: np.ndarray, sampling: np.ndarray
    ) -> Registration:
        """The registration with the scale of changes over their standard deviations, left (k,).

        Most core points stand still: what they scatter beyond their sigma is error that the
        adjustments do not know, as of GNSS of metres, which is not white. Scatter below the stated
        one is chance and does not count. How many of the changes are independent is told by the
        covariance of some, without the motion; sampling (k,): variances that are of each alone.
        Source: Satterthwaite 1946.
        """
        some = np.unique(np.linspace(0, len(left) - 1, SOME).astype(int))
        few, gain = functions[some], self.gain[some]
        across = joint.covariance(few, self.found) @ gain.T
        covariance = joint.covariance(few) - across - across.T
        covariance += gain @ joint.covariance(self.found) @ gain.T + np.diag(sampling[some])
        sigma = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        independent = len(some) ** 2 / np.sum((covariance / sigma[:, None] / sigma) ** 2)
        return replace(
            self,
            scale=float(robust_scale(left, least=1.0)),
            freedom=float(max(EFFICIENCY * independent, 1.0)),
        )

    def elsewhere(self, functions: csr_array, after: Cloud) -> Registration:
        """The same motion for other changes of the same dates."""
        return replace(self, gain=_gain(functions, after, self.kind, self.middle))

    @property
    def of_motion(self) -> np.ndarray:
        """Changes (k,) by the motion, m."""
        return self.gain @ self.motion

    def apply(self, change: np.ndarray) -> np.ndarray:
        """Changes (k,) without the motion."""
        return change - self.of_motion

    def variance(self, joint: Joint, functions: csr_array, plain: np.ndarray) -> np.ndarray:
        """Variances (k,) of the changes without the motion; plain: of those with it."""
        both = joint.covariance(functions, self.found)
        inner = joint.covariance(self.found)
        out = plain - 2.0 * np.einsum("km,km->k", self.gain, both)
        return out + np.einsum("km,mn,kn->k", self.gain, inner, self.gain)

    def sums(self, functions: csr_array, matrix) -> csr_array:
        """Sums of the changes without the motion, by a matrix (s, k); dense."""
        matrix = csr_array(matrix)
        return csr_array(matrix @ functions - csr_array(matrix @ self.gain) @ self.found)


def lay(
    distance: np.ndarray, sigma: np.ndarray, functions: csr_array, after: Cloud, kind: str
) -> Registration:
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
    found = csr_array(csr_array(finder) @ functions)
    return Registration(kind, middle, gain, found, finder @ distance, stable)


def _gain(functions: csr_array, after: Cloud, kind: str, middle: np.ndarray) -> np.ndarray:
    """Changes (k, m) by a motion of the second date."""
    xyz = after.epoch.xyz
    return functions[:, -3 * len(xyz) :] @ motions_at(xyz, kind, middle).reshape(3 * len(xyz), -1)
