"""Errors that two epochs have in common, and what they do to functions of points.

- control: a point that is control in both with the same coordinates has the same survey error;
- priors: a value known beforehand, given to both, is wrong by the same amount;
- gnss: a constant error of the GNSS (of its base station). No sigma of a position holds it, so it
  counts only where its standard deviation is stated; common, it leaves the change alone where both
  blocks hang on the GNSS alike, and adds to it where it belongs to each epoch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.change.epoch import Epoch, Spread
from corridor.errors import InputError

KINDS = ("control", "priors", "gnss")
# Two surveys of a control point are one where they agree to a tenth of a millimetre.
SAME_M = 1e-4


@dataclass(frozen=True)
class Side:
    """What errors (c,) do to one epoch: to its unknowns, solved (n, c), and to points at given
    unknowns, direct: point -> (first column, derivative (3, 3))."""

    solved: np.ndarray
    direct: dict[int, tuple[int, np.ndarray]]

    def response(self, spread: Spread) -> np.ndarray:
        """R (r, c): what a unit of each error does to functions."""
        out = np.asarray(spread.through @ self.solved)
        places = {point: k for k, point in enumerate(spread.points.tolist())}
        for point, (column, moved) in self.direct.items():
            if point in places:
                at = 3 * places[point] + np.arange(3)
                out[:, column : column + 3] += spread.rows[:, at] @ moved
        return out


@dataclass(frozen=True)
class Common:
    """Errors with covariance C (c, c), and what they do to each of the epochs.

    apart: the errors are not those of the noise, and count for each epoch as well. shared: both
    epochs have the same draw of them.
    """

    sides: tuple[Side, ...]
    matrix: np.ndarray
    apart: bool = False
    shared: bool = True

    def variance(self, responses: list[np.ndarray]) -> np.ndarray:
        """What they add to the variances (r,) of functions."""
        return sum(np.einsum("rc,cd,rd->r", a, self.matrix, b) for a, b in self._pairs(responses))

    def covariance(self, responses: list[np.ndarray]) -> np.ndarray:
        """What they add to the covariances (r, r) of functions."""
        return sum(a @ self.matrix @ b.T for a, b in self._pairs(responses))

    def _pairs(self, responses):
        """Products that count: of an epoch with itself, of both with each other."""
        n = range(len(responses))
        kept = [(i, j) for i in n for j in n if (i == j and self.apart) or (i != j and self.shared)]
        zero = 0.0 * responses[0]
        return [(responses[i], responses[j]) for i, j in kept] or [(zero, zero)]


def common_errors(
    epochs: list[Epoch], kinds: tuple[str, ...], gnss_bias: np.ndarray | None
) -> tuple[Common, ...]:
    """The errors of these kinds that epochs share. Raises InputError for an unknown kind."""
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(
                f"{kind!r} is no error that epochs share: use some of {', '.join(KINDS)}, or none"
            )
    out = []
    if len(epochs) == 2 and "control" in kinds:
        out += _control(epochs)
    if len(epochs) == 2 and "priors" in kinds:
        out += _priors(epochs)
    if (
        gnss_bias is not None
        and np.any(gnss_bias)
        and all(e.system.gnss.names.size for e in epochs)
    ):
        sides = tuple(_antennas(epoch) for epoch in epochs)
        out.append(Common(sides, np.diag(np.square(gnss_bias)), True, "gnss" in kinds))
    return tuple(out)


def common_control(epochs: list[Epoch]) -> list[str]:
    """Names of control points that both epochs were given with the same coordinates."""
    first, second = (
        dict(zip(e.system.control.names, e.system.control.given, strict=True)) for e in epochs
    )
    return [n for n in first if n in second and np.abs(first[n] - second[n]).max() < SAME_M]


def _control(epochs: list[Epoch]) -> list[Common]:
    names = common_control(epochs)
    if not names:
        return []
    sides, sigma = [], []
    for epoch in epochs:
        control = epoch.system.control
        rows = [list(control.names).index(name) for name in names]
        point = {epoch.names[k]: k for k in epoch.marks}
        points = np.array([point[name] for name in names])
        gains, number = epoch.gains(points)
        weight = control.sigma[rows] ** -2.0
        columns = (3 * number[:, None] + np.arange(3)).ravel()
        right = -gains.gain[:, columns].toarray() * weight.ravel()
        direct = {
            p: (3 * k, gains.own[number[k]] * weight[k]) for k, p in enumerate(points.tolist())
        }
        sides.append(Side(epoch.solve(right), direct))
        sigma.append(epoch.sigma0 * control.sigma[rows].ravel())
    return [Common(tuple(sides), np.diag(sigma[0] * sigma[1]))]


def _priors(epochs: list[Epoch]) -> list[Common]:
    found = []
    for epoch in epochs:
        columns = epoch.system.columns
        known = {}
        for at, unknown, value in zip(
            columns.shared_at, columns.shared, columns.shared_prior, strict=True
        ):
            if columns.prior_weight[at] > 0:
                known[unknown.label] = (at, value, columns.prior_weight[at])
        found.append(known)
    labels = [
        name for name, (_, value, weight) in found[0].items()
        if name in found[1] and found[1][name][1:] == (value, weight)
    ]  # fmt: skip
    if not labels:
        return []
    sides = []
    for epoch, known in zip(epochs, found, strict=True):
        right = np.zeros((len(epoch.system.columns), len(labels)))
        for k, name in enumerate(labels):
            at, _, weight = known[name]
            right[at, k] = weight
        sides.append(Side(epoch.solve(right), {}))
    variance = [1.0 / found[0][name][2] for name in labels]
    scale = epochs[0].sigma0 * epochs[1].sigma0
    return [Common(tuple(sides), scale * np.diag(variance))]


def _antennas(epoch: Epoch) -> Side:
    """A metre of constant error on every antenna position, by axis."""
    gnss = epoch.system.gnss
    moved = np.tile(np.eye(3), (len(gnss.names), 1)) / gnss.sigma.reshape(-1, 1) ** 2
    return Side(epoch.solve(np.asarray(gnss.jacobian.T @ moved)), {})
