"""Draws counterparts of a block from the model one believes in, and fits them as it was.

Every observation anew, from the adjusted model and noise of the sizes and kinds that the residuals
show.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.adjustment import LOSSES, ImageRows, LinearSystem, Loss
from corridor.diagnosis.hold_out import spared
from corridor.diagnosis.linear_fits import LinearFits, Measured
from corridor.diagnosis.residual_noise import (
    GRID,
    TRUST,
    EstimatedNoise,
    Series,
    antenna_noise,
    lengths,
    mended,
    series_of,
)
from corridor.diagnosis.statistics import Fit
from corridor.geometry import UNUSABLE, is_outlier, robust_scale_of_lengths

if TYPE_CHECKING:
    from corridor.adjustment import Adjustment

# Share of the tie observations that no fit uses.
HELD_OUT = 0.05
# The last tenth of a per mille of a step changes no statistic.
TOLERANCE = 1e-3
# With more than this share of unusable residuals there are wrong matches.
WRONG = 0.002
# Tie observations from which on one trial says enough on the noise.
MANY = 20_000
TRIALS = 3
PULL = 2.5


class Replicator:
    """The model one believes in, as an adjustment found it; draws counterparts and fits them.

    held_out: (observations,) bool, image observations that no fit uses. fit: the measured block
    adjusted without them, `Fit`. fits: of counterparts, `LinearFits`. noise: `EstimatedNoise`.
    Blocks with many wrong matches are fitted robustly, the measured one and its counterparts.
    """

    def __init__(self, adjustment: Adjustment):
        system = adjustment.system
        rows = system.image_rows
        self.held_out = _held_out(rows)
        self.sigma, self.is_tie = rows.sigma, rows.tie
        self.check_rows, self.check_points = _check_points(system)
        ground = system.block.ground
        given = ground[["x", "y", "z"]].to_numpy(float)
        self.measured = Measured(
            rows.xy,
            system.gnss.given,
            system.control.given,
            system.columns.shared_prior,
            given[self.check_rows],
        )
        self.check_sigma = system.block.ground_sigma()[self.check_rows]
        self.series: list[Series] = series_of(system)
        system = system.measuring(sigma=np.where(self.held_out, np.inf, self.sigma))
        self.system = replace(system, loss=_loss(adjustment)).minimised(20, TOLERANCE, near=False)
        left, state = self.system.residuals(), self.system.state
        check = state.points[self.check_points] - self.measured.check
        self.fit = Fit(state, left.pixels, left.gnss, left.control, check)
        self.fits = LinearFits(
            self.system, self.measured, self.fit, self.sigma, self.held_out, self.check_points
        )
        self.noise = self._estimate()

    # --- noise -------------------------------------------------------------------------------

    def _estimate(self) -> EstimatedNoise:
        ties = self.is_tie & ~self.held_out
        marks = ~self.is_tie
        scaled = self.fit.pixels / self.sigma[:, None]
        noise = EstimatedNoise(np.sqrt(-2 * np.log1p(-np.minimum(GRID, 1 - 1e-9))))
        if ties.any():
            found = lengths(scaled[ties])
            noise = noise.changed(tie=1.2 * found)
        if len(self.fit.gnss):
            usual = noise.tie_sigma if ties.any() else 1.0
            noise = noise.changed(gnss=antenna_noise(self.system, usual))
        control_sigma = self.system.control.sigma
        pulls = [
            _sum_of_squares(scaled[marks]),
            _sum_of_squares(self.fit.control / control_sigma) if len(control_sigma) else 0.0,
        ]
        trials = int(np.clip(MANY // max(int(ties.sum()), 1), 1, 6))
        for trial in range(TRIALS):
            left, squares = [], []
            plain = noise.changed(control=1.0)
            drawn = [self.draw(np.random.default_rng([17, trial, k]), plain) for k in range(trials)]
            for fit in self.fits(drawn):
                again = fit.pixels / self.sigma[:, None]
                left.append(again[ties])
                squares.append(
                    [
                        _sum_of_squares(again[marks]),
                        _sum_of_squares(fit.control / control_sigma) if len(control_sigma) else 0.0,
                    ]
                )
            if ties.any():
                noise = mended(noise, found, lengths(np.concatenate(left)))
            mark, control = np.mean(squares, axis=0)
            if mark > 0:
                noise = noise.changed(mark=noise.mark * float(np.sqrt(pulls[0] / mark)))
            # Few points say little on their sigma: what is stated counts too.
            factor = (TRUST + pulls[1]) / (TRUST + control)
            noise = noise.changed(control=float(np.sqrt(factor)))
        return noise

    # --- drawing -----------------------------------------------------------------------------

    def errors(self, drawn: Measured) -> Fit:
        """The errors of a draw as residuals that nothing has absorbed."""
        fit, given = self.fit, self.measured
        return Fit(
            fit.state,
            drawn.xy - given.xy + fit.pixels,
            drawn.gnss - given.gnss + fit.gnss,
            drawn.control - given.control + fit.control,
            fit.state.points[self.check_points] - drawn.check,
        )

    def draw(self, rng: np.random.Generator, noise: EstimatedNoise | None = None) -> Measured:
        """All measurements anew: what the believed model says, and noise."""
        noise = noise or self.noise
        fit, given = self.fit, self.measured
        tie, mark, gnss, control, check, prior = rng.spawn(6)
        error = np.empty_like(fit.pixels)
        error[self.is_tie] = noise.draw_tie(int(self.is_tie.sum()), tie)
        marks = ~self.is_tie
        error[marks] = noise.mark * mark.standard_normal((int(marks.sum()), 2))
        antenna = np.zeros((0, 3)) if noise.gnss is None else noise.gnss.draw(gnss)
        ground = noise.control * self.system.control.sigma
        of_check = noise.control * self.check_sigma
        columns = self.system.columns
        weight = columns.prior_weight[columns.shared_at]
        known = weight > 0
        value = given.prior.copy()
        if known.any():
            sigma = weight[known] ** -0.5
            value[known] = columns.shared_value[known] + sigma * prior.standard_normal(len(sigma))
        return Measured(
            xy=given.xy - fit.pixels + error * self.sigma[:, None],
            gnss=given.gnss - fit.gnss + antenna,
            control=given.control
            - fit.control
            + ground * control.standard_normal(fit.control.shape),
            prior=value,
            check=fit.state.points[self.check_points]
            + of_check * check.standard_normal(of_check.shape),
        )


def _loss(adjustment: Adjustment) -> Loss:
    """The adjustment's loss; a robust one where squares were fitted to many wrong matches.

    Least squares spread a gross error over its surroundings, where no noise can imitate it.
    """
    system = adjustment.system
    loss, rows = system.loss, system.image_rows
    if loss.kind != LOSSES["squares"] or not rows.tie.any():
        return loss
    length = (np.hypot(*system.residuals().pixels.T) / rows.sigma)[rows.tie]
    usual = robust_scale_of_lengths(length, least=1e-9)
    if np.mean(is_outlier(length, usual, UNUSABLE)) < WRONG:
        return loss
    return Loss(LOSSES["huber"], 2 * usual)


def _held_out(rows: ImageRows) -> np.ndarray:
    """Tie observations (n,) bool that no fit uses."""
    out = np.zeros(len(rows.tie), dtype=bool)
    ties = np.flatnonzero(rows.tie)
    if len(ties):
        rng = np.random.default_rng(11)
        out[ties[spared(rows.point[ties], HELD_OUT, rng)]] = True
    return out


def _check_points(system: LinearSystem) -> tuple[np.ndarray, np.ndarray]:
    """Rows of ground.csv of the check points that images show, and their points."""
    rows, points = np.flatnonzero(system.roles == "check"), system.points
    if system.held is not None or not len(rows):
        # A free network lies where its start poses were, not where the check points are.
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    marks = np.flatnonzero(points.mark)
    at = pd.Index(points.names[marks]).get_indexer(system.block.ground["point"].iloc[rows])
    return rows[at >= 0], marks[at[at >= 0]]


def _sum_of_squares(pulls: np.ndarray) -> float:
    """Of residuals in standard deviations, none counting more than PULL of them."""
    return float(np.sum(np.clip(pulls, -PULL, PULL) ** 2))
