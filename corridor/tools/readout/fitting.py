"""Robust least squares for a few dozen parameters, with a sigma that knows about clusters."""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from corridor.core.geometry import robust_scale

_TUKEY = 4.685
_USED = 0.1  # weight of a residual that counts
_ROUNDS = 4  # in which the scale of the residuals and the parameters settle


@dataclass(frozen=True)
class Fitted:
    """What a robust fit found.

    values: (k,) parameters. residuals, weights: (n,), weights 1 to 0. influence: (k, n), takes a
    small change of the residuals to that of the parameters. believed: (k,) what the priors' own
    errors contribute to the sigma of each parameter.
    """

    values: np.ndarray
    residuals: np.ndarray
    weights: np.ndarray
    influence: np.ndarray
    believed: np.ndarray

    @property
    def used(self) -> np.ndarray:
        """Which residuals (n,) are no outliers."""
        return self.weights > _USED

    def sigma(self, parameter: int, cluster: np.ndarray, factor: float = 1.0) -> float:
        """One sigma of a parameter, times a factor, with the priors' share: the larger of those of
        residuals that err alone and of clusters (n,) that err together."""
        own = max(sigmas_of(self.influence[parameter], self.residuals, self.weights, cluster))
        return math.hypot(factor * own, self.believed[parameter])


def fit(
    model: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    step: np.ndarray,
    prior: Callable[[np.ndarray], np.ndarray] = lambda values: np.zeros(0),
    *,
    floor: float = 0.0,
    groups: np.ndarray | None = None,
    own: tuple[np.ndarray, np.ndarray] | None = None,
    rough: bool = False,
) -> Fitted:
    """Parameters that make the residuals small, outliers aside (Beaton and Tukey 1974).

    model: parameters -> residuals (n,), one unit. step: for the difference quotients.
    prior: parameters -> residuals in sigmas. floor: smallest scale of the residuals.
    groups: (n,) of 0, 1 ..: residuals with a scale of their own.
    own: (kinds, members) indices of parameters of which a residual knows one member each, and
    (n,) which member it is: -1 for none. They are differentiated together.
    rough: a few steps only, for points that will be looked for again.
    """
    values = np.array(start, dtype=float)
    last = values, model(values)

    def modelled(v):
        """The residuals, which are asked for the slopes at the same values once more."""
        nonlocal last
        if not np.array_equal(v, last[0]):
            last = v.copy(), model(v)
        return last[1]

    residuals = modelled(values)
    count = len(residuals)
    groups = np.zeros(count, dtype=int) if groups is None else groups
    scales = _scales(residuals, groups, floor)
    for _ in range(1 if rough else _ROUNDS):

        def both(v, scales=scales):
            return np.concatenate([modelled(v) / scales, prior(v)])

        def slopes(v, scales=scales):
            by_model = _derivative(model, v, modelled(v), step, own) / scales[:, None]
            return np.concatenate([by_model, _derivative(prior, v, prior(v), step)])

        found = least_squares(
            both, values, slopes, loss=functools.partial(_loss, count), x_scale="jac",
            xtol=1e-9, ftol=1e-7, gtol=1e-12, max_nfev=5 if rough else 30,
        )  # fmt: skip
        values, before = found.x, scales
        residuals = found.fun[:count] * before
        scales = _scales(residuals, groups, floor)
        if np.all(np.abs(scales / before - 1) < 0.01):
            break
    weights = (1 - np.clip(np.abs(residuals / scales) / _TUKEY, 0, 1) ** 2) ** 2
    jacobian = _derivative(model, values, modelled(values), step, own)
    pull = _derivative(prior, values, prior(values), step)
    weighted = jacobian * (weights / scales**2)[:, None]
    normal = weighted.T @ jacobian + pull.T @ pull
    size = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-13) / np.outer(size, size)
    believed = np.sqrt(((inverse @ pull.T) ** 2).sum(axis=1))
    return Fitted(values, residuals, weights, inverse @ weighted.T, believed)


def _derivative(model, values, known, step, own=None):
    """Difference quotients of a model, which is `known` at the values."""
    jacobian = np.zeros((len(known), len(values)))
    single = np.ones(len(values), dtype=bool)
    for kind in () if own is None else own[0]:
        single[kind] = False
        moved = values.copy()
        moved[kind] += step[kind]
        row = np.flatnonzero(own[1] >= 0)
        column = kind[own[1][row]]
        jacobian[row, column] = (model(moved) - known)[row] / step[column]
    for k in np.flatnonzero(single):
        moved = values.copy()
        moved[k] += step[k]
        jacobian[:, k] = (model(moved) - known) / step[k]
    return jacobian


def _scales(residuals, groups, floor):
    """Usual size (n,) of the residuals of each one's group."""
    each = [
        robust_scale(residuals[groups == k], least=max(floor, 1e-9))
        for k in range(groups.max(initial=0) + 1)
    ]
    return np.array(each)[groups]


def _loss(count, squares):
    """Tukey's biweight of the first squares, as `least_squares` takes it; priors count fully."""
    out = np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
    rest = np.maximum(1 - squares[:count] / _TUKEY**2, 0)
    out[:, :count] = _TUKEY**2 / 3 * (1 - rest**3), rest**2, -2 / _TUKEY**2 * rest
    return out


def sigmas_of(
    influence: np.ndarray, residuals: np.ndarray, weights: np.ndarray, cluster: np.ndarray
) -> tuple[float, float]:
    """Two sigmas of one parameter: of residuals that err each for itself, and of those of a
    cluster that err together (Liang and Zeger 1986), which needs some ten clusters.

    influence: (n,) row of `Fitted.influence`.
    """
    moved = influence * residuals
    used = weights > 0
    sums = np.bincount(cluster[used], weights=moved[used])
    count = max(int((np.bincount(cluster[used]) > 0).sum()), 2)
    together = np.sqrt(np.sum(sums**2) * count / (count - 1))
    return float(np.sqrt(np.sum(moved[used] ** 2))), float(together)


def vertex(before: np.ndarray, at: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Where between -0.5 and 0.5 a maximum lies, by the parabola through it and its neighbours;
    0 where that has none."""
    bend = np.asarray(before - 2 * at + after)
    return np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
