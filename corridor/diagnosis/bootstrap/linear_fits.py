"""Fits to other measurements of the same things, linear about the fit of one.

What noise does to a fit is linear to a ten-thousandth of itself. So all sets of measurements are
right sides of one factorisation,

    dx = (g A'A + ...)^-1 (A' psi(e) + ...),    e <- e - A dx,

repeated where the loss is robust: psi is its slope at what is left of each residual, g the mean of
its derivative over the fit.
Source: Huber and Ronchetti 2009, "Robust statistics", section 7.8 (modified residuals).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from corridor.core.adjustment import LOSSES, Design, LinearSystem, Loss, Sets
from corridor.diagnosis.bootstrap.statistics import Fit

# Standard deviations of a held-out observation, whose row is known and has no say.
NO_SAY = 1e6
# RMS of a step, over all unknowns, in standard deviations; a few robust weights creep for longer.
SMALL, MOST = 0.02, 12


class Measured(NamedTuple):
    """Everything measured, in the order of the problem; px and m.

    prior: value of the priors of shared unknowns. check: given coordinates of the check points,
    without what effects of the ground do to them. posed: what attitudes are turned by, rad, and
    members of rigs are moved by (`system.posed`). distance (k, 1): m. Behind control stand the
    ends of distances, as in `system.control`.
    """

    xy: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    prior: np.ndarray
    check: np.ndarray
    posed: np.ndarray
    distance: np.ndarray


class LinearFits:
    """Fits of a system to other measurements than those of the fit at which it stands.

    system: at that fit, with its loss; measured, fit: what it was fitted to, and what was left.
    sigma (n,): stated, px; held_out (n,): bool, image observations without a say. check_points
    (c,): points whose misfit the fits tell. ground (3c, n): derivative by the columns of what
    effects do to their given coordinates.
    """

    def __init__(
        self,
        system: LinearSystem,
        measured: Measured,
        fit: Fit,
        sigma: np.ndarray,
        held_out: np.ndarray,
        check_points: np.ndarray,
        ground: np.ndarray,
    ):
        self._measured, self._fit, self._loss, self._ground = measured, fit, system.loss, ground
        seen = np.isfinite(fit.pixels).all(axis=1)
        self._used = np.repeat(seen & ~held_out, 2)[:, None]
        square = (np.nan_to_num(fit.pixels) ** 2).sum(axis=1) / sigma**2
        slope = np.ones(len(sigma))
        # Marks may be far from what is stated of them where ties are not.
        for kind in (system.image_rows.tie, ~system.image_rows.tie):
            if (counts := kind & seen & ~held_out).any():
                slope[kind] = mean_slope(system.loss, square[counts])
        sigma = np.where(held_out, NO_SAY * sigma, sigma) / np.sqrt(slope)
        self._slope = slope[:, None]
        self._system = system = replace(system.measuring(sigma=sigma), loss=Loss())
        self._design = Design(system, kept=True, followed=check_points)
        self._weight = np.repeat(1.0 / sigma, 2)
        self._poses = [
            (rows.jacobian, rows.sigma.reshape(-1, 1) ** -2.0)
            for rows in (system.gnss, system.posed, system.distance)
        ]

    def __call__(self, drawn: Iterable[Measured]) -> list[Fit]:
        """The fit to each of several sets of measurements; its state is that of the one."""
        given, fit = self._measured, self._fit
        image, others = [], []
        for one in drawn:
            left = one.xy - given.xy
            left += fit.pixels
            image.append(np.nan_to_num(left, copy=False).ravel())
            image[-1] *= self._weight
            others.append(
                [(new - old).ravel() for new, old in zip(one[1:], given[1:], strict=True)]
            )
        k = len(image)
        others = Measured(None, *(np.stack(each, axis=1) for each in zip(*others, strict=True)))
        poses = [
            others.gnss + fit.gnss.reshape(-1, 1),
            others.posed + fit.posed.reshape(-1, 1),
            others.distance + fit.distance,
        ]
        sets = Sets(image, others.control + fit.control.reshape(-1, 1), self._counted)
        columns = self._system.columns
        weight = columns.prior_weight[:, None]
        prior = np.tile(self._system.right_of_priors[:, None], k)
        prior[columns.shared_at] += weight[columns.shared_at] * others.prior
        check = fit.check.reshape(-1, 1) - others.check
        for _ in range(MOST):
            right = self._design.right(sets) + prior
            for (by, size), left in zip(self._poses, poses, strict=True):
                right += by.T @ (size * left)
            step = self._system.solve(right)
            sets, moved, square = self._design.back(sets, step)
            poses = [left - by @ step for (by, _), left in zip(self._poses, poses, strict=True)]
            prior = prior - weight * step
            check = check + moved.reshape(-1, k) + self._ground @ step
            length = square / self._system.problem.unknown_count
            if self._loss.kind == LOSSES["squares"] or length.max() < SMALL**2:
                break
        behind = ~np.isfinite(fit.pixels).ravel()
        for one in image:
            one /= self._weight
            one[behind] = np.nan
        return [
            Fit(
                fit.state,
                image[n].reshape(-1, 2),
                *(one[:, n].reshape(-1, 3) for one in small),
                poses[2][:, [n]],
            )  # fmt: skip
            for n in range(k)
            for small in [(poses[0], sets.control, check, poses[1])]
        ]

    def _counted(self, rows: slice, image: np.ndarray) -> None:
        """Make of weighted residuals (rows, k) what least squares would have to see."""
        image *= self._used[rows]
        if self._loss.kind == LOSSES["squares"]:
            return
        pairs = image.reshape(-1, 2, image.shape[1])
        slope = self._slope[rows.start // 2 : rows.stop // 2]
        square = np.einsum("nck,nck->nk", pairs, pairs)
        square /= slope
        pairs *= (weight_of(self._loss, square) / slope)[:, None]


def weight_of(loss: Loss, square: np.ndarray) -> np.ndarray:
    """Weight of a residual of this squared length, in sigmas: psi(r) = weight r."""
    if loss.kind == LOSSES["squares"]:
        return np.ones_like(square)
    square = square / loss.width**2
    if loss.kind == LOSSES["huber"]:
        return 1.0 / np.sqrt(np.maximum(square, 1.0))
    return 1.0 / (1.0 + square)


def mean_slope(loss: Loss, square: np.ndarray) -> float:
    """Mean derivative of psi, along the residual and across it, over squared lengths (n,)."""
    if loss.kind == LOSSES["squares"]:
        return 1.0
    across = weight_of(loss, square)
    if loss.kind == LOSSES["huber"]:
        along = (square <= loss.width**2).astype(float)
    else:
        along = across * (2.0 * across - 1.0)
    return float(0.5 * (across.mean() + along.mean()))
