"""The covariance of anything that is linear in the points of both epochs.

Each epoch has its own noise, and both may share errors: those of control points that were given
the same coordinates both times, of priors that were given twice, of a GNSS base station. With R
what a common error does to a function by way of one epoch,

    cov = cov_before + cov_after + R_before C R_after' + R_after C R_before'

where the variances of each epoch hold their R C R' already. In one adjustment of both epochs
nothing is left to be added: there is one covariance.
Source: Caspary 2000 (deformation of two epochs), here with the points eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from corridor.change.clouds import Cloud, Functions
from corridor.change.common import Common, common_errors
from corridor.change.epoch import Epoch, Spread
from corridor.change.quadratic import variances


@dataclass(frozen=True)
class Part:
    """Functions as far as they are of one adjustment. extra (k, 3, 3): roughness of the points."""

    epoch: Epoch
    spread: Spread
    extra: np.ndarray


class Joint:
    """Covariances of linear functions of two clouds.

    common: which errors both epochs share, names of `KINDS` in `corridor.change.common`.
    gnss_bias: standard deviations (3,), m, of a constant error of the GNSS of an epoch that its
    sigmas do not hold.
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

    @cached_property
    def errors(self) -> tuple[Common, ...]:
        """The errors that both epochs share, and those of the GNSS as a whole."""
        epochs = [self.before.epoch] if self.together else [self.before.epoch, self.after.epoch]
        return common_errors(epochs, self.kinds, self.gnss_bias)

    def with_clouds(self, before: Cloud, after: Cloud) -> Joint:
        """The same errors for other points of the same epochs."""
        out = Joint(before, after, self.kinds, self.gnss_bias)
        out.__dict__["errors"] = self.errors
        return out

    def parts(self, functions: Functions) -> list[Part]:
        """The functions by adjustment, in the order of time."""
        sides = [(self.before, functions.before), (self.after, functions.after)]
        if not self.together:
            return [_part(cloud.epoch, rows, [cloud]) for cloud, rows in sides]
        rows = csr_array(functions.before + functions.after)
        return [_part(self.before.epoch, rows, [self.before, self.after])]

    def variance(self, functions: Functions) -> np.ndarray:
        """Variances (r,), squared metres, of functions of the points: of what was measured."""
        parts, out = self.parts(functions), self.own_variance(functions)
        for part in parts:
            out += part.epoch.sigma0**2 * variances(part.spread.through, part.epoch.solve)
        for common, responses in zip(self.errors, self._responses(parts), strict=True):
            out += common.variance(responses)
        return out

    def own_variance(self, functions: Functions) -> np.ndarray:
        """Variances (r,) of functions at given poses: what points do not share."""
        out = np.zeros(len(functions))
        for part in self.parts(functions):
            own = part.spread.weighted(part.spread.own).multiply(part.spread.rows).sum(axis=1)
            out += part.epoch.sigma0**2 * np.asarray(own).ravel()
        return out

    def roughness(self, functions: Functions) -> np.ndarray:
        """Variances (r,) of functions that come from rough ground between its points."""
        out = np.zeros(len(functions))
        for part in self.parts(functions):
            own = part.spread.weighted(part.extra).multiply(part.spread.rows).sum(axis=1)
            out += np.asarray(own).ravel()
        return out

    def covariance(
        self, functions: Functions, others: Functions | None = None, rough: bool = False
    ) -> np.ndarray:
        """Covariances (r, s) of functions with some others, hundreds and not all of a map.

        others: default: themselves. rough: with what comes from rough ground.
        """
        count = len(functions)
        alone = others is None
        parts = self.parts(functions if alone else Functions.stack([functions, others]))
        few = slice(0, count) if alone else slice(count, None)
        out = 0.0
        for part in parts:
            spread, scale = part.spread, part.epoch.sigma0**2
            solved = part.epoch.solve(spread.through[few].toarray().T)
            out = out + scale * (spread.through[:count] @ solved)
            own = scale * spread.own + (part.extra if rough else 0.0)
            out = out + (spread.weighted(own)[:count] @ spread.rows[few].T).toarray()
        for common, responses in zip(self.errors, self._responses(parts), strict=True):
            out = out + common.covariance(responses)[:count, few]
        return 0.5 * (out + out.T) if alone else out

    def _responses(self, parts: list[Part]) -> list[list[np.ndarray]]:
        """For each common error its R (r, c) by way of each adjustment."""
        return [
            [one.response(part.spread) for one, part in zip(common.sides, parts, strict=True)]
            for common in self.errors
        ]


def _part(epoch: Epoch, rows: csr_array, clouds: list[Cloud]) -> Part:
    spread = epoch.spread(rows)
    rough = np.zeros((len(spread.points), 3, 3))
    for cloud in clouds:
        if cloud.roughness is not None:
            rough += cloud.roughness[spread.points]
    back = np.linalg.inv(epoch.turn)
    return Part(epoch, spread, back @ rough @ back.T)
