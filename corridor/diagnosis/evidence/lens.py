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

import numpy as np

from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Rows, rows_of
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

    @property
    def rows(self) -> Rows:
        """It, as a row of an elimination: what the candidates meet it has left."""
        return rows_of([(self.group, self.size)])


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
    rest = {k: kappa for k, kappa in beside.items() if not of_lens(evidence.groups[k])}
    without = evidence.total(rest)
    each = {size: evidence.total(rest | {n: size}) - without for size in SETTINGS.lens_sizes}
    best = max(each, key=each.get)
    if each[best] <= 0.0:
        return None
    theta, _ = evidence.solution({**rest, n: best}, each_image=False)
    return Lens(group, best, each[best], theta[n])
