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
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from corridor.core.adjustment import Columns, LinearSystem, point_regression
from corridor.core.effects import Effect, candidates
from corridor.tools.change.epoch import Epoch, Spread

# Share of an effect's own information that must be left, or rounding would speak.
LEFT = 1e-9
# m: what moves nothing by more has no shape on the ground, but that of rounding.
NOTHING_M = 1e-9
# Log evidence from which on the measurements of an epoch show an effect: a Bayes factor reaches k
# by chance in one of k draws at most (Markov), so that one in a hundred blocks without any would
# show one of some forty candidates.
SHOWN_LOG_EVIDENCE = 8.3
# Effects of single images are asked of so many, evenly spread: enough to show them, and a matrix
# of bounded size.
MOST_IMAGES = 100


class Estimate(NamedTuple):
    """Values of some effects' parameters and their covariance, prior standard deviations known."""

    value: np.ndarray
    covariance: np.ndarray


class Signatures:
    """Effects of the catalogue that an epoch could have and its model lacks.

    effects: by slug. labels (e,): `SLUG.parameter`, with the group where there are several; slug
    (e,); scale (e,): prior standard deviations. matrix, right: M and g, in units of these scales.
    """

    def __init__(self, epoch: Epoch):
        self.epoch = epoch
        effects = _candidates(epoch.system)
        self.effects = {effect.slug: effect for effect in effects}
        system = epoch.system
        self._tested = tested = system.testing(effects)
        columns, gnss = tested.columns, tested.gnss
        parts = [_numbers(columns, effect.slug) for effect in effects]
        self._at = at = np.concatenate([*parts, []]).astype(int)
        first = _same_columns(system, tested)
        self.slug = np.repeat(np.array(list(self.effects), dtype=object), [len(p) for p in parts])
        self.labels = [columns.labels[n] for n in at.tolist()]
        unit = {(e, p.name): p.unit for e in self.effects for p in columns.parameters[e]}
        names = [label.rpartition(".")[2] for label in self.labels]
        self.units = [unit[key] for key in zip(self.slug, names, strict=True)]
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
        gains = point_regression(self._tested, spread.points)
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

    @property
    def named(self) -> set[str]:
        """Those that are physical causes, not shapes that stand for the unknown."""
        return {slug for slug, effect in self.effects.items() if not effect.generic}

    @cached_property
    def unknown(self) -> set[str]:
        """Shapes that stand for the unknown and that the measurements show beside named effects."""
        named = self.shown()
        return self.shown(set(self.effects) - self.named, sorted(named)) - named

    def shown(
        self, among: Iterable[str] | None = None, beside: Iterable[str] = (), most: int = 4
    ) -> set[str]:
        """Effects that the measurements show, the strongest first, each beside those before.

        among: the choice (default: the named ones); beside: those that are taken as there.
        """
        choice = sorted(self.named if among is None else among)
        found, end = list(beside), len(list(beside)) + most
        while len(found) < end:
            others = [slug for slug in choice if slug not in found]
            if not others:
                break
            gains = [self.log_evidence([*found, slug]) for slug in others]
            best = int(np.argmax(gains))
            if gains[best] - self.log_evidence(found) < SHOWN_LOG_EVIDENCE:
                break
            found.append(others[best])
        return set(found)


def _candidates(system: LinearSystem) -> list[Effect]:
    found = candidates(
        system.block, system.free, system.effects.values(), list(system.control_names)
    )
    # Wrong ground control is no camera's: it shows in control that is common to both dates.
    return [
        effect
        for effect in found.effects
        if effect.place != "ground" and effect.slug not in system.columns.parameters
    ]


def _numbers(columns: Columns, slug: str) -> np.ndarray:
    """Numbers (k,) of an effect's unknowns, of some images where each has its own."""
    if slug not in columns.of_image:
        return columns.of(slug)
    own = columns.of_image[slug]
    return own[np.unique(np.linspace(0, len(own) - 1, MOST_IMAGES).astype(int))].ravel()


def _same_columns(system: LinearSystem, tested: LinearSystem) -> np.ndarray:
    """Numbers (n,) in the tested system of the columns of the system."""
    number = {label: at for at, label in enumerate(tested.columns.labels)}
    return np.array([number[label] for label in system.columns.labels], dtype=int)
