"""The covariance of anything that is linear in the points of both dates.

Each date has its own noise, and both may share errors: those of control points that were given
the same coordinates both times, of priors that were given twice, of a GNSS base station. With R
what a common error does to a function by way of one date,

    cov = cov_before + cov_after + R_before C R_after' + R_after C R_before'

where the variances of each date hold their R C R' already. In one adjustment of both nothing is
left to be added: there is one covariance. Which errors may be common:

- control: a point that is control in both with the same coordinates has the same survey error;
- priors: a value known beforehand, given to both, is wrong by the same amount;
- gnss: a constant error of the GNSS (of its base station). No sigma of a position holds it, so it
  counts only where its standard deviation is stated; common, it leaves the change alone where both
  blocks hang on the GNSS alike, and adds to it where it belongs to each date.

Source: Caspary 2000 (deformation of two epochs), here with the points eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_array, hstack, vstack

from corridor.core.errors import InputError
from corridor.tools.change.epoch import Cloud, Epoch, Spread, coordinates

KINDS = ("control", "priors", "gnss")
# Two surveys of a control point are one where they agree to a tenth of a millimetre.
SAME_M = 1e-4
# Right sides that are solved for at a time: more would fill memory and cache.
_SOME = 600


class Joint:
    """Covariances of linear functions of two clouds, see `corridor.tools.change.epoch`.

    common: which errors both dates share, of `KINDS`. gnss_bias: standard deviations (3,), m, of a
    constant error of the GNSS of a date that its sigmas do not hold.
    """

    def __init__(
        self,
        before: Cloud,
        after: Cloud,
        common: tuple[str, ...] = ("control", "priors"),
        gnss_bias: np.ndarray | None = None,
    ):
        self.before, self.after = before, after
        self.together = before.epoch is after.epoch
        self.kinds, self.gnss_bias = common, gnss_bias

    @property
    def epochs(self) -> list[Epoch]:
        """Both, or the one of both dates."""
        return [self.before.epoch] if self.together else [self.before.epoch, self.after.epoch]

    @property
    def common_control(self) -> list[str]:
        """Names of control with the same coordinates at both dates."""
        return [] if self.together else common_control(self.epochs)

    @cached_property
    def errors(self) -> tuple[Common, ...]:
        """The errors that both dates share, and those of the GNSS as a whole."""
        return common_errors(self.epochs, self.kinds, self.gnss_bias)

    def sides(self, functions: csr_array) -> tuple[csr_array, csr_array]:
        """The functions (r, 3 (n + m)) as those of the points of each date."""
        size = 3 * len(self.before.epoch.names)
        return functions[:, :size], functions[:, size:]

    def parts(self, functions: csr_array) -> list[Spread]:
        """The functions by adjustment, in the order of time."""
        rows = self.sides(functions)
        if not self.together:
            return [c.epoch.spread(r) for c, r in zip((self.before, self.after), rows, strict=True)]
        return [self.before.epoch.spread(rows[0] + rows[1])]

    def variance(self, functions: csr_array) -> np.ndarray:
        """Variances (r,), squared metres, of functions of the points: of what was measured."""
        parts, out = self.parts(functions), self.own_variance(functions)
        for part in parts:
            out += part.epoch.sigma0**2 * variances(part.through, part.epoch.solve)
        for common, responses in zip(self.errors, self._responses(parts), strict=True):
            out += common.variance(responses)
        return out

    def own_variance(self, functions: csr_array) -> np.ndarray:
        """Variances (r,) of functions at given poses: what points do not share."""
        return sum(p.epoch.sigma0**2 * p.variance(p.own) for p in self.parts(functions))

    def covariance(self, functions: csr_array, others: csr_array | None = None) -> np.ndarray:
        """Covariances (r, s) of functions with some others, hundreds and not all of a map.

        others: default: themselves.
        """
        count, alone = functions.shape[0], others is None
        parts = self.parts(functions if alone else vstack([functions, others], format="csr"))
        few = slice(0, count) if alone else slice(count, None)
        out = 0.0
        for part in parts:
            scale = part.epoch.sigma0**2
            solved = part.epoch.solve(part.through[few].toarray().T)
            out = out + scale * (part.through[:count] @ solved)
            out = out + scale * (part.weighted(part.own)[:count] @ part.rows[few].T).toarray()
        for common, responses in zip(self.errors, self._responses(parts), strict=True):
            out = out + common.covariance(responses)[:count, few]
        return 0.5 * (out + out.T) if alone else out

    def _responses(self, parts: list[Spread]) -> list[list[np.ndarray]]:
        """For each common error its R (r, c) by way of each adjustment."""
        return [
            [one.response(part) for one, part in zip(common.sides, parts, strict=True)]
            for common in self.errors
        ]


def displacements(before: Cloud, after: Cloud, names: list[str]) -> csr_array:
    """After minus before (3k,) of points by name (k,), as functions of the points."""
    first, second = (
        coordinates(cloud.epoch, np.array([cloud.named[name] for name in names], dtype=np.int64))
        for cloud in (before, after)
    )
    return hstack([-first, second], format="csr")


@dataclass(frozen=True)
class Side:
    """What errors (c,) do to one epoch: to its unknowns, solved (n, c), and to its points at given
    unknowns, direct (3 n, c)."""

    solved: np.ndarray
    direct: csr_array

    @classmethod
    def of(cls, epoch: Epoch, right: np.ndarray, direct: csr_array | None = None) -> Side:
        """By way of the right side (n, c) of the equations, and at given unknowns."""
        nothing = csr_array((3 * len(epoch.names), right.shape[1]))
        return cls(epoch.solve(right), nothing if direct is None else direct)

    def response(self, spread: Spread) -> np.ndarray:
        """R (r, c): what a unit of each error does to functions."""
        at = (3 * spread.points[:, None] + np.arange(3)).ravel()
        return np.asarray(spread.through @ self.solved + spread.rows @ self.direct[at])


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
                f"{kind!r} is not an error that epochs can share: use some of "
                f"{', '.join(KINDS)}, or none"
            )
    out = []
    if len(epochs) == 2 and "control" in kinds:
        out += _control(epochs)
    if len(epochs) == 2 and "priors" in kinds:
        out += _priors(epochs)
    biased = gnss_bias is not None and np.any(gnss_bias)
    if biased and all(epoch.system.gnss.names.size for epoch in epochs):
        sides = tuple(_antennas(epoch) for epoch in epochs)
        out.append(Common(sides, np.diag(np.square(gnss_bias)), True, "gnss" in kinds))
    return tuple(out)


def common_control(epochs: list[Epoch]) -> list[str]:
    """Names of control points that both epochs were given with the same coordinates."""
    first, second = (
        # Behind the control stand ends of distances, which nobody surveyed.
        dict(zip(s.control_names, s.control.along_axes(s.control.given), strict=False))
        for s in (e.system for e in epochs)
    )
    return [n for n in first if n in second and np.abs(first[n] - second[n]).max() < SAME_M]


def control_of_both(epochs: list[Epoch]) -> list[str]:
    """Names of control points that both epochs were given, with whatever coordinates."""
    first, second = (list(e.system.control_names[: len(e.system.control.given)]) for e in epochs)
    return [name for name in first if name in second]


def _control(epochs: list[Epoch]) -> list[Common]:
    names = common_control(epochs)
    if not names:
        return []
    sides, sigma = [], []
    for epoch in epochs:
        control = epoch.system.control
        rows = [list(control.names).index(name) for name in names]
        point = {epoch.names[k]: k for k in np.flatnonzero(epoch.system.points.mark)}
        points = np.array([point[name] for name in names])
        regression, number = epoch.regression(points)
        weight = control.sigma[rows] ** -2.0
        across = control.turn[rows].transpose(0, 2, 1)
        own = block_diag(list(regression.own[number] @ across * weight[:, None, :]))
        direct = csr_array(coordinates(epoch, points).T @ own)
        columns = (3 * number[:, None] + np.arange(3)).ravel()
        # An effect of the ground moves what was given, whatever the point.
        own = 3 * np.array(rows)[:, None] + np.arange(3)
        given = control.jacobian[own.ravel()].T.toarray()
        seen = (regression.gain[:, columns] @ block_diag(list(across))).toarray()
        right = (given - seen) * weight.ravel()
        sides.append(Side.of(epoch, right, direct))
        sigma.append(epoch.sigma0 * control.sigma[rows].ravel())
    return [Common(tuple(sides), np.diag(sigma[0] * sigma[1]))]


def _priors(epochs: list[Epoch]) -> list[Common]:
    known = [_known(epoch.system.columns) for epoch in epochs]
    both = {
        name: (at, *value)
        for name, (at, *value) in known[0].items()
        if name in known[1] and known[1][name][1:] == tuple(value)
    }
    if not both:
        return []
    weight = np.array([weight for _, _, weight in both.values()])
    sides = []
    for epoch, mine in zip(epochs, known, strict=True):
        right = np.zeros((len(epoch.system.columns), len(both)))
        right[[mine[name][0] for name in both], np.arange(len(both))] = weight
        sides.append(Side.of(epoch, right))
    scale = epochs[0].sigma0 * epochs[1].sigma0
    return [Common(tuple(sides), scale * np.diag(1.0 / weight))]


def _known(columns) -> dict[str, tuple[int, float, float]]:
    """Column, value and weight of each shared unknown that has a prior, by its label."""
    return {
        unknown.label: (at, value, columns.prior_weight[at])
        for at, unknown, value in zip(
            columns.shared_at, columns.shared, columns.shared_prior, strict=True
        )
        if columns.prior_weight[at] > 0
    }


def _antennas(epoch: Epoch) -> Side:
    """A metre of constant error on every antenna position, by axis."""
    gnss = epoch.system.gnss
    moved = gnss.turn.reshape(-1, 3) / gnss.sigma.reshape(-1, 1) ** 2
    return Side.of(epoch, np.asarray(gnss.jacobian.T @ moved))


def variances(rows: csr_array, solve) -> np.ndarray:
    """s' Q s (r,) of sparse rows (r, n); solve(right) gives Q right."""
    out = np.empty(rows.shape[0])
    for first in range(0, len(out), _SOME):
        part = csr_array(rows[first : first + _SOME])
        solved = solve(part.toarray().T)
        row = np.repeat(np.arange(part.shape[0]), np.diff(part.indptr))
        out[first : first + _SOME] = np.bincount(
            row, part.data * solved[part.indices, row], part.shape[0]
        )
    return out
