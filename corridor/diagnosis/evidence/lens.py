"""What a lens leaves of the polynomials that describe it, as a nuisance with a size.

No polynomial describes a lens to the last tenth of a pixel. What is left is the same in all
pictures, and until it is in the model it is evidence for whatever looks like it. So a camera that
the flight itself calibrates has a smooth shape beside its polynomials, with a normal prior whose
size the data choose; poses, points and candidates meet what it leaves of them. It is no rival of
named effects, and is told with its size; a finding it is only where it is larger than lenses are,
or moves the ground.
Source: Kennedy and O'Hagan 2001 (model discrepancy); Brynjarsdottir and O'Hagan 2014 (why it needs
a prior).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.noise.gnss import Weight
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Antennas, Reduced
from corridor.diagnosis.system.equations import Equations
from corridor.diagnosis.system.groups import Group


@dataclass(frozen=True)
class Lens:
    """group: that of the shape, in the core. size: of its parameters, in prior sigmas.

    evidence: log evidence beside what was found. theta: (p,) parameters, in prior sigmas.
    """

    group: Group
    size: float
    evidence: float = 0.0
    theta: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def out_of(self, reduced: Reduced) -> Reduced:
        """The candidates after the lens, too, has had its say."""
        r, at = reduced, self.group.columns
        factor, to_core = self.factor(r), r.M[at]
        g = cho_solve(factor, r.g[at], check_finite=False)
        solved = cho_solve(factor, to_core, check_finite=False)
        own_matrix, own_g, between = list(r.own_matrix), list(r.own_g), list(r.between)
        to_own: dict[int, np.ndarray] = {}
        for n, with_core in enumerate(r.between):
            if with_core is None:
                continue
            to_own[n] = cho_solve(factor, with_core[:, at].T, check_finite=False)
            own_g[n] = r.own_g[n] - with_core[:, at] @ g
            own_matrix[n] = r.own_matrix[n].less(with_core[:, at], to_own[n])
            between[n] = with_core - with_core[:, at] @ solved
        mutual = {
            (i, j): both.less(r.between[i][:, at], to_own[j]) for (i, j), both in r.mutual.items()
        }
        M = r.M - to_core.T @ solved
        return Reduced(M, r.g - to_core.T @ g, own_matrix, own_g, between, mutual, r.groups)

    def out_of_antennas(self, antennas: Antennas, reduced: Reduced) -> Antennas:
        """The antenna positions after the lens has had its say. reduced: before it had."""
        a, r, at = antennas, reduced, self.group.columns
        factor = self.factor(r)
        turned = cho_solve(factor, a.core[:, at].T, check_finite=False)
        own = list(a.own)
        for n, with_core in enumerate(r.between):
            if own[n] is not None and with_core is not None:
                own[n] = partial(_beside, own[n], turned.T, with_core[:, at].T)
        return Antennas(
            Weight.of(a.P).less(a.core[:, at], turned),
            a.rho - turned.T @ r.g[at],
            a.core - turned.T @ r.M[at],
            own,
            a.under,
        )

    def factor(self, reduced: Reduced) -> tuple:
        """Cholesky factor of its own equations."""
        at = self.group.columns
        inside = reduced.M[np.ix_(at, at)] + np.eye(len(at)) / self.size**2
        return cho_factor(inside, lower=True, check_finite=False)


def _beside(felt, left: np.ndarray, right: np.ndarray, columns: slice) -> np.ndarray:
    """What the antenna feels of some columns, less left (3k, s) times those of right (s, p)."""
    return felt(columns) - left @ right[:, columns]


def lens_group(equations: Equations) -> Group | None:
    """The shape of a lens among the candidates, None where a camera is held.

    A stated calibration is a measurement: what it does not describe is missing from the model.
    """
    free = equations.system.free.values()
    for group in equations.groups:
        if of_lens(group) and group.generic:
            if all(set(group.effect.stands_in_for) & set(names) for names in free):
                return group
    return None


def names_of_lens(equations: Equations) -> set[str]:
    """Keys of what is a nuisance and no explanation where there is a `lens_group`."""
    if lens_group(equations) is None:
        return set()
    return {group.key for group in equations.groups if of_lens(group)}


def of_lens(group: Group) -> bool:
    """Whether a group deforms the picture as a lens does: in all images of a camera alike."""
    effect = group.effect
    return effect.place == "image" and effect.group == "camera" and bool(effect.stands_in_for)


def lens_of(evidence: Evidence, group: Group, beside: Mapping[int, float]) -> Lens | None:
    """The lens of the most likely size beside groups n -> kappa, None where there is nothing of it.

    evidence: of a system in which the lens is a candidate like others.
    """
    n = evidence.number[group.key]
    rest = {
        k: kappa
        for k, kappa in beside.items()
        if not of_lens(evidence.groups[k]) and evidence.block(evidence.groups[k])[0] is not None
    }
    without = evidence.total(rest)
    each = {size: evidence.total(rest | {n: size}) - without for size in SETTINGS.lens_sizes}
    best = max(each, key=each.get)
    if each[best] <= 0.0:
        return None
    theta, _ = evidence.solution({**rest, n: best})
    return Lens(group, best, each[best], theta[-len(group) :])
