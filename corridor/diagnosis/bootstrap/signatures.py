"""What residuals share with each physical effect that the model lacks.

An effect moves the modelled observations; poses, points and the believed model follow as far as
they can; what they leave is the effect's signature. Most of an effect is gone by then, and the
rest is far below the noise of a single observation, but all observations share it. With M and g
of the effect's columns after poses and points (see `elimination`), g / sqrt(M) is how many standard
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
# Numbers of the design matrix up to which it stays from one set of fits to the next: 120 MB.
KEPT = 15_000_000


class Signatures:
    """Signatures of the physical effects that a model lacks and the block could show.

    names: of effects that leave one, a control point each; absorbed: of those that leave nothing.
    """

    def __init__(self, replicator, limit: np.ndarray):
        """limit (n,): px at which residuals of images are cut, 0 of those that have no say."""
        system = replace(replicator.system, loss=Loss())
        effects = _missing_effects(system)
        tested = system.testing(effects)
        p = tested.problem
        self._design = Design(tested, kept=2 * len(p.img) * (p.d + p.wide) < KEPT)
        self._limit, self._weight = (
            np.repeat(of_each, 2)[:, None] for of_each in (limit, self._design.weight)
        )
        self._of_posed, self._of_distance = (
            rows.jacobian.T * rows.sigma.ravel() ** -2.0 for rows in (tested.posed, tested.distance)
        )
        self._priors = tested.right_of_priors[:, None]
        groups = make_groups(tested.columns, len(tested.control_names), effects, {})
        e = take_apart(tested, groups)
        self._elimination = Elimination(e, None)
        M, _ = self._elimination.core
        # Diagonal before anything is eliminated.
        raw = tested.gnss.jacobian.power(2).T @ e.stated**-2.0
        raw[: len(tested.reference)] += tested.reference
        size = np.sqrt(raw[e.at]) * e.unit[e.at]
        self.names: list[str] = []
        self.absorbed: tuple[str, ...] = ()
        self._turns: list[tuple[np.ndarray, np.ndarray]] = []
        for group in groups:
            at = group.columns[size[group.columns] > 0]
            name = group.slug if group.single is None else f"{group.slug} {group.single}"
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

    def strengths(self, fits: Sequence) -> np.ndarray:
        """What residuals of k fits share with each effect (k, names), in standard deviations.

        With its sign where an effect has one direction, else the length over all of them. The
        state is that of the replicator's own fit for all of them.
        """
        gnss, control, posed, distance = (
            np.stack([getattr(fit, of).ravel() for fit in fits], axis=1)
            for of in ("gnss", "control", "posed", "distance")
        )
        right = self._design.right(Sets([fit.pixels.ravel() for fit in fits], control, self._cut))
        right += self._of_posed @ posed + self._of_distance @ distance
        g = self._elimination.scores(right + self._priors, gnss)
        each = [turn @ g[at] for at, turn in self._turns]
        rows = [row[0] if len(row) == 1 else np.linalg.norm(row, axis=0) for row in each]
        return np.array(rows).reshape(len(rows), len(fits)).T

    def _cut(self, rows: slice, pixels: np.ndarray) -> None:
        """Cut residuals (rows, k) and weigh them."""
        limit = self._limit[rows]
        np.clip(pixels, -limit, limit, out=pixels)
        np.nan_to_num(pixels, copy=False)
        pixels *= self._weight[rows]


def _missing_effects(system: LinearSystem) -> list[Effect]:
    """Physical effects that images share, the model lacks and the block could show."""
    block, controls = system.block, len(system.control_names)
    counts = {
        "camera": len(block.cameras), "flight": len(block.flight_names), "point": controls,
        "distance": len(system.problem.distance_rows),
    }  # fmt: skip
    out = []
    for effect in every_effect():
        if effect.generic or effect.group == "image" or effect.missing(block):
            continue
        if effect.slug in system.columns.parameters:
            continue
        if effect.place == "antenna" and not len(system.gnss.names):
            continue
        if counts.get(effect.group, 1) == 0 or (effect.place == "ground" and not controls):
            continue
        if counts.get(effect.group, 1) <= MOST_GROUPS:
            out.append(effect)
    return out
