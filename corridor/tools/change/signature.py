"""What an effect of the camera in one epoch, not modelled, does to the ground of that epoch.

With e the parameters of effects, u the unknowns of the adjustment, N the reduced equations of both,

    M = N_ee - N_eu Q N_ue          what the measurements of the epoch say of e
    g = t_e - N_eu Q t_u            which way
    G = -S_e + S_u Q N_ue           change of functions F P (S = -F K') by a unit of e

so a function loses G e^ and gains G (M + prior)^-1 G' in its covariance when the effects are
estimated: what would remain, without adjusting anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from corridor.core.adjustment import LinearSystem, point_gains
from corridor.core.effects import Effect, candidates
from corridor.tools.change.epoch import Epoch, Spread

# Places of effects that belong to camera and flight; wrong ground control is no camera's.
PLACES = ("camera", "image", "motion", "antenna")
# Share of an effect's own information that must be left, or rounding would speak.
LEFT = 1e-9
# m: what moves nothing by more has no shape on the ground, but that of rounding.
NOTHING_M = 1e-9
# Log evidence from which on the measurements of an epoch show an effect: one in a hundred blocks
# without any would show one of some twenty candidates.
SHOWN = 7.6


class Estimate(NamedTuple):
    """Values of some effects' parameters and their covariance, prior standard deviations known."""

    value: np.ndarray
    covariance: np.ndarray


class Signatures:
    """Effects of the catalogue that an epoch could have and its model lacks.

    labels (e,): `SLUG.parameter`, with the group where there are several; slug (e,); scale (e,):
    prior standard deviations. matrix, right: M and g, in units of these scales.
    """

    def __init__(self, epoch: Epoch):
        self.epoch = epoch
        effects = _candidates(epoch.system)
        self.effects = {effect.slug: effect for effect in effects}
        system = epoch.system
        self._tested = tested = system.testing(effects)
        columns, gnss = tested.columns, tested.gnss
        self._at = at = np.concatenate([columns.of(e.slug) for e in effects] or [[]]).astype(int)
        first = _same_columns(system, tested)
        unknown = dict(zip(columns.shared_at.tolist(), columns.shared, strict=True))
        found = [unknown[n] for n in at.tolist()]
        self.slug = np.array([u.owner for u in found], dtype=object)
        self.labels = [u.label for u in found]
        self.units = [u.unit for u in found]
        self.scale = columns.scale[at]
        weight = gnss.sigma.ravel() ** -2.0
        by_gnss = csr_array(gnss.jacobian[:, at]).toarray()
        heavy = weight[:, None] * by_gnss
        matrix = tested.matrix
        across = np.asarray(matrix[:, at].todense())
        cross = across[first] + gnss.jacobian[:, first].T @ heavy
        inside = across[at] + by_gnss.T @ heavy
        right = tested.right[at] + heavy.T @ gnss.residual.ravel()
        own = tested.right[first] + gnss.jacobian[:, first].T @ (weight * gnss.residual.ravel())
        self._followed = self.epoch.solve(cross)
        s = self.scale
        variance = self.epoch.sigma0**2
        information = inside - cross.T @ self._followed
        # What poses and camera absorb to the last digit has no information of its own.
        floor = LEFT * np.diag(inside)
        known = np.diag(information) > floor
        information[~known] = information[:, ~known] = 0.0
        gradient = np.where(known, right - self._followed.T @ own, 0.0)
        self.matrix = 0.5 * (information + information.T) * s[:, None] * s / variance
        self.right = gradient * s / variance

    def of(self, slugs: Iterable[str]) -> np.ndarray:
        """Numbers of the parameters of some effects."""
        return np.flatnonzero(np.isin(self.slug, list(slugs)))

    def on(self, spread: Spread) -> np.ndarray:
        """G (r, e): change of functions by one prior standard deviation of each parameter."""
        gains = point_gains(self._tested, spread.points)
        direct = spread.rows @ gains.gain[self._at].T.toarray()
        through = spread.through @ self._followed
        moved = (direct + through) * self.scale
        return np.where(np.abs(moved).max(axis=0, initial=0.0) > NOTHING_M, moved, 0.0)

    def estimate(self, some: np.ndarray, free: bool = False) -> Estimate:
        """The parameters some (k,) from the measurements of the epoch, in prior sigmas.

        With their priors, which keep in bounds what the measurements do not tell; free: without.
        """
        matrix = self.matrix[np.ix_(some, some)]
        prior = 0.0 if free else 1.0
        covariance = np.linalg.pinv(matrix + prior * np.eye(len(some)), rcond=1e-12)
        return Estimate(covariance @ self.right[some], covariance)

    def log_evidence(self, slugs: Iterable[str]) -> float:
        """Log Bayes factor of effects with their priors, against a model without them."""
        at = self.of(slugs)
        if not len(at):
            return 0.0
        matrix, right = self.matrix[np.ix_(at, at)] + np.eye(len(at)), self.right[at]
        _, volume = np.linalg.slogdet(matrix)
        return float(0.5 * right @ np.linalg.solve(matrix, right) - 0.5 * volume)

    def shown(self, most: int = 4) -> set[str]:
        """Effects that the measurements show, the strongest first, each beside those before."""
        found: list[str] = []
        while len(found) < min(most, len(self.effects)):
            others = [slug for slug in self.effects if slug not in found]
            gains = [self.log_evidence([*found, slug]) for slug in others]
            best = int(np.argmax(gains))
            if gains[best] - self.log_evidence(found) < SHOWN:
                break
            found.append(others[best])
        return set(found)


def _candidates(system: LinearSystem) -> list[Effect]:
    found = candidates(
        system.block, system.free, system.effects.values(), list(system.control_names)
    )
    return [
        effect
        for effect in found.effects
        if effect.place in PLACES
        and not effect.generic
        and effect.group not in ("image", "point")
        and effect.slug not in system.columns.parameters
    ]


def _same_columns(system: LinearSystem, tested: LinearSystem) -> np.ndarray:
    """Numbers (n,) in the tested system of the columns of the system."""
    m, d = tested.problem.image_count, tested.problem.d
    if d != system.problem.d:
        raise ValueError("an effect of single images is tested")
    numbers = tested.columns.shared_at.tolist()
    names = {str(one): at for at, one in zip(numbers, tested.columns.shared, strict=True)}
    shared = [names[str(unknown)] for unknown in system.columns.shared]
    return np.concatenate([np.arange(m * d), np.array(shared, dtype=int)])
