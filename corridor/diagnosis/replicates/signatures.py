"""What residuals share with each physical effect that the model lacks.

An effect moves the modelled observations; poses, points and the believed model follow as far as
they can; what they leave is the effect's signature. Most of an effect is gone by then, and the
rest is far below the noise of a single observation, but all observations share it. With M and g
of the effect's columns after poses and points (see `reduced`), g / sqrt(M) is how many standard
deviations of it the residuals hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from corridor.core.adjustment import Design, LinearSystem, Loss, Sets
from corridor.core.effects import Effect, every_effect
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import take_apart
from corridor.diagnosis.system.groups import make_groups

# Share of an effect that has to be left after absorption: below, rounding would speak.
LEFT = 1e-3
# Control points, flights or cameras up to which each has a signature.
MOST_GROUPS = 12
# Share of the largest information of an image from which on an image counts.
TOUCHED = 1e-6
# Numbers of the design matrix up to which it stays from one set of fits to the next: 120 MB.
KEPT = 15_000_000


class Signatures:
    """Signatures of the physical effects that a model lacks and the block could show.

    names: of effects that leave one, a control point each; absorbed: of those that leave nothing.
    single: of effects that each image has for itself, `slug parameter`.
    """

    def __init__(self, replicator, limit: np.ndarray):
        """limit (n,): px at which residuals of images are cut, 0 of those that have no say."""
        system = replace(replicator.system, loss=Loss())
        effects = _missing_effects(system)
        tested = system.testing(effects)
        p = tested.problem
        numbers = 2 * len(p.img) * (p.d + p.wide)
        self._design = Design(tested, kept=numbers < KEPT)
        self._limit, self._image_weight = (
            np.repeat(of_each, 2)[:, None] for of_each in (limit, self._design.weight)
        )
        columns, gnss = tested.columns, tested.gnss
        groups = make_groups(columns, len(tested.control_names), effects, {})
        e = take_apart(tested, groups)
        self._weight, self._gnss = gnss.sigma.ravel() ** -2.0, gnss.jacobian
        posed = tested.posed
        self._of_posed = posed.jacobian.T * posed.sigma.ravel() ** -2.0
        self._priors = tested.right_of_priors[:, None]
        # Diagonal before anything is eliminated.
        raw = np.zeros(len(columns))
        raw[: len(tested.reference)] = tested.reference
        raw += gnss.jacobian.power(2).T @ self._weight

        eliminated = Elimination(e, None)
        M, _ = eliminated.core
        # What poses and the model follow of each column: N_xx^-1 N_xb.
        self._followed = eliminated.following(np.eye(len(e.at)))
        self._first, self._core, self._unit = e.first, e.at, e.unit[e.at]
        size = np.sqrt(raw[e.at]) * self._unit
        self.names: list[str] = []
        self.absorbed: tuple[str, ...] = ()
        self._turns: list[tuple[np.ndarray, np.ndarray]] = []
        for group in (group for group in groups if group.own is None):
            at = group.columns[size[group.columns] > 0]
            name = group.slug if group.point is None else f"{group.slug} {group.point}"
            if not len(at):
                continue
            own = size[at]
            value, vector = np.linalg.eigh(M[np.ix_(at, at)] / own[:, None] / own)
            good = value > LEFT**2
            if not good.any():
                self.absorbed += (name,)
                continue
            self.names.append(name)
            self._turns.append((at, (vector[:, good] / np.sqrt(value[good])).T / own))
        self.single, self._images = [], []
        for slug in (group.slug for group in groups if group.own is not None):
            for parameter, at in zip(
                columns.parameters[slug], columns.of_image[slug].T, strict=True
            ):
                touched = raw[at] > TOUCHED * raw[at].max()
                self.single.append(f"{slug} {parameter.name}")
                self._images.append((at[touched], raw[at[touched]]))

    def scores(self, fits: Sequence) -> np.ndarray:
        """B'Wr (k, n) by all columns of the residuals of k fits.

        The state is that of the replicator's own fit for all of them.
        """
        gnss = np.stack([fit.gnss.ravel() for fit in fits], axis=1)
        control = np.stack([fit.control.ravel() for fit in fits], axis=1)
        found = self._design.right(Sets([fit.pixels.ravel() for fit in fits], control, self._cut))
        found += self._gnss.T @ (self._weight[:, None] * gnss)
        found += self._of_posed @ np.stack([fit.posed.ravel() for fit in fits], axis=1)
        return (found + self._priors).T

    def _cut(self, rows: slice, pixels: np.ndarray) -> None:
        """Cut residuals (rows, k) and weigh them."""
        limit = self._limit[rows]
        np.clip(pixels, -limit, limit, out=pixels)
        np.nan_to_num(pixels, copy=False)
        pixels *= self._image_weight[rows]

    def strengths(self, score: np.ndarray) -> np.ndarray:
        """What residuals share with each effect (names,), in standard deviations.

        With its sign where an effect has one direction, else the length over all of them.
        """
        g = score[self._core] * self._unit - self._followed.T @ score[self._first]
        rows = [turn @ g[at] for at, turn in self._turns]
        return np.array([row[0] if len(row) == 1 else np.linalg.norm(row) for row in rows])

    def in_single_images(self, score: np.ndarray) -> np.ndarray:
        """RMS over the images (single,), in standard deviations before absorption."""
        return np.array([np.sqrt(np.mean(score[at] ** 2 / raw)) for at, raw in self._images])


def _missing_effects(system: LinearSystem) -> list[Effect]:
    """Physical effects that the model lacks and the block could show."""
    block, controls = system.block, len(system.control_names)
    counts = {"camera": len(block.cameras), "flight": len(block.flight_names), "point": controls}
    out = []
    for effect in every_effect():
        if effect.generic or effect.slug in system.columns.parameters or effect.missing(block):
            continue
        if effect.place == "antenna" and not len(system.gnss.names):
            continue
        if effect.place == "ground" and not controls:
            continue
        if counts.get(effect.group, 1) <= MOST_GROUPS:
            out.append(effect)
    return out
