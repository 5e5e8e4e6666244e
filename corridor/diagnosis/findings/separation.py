"""Which values hold only as long as another effect is not there.

A clock that is late moves the antenna along the flight, as a lever arm does whose camera always
looks ahead: the arm alone explains both, with a value that is neither. Its standard deviation says
how well the value is known if there is no such clock; beside one of usual size it is another.
Source: variance of an estimate beside a nuisance parameter, as of any least squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.core.effects import Effect
from corridor.core.output import scaled
from corridor.diagnosis.findings.findings import Findings
from corridor.diagnosis.findings.verdict import refines
from corridor.diagnosis.forward_selection import Round

# What another effect may move by three of its standard deviations is not known to one.
_RATIO = 3.0


@dataclass(frozen=True)
class NotSeparated:
    """Values of an effect that was found, which another of usual size would change.

    names: of its parameters; sigma, beside: standard deviation of the one that changes most,
    without and with the other effect, in `unit`.
    """

    effect: Effect
    other: Effect
    names: tuple[str, ...]
    sigma: float
    beside: float
    unit: str

    @property
    def digits(self) -> tuple[str, str, str]:
        """sigma, beside and unit in two digits, for people."""
        factor, unit = scaled(self.unit, self.beside)
        return f"{factor * self.sigma:.2g}", f"{factor * self.beside:.2g}", unit

    @property
    def sentence(self) -> str:
        """For the notes."""
        sigma, beside, unit = self.digits
        return (
            f"This flight cannot separate {' and '.join(self.names)} of {self.effect.called} from "
            f"{self.other.called}: with one of usual size it is known to {beside} {unit}, not to "
            f"{sigma}."
        )

    def to_dict(self) -> dict:
        """An entry of `not_separated` in diagnosis.json."""
        return {
            "slug": self.effect.slug, "from": self.other.slug, "parameters": list(self.names),
            "sigma": self.sigma, "sigma_beside": self.beside, "unit": self.unit,
        }  # fmt: skip


def not_separated(one: Round, findings: Findings) -> list[NotSeparated]:
    """Values that were found and another effect of usual size would change, by how much of theirs.

    Without those that the findings name as alternatives.
    """
    evidence, chosen = one.evidence, one.found.chosen
    free = evidence.freed(evidence.of_core(chosen))
    named = [n for n in free if not evidence.groups[n].generic and evidence.groups[n].point is None]
    if not named:
        return []
    told = {(each.slug, other) for each in findings.effects for other in each.alternatives}
    alone = evidence.solution(free, each_image=False)[1]
    out = []
    for m, other in enumerate(evidence.groups):
        if m in chosen or other.generic or other.own is not None or other.point is not None:
            continue
        if other.known or other.key in evidence.barred:
            continue
        beside = evidence.solution({**free, m: 1.0}, each_image=False)[1]
        for n in named:
            group = evidence.groups[n]
            if refines(other, group) or refines(group, other) or (group.slug, other.slug) in told:
                continue
            sigma, wide = (np.sqrt(each[n].diagonal()) for each in (alone, beside))
            rows = np.flatnonzero(wide > _RATIO * sigma)
            if len(rows):
                k = rows[np.argmax(wide[rows] / sigma[rows])]
                names = tuple(dict.fromkeys(group.labels[row][1] for row in rows))
                sizes = (float(group.scale[k] * some[k]) for some in (sigma, wide))
                out.append(
                    NotSeparated(group.effect, other.effect, names, *sizes, group.labels[k][2])
                )
    return sorted(out, key=lambda each: each.sigma / each.beside)
