"""Robust least squares for a few dozen parameters, with a sigma that knows about clusters."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from corridor.geometry import robust_scale

_TUKEY = 4.685


@functools.lru_cache(maxsize=1)
def _libraries():
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def single_threaded(measure):
    """The function with the linear algebra in one thread: these systems are small, and threads
    that wait for each other on a busy machine take ten times as long."""

    @functools.wraps(measure)
    def limited(*arguments, **options):
        with _libraries().limit(limits=1):
            return measure(*arguments, **options)

    return limited


def tukey(residuals: np.ndarray, scale: float) -> np.ndarray:
    """Weights 1 to 0 of residuals; 0 beyond 4.7 scales (Beaton and Tukey 1974)."""
    share = np.clip(np.abs(residuals) / (_TUKEY * max(scale, 1e-12)), 0, 1)
    return (1 - share**2) ** 2


def fit(
    model: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    step: np.ndarray,
    prior: Callable[[np.ndarray], np.ndarray] | None = None,
    iterations: int = 20,
    floor: float = 0.0,
    groups: np.ndarray | None = None,
    own: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Parameters that make the residuals small, outliers aside (Gauss-Newton, Tukey's weights).

    model: parameters -> residuals (n,), one unit. step: for the difference quotients.
    prior: parameters -> residuals in sigmas. floor: smallest scale of the residuals.
    groups: (n,) of 0, 1 ..: residuals with a scale of their own.
    own: (kinds, members) indices of parameters of which a residual knows one member each, and
    (n,) which member it is: -1 for none. They are differentiated together.
    Returns the parameters, the residuals, their weights, the matrix (parameters, n) that takes a
    small change of the residuals to that of the parameters, and what the priors' own errors
    contribute to the sigma of each parameter.
    """
    parameters = np.array(start, dtype=float)
    residuals = model(parameters)
    groups = np.zeros(len(residuals), dtype=int) if groups is None else groups
    weights, scales = _weigh(residuals, groups, floor)
    influence = np.zeros((len(parameters), len(residuals)))
    believed = np.zeros(len(parameters))
    for _ in range(iterations):
        jacobian = _derivative(model, parameters, residuals, step, own)
        weighted = jacobian * (weights / scales**2)[:, None]
        normal = weighted.T @ jacobian
        right = -weighted.T @ residuals
        if prior is not None:
            known = prior(parameters)
            pull = np.empty((len(known), len(parameters)))
            for k, size in enumerate(step):
                moved = parameters.copy()
                moved[k] += size
                pull[:, k] = (prior(moved) - known) / size
            normal += pull.T @ pull
            right -= pull.T @ known
        diagonal = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        inverse = np.linalg.pinv(normal / np.outer(diagonal, diagonal), rcond=1e-13)
        inverse /= np.outer(diagonal, diagonal)
        change = inverse @ right
        parameters = parameters + change
        residuals = model(parameters)
        influence = inverse @ weighted.T
        if prior is not None:
            believed = np.sqrt(((inverse @ pull.T) ** 2).sum(axis=1))
        weights, scales = _weigh(residuals, groups, floor)
        if np.all(np.abs(change) <= 0.02 * np.sqrt(np.maximum(np.diag(inverse), 0))):
            break
    return parameters, residuals, weights, influence, believed


def _derivative(model, parameters, residuals, step, own):
    jacobian = np.zeros((len(residuals), len(parameters)))
    single = np.ones(len(parameters), dtype=bool)
    if own is not None:
        for kind in own[0]:
            single[kind] = False
            moved = parameters.copy()
            moved[kind] += step[kind]
            change = model(moved) - residuals
            known = np.flatnonzero(own[1] >= 0)
            column = kind[own[1][known]]
            jacobian[known, column] = change[known] / step[column]
    for k in np.flatnonzero(single):
        moved = parameters.copy()
        moved[k] += step[k]
        jacobian[:, k] = (model(moved) - residuals) / step[k]
    return jacobian


def _weigh(residuals, groups, floor):
    weights, scales = np.empty_like(residuals), np.empty_like(residuals)
    for group in range(groups.max(initial=0) + 1):
        own = groups == group
        if not own.any():
            continue
        scale = max(robust_scale(residuals[own]), floor, 1e-9)
        scales[own] = scale
        weights[own] = tukey(residuals[own], scale)
    return weights, scales


def sigma_of(
    influence: np.ndarray, residuals: np.ndarray, weights: np.ndarray, cluster: np.ndarray
) -> float:
    """One sigma of one parameter when residuals of a cluster err together.

    influence: (n,) row of `fit`'s matrix. The larger of the plain sigma and of the sum over
    clusters (Liang and Zeger 1986), which needs some ten of them.
    """
    moved = influence * residuals
    used = weights > 0
    plain = np.sqrt(np.sum(moved[used] ** 2))
    sums = np.bincount(cluster[used], weights=moved[used])
    count = max(int((np.bincount(cluster[used]) > 0).sum()), 2)
    return float(max(plain, np.sqrt(np.sum(sums**2) * count / (count - 1))))
