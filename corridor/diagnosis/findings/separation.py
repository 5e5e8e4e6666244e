"""Which values hold only as long as another effect is not there.

A clock that is late moves the antenna along the flight, as a lever arm does whose camera always
looks ahead: the arm alone explains both, with a value that is neither. Its standard deviation says
how well the value is known if there is no such clock; beside one of usual size it is another.
Source: variance of an estimate beside a nuisance parameter, as of any least squares.
"""

from __future__ import annotations

import numpy as np

from corridor.core.output import scaled
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.findings.verdict import refines
from corridor.diagnosis.forward_selection import Round

# What another effect may move by three of its standard deviations is not known to one.
_RATIO = 3.0


def not_separated(one: Round) -> list[str]:
    """A sentence on each value that was found and another effect of usual size would change."""
    evidence, chosen = one.evidence, one.found.chosen
    free = evidence.freed(evidence.of_core(chosen))
    named = [n for n in free if not evidence.groups[n].generic and evidence.groups[n].point is None]
    if not named:
        return []
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
            if refines(other, group) or refines(group, other):
                continue
            sigma, wide = (np.sqrt(each[n].diagonal()) for each in (alone, beside))
            rows = np.flatnonzero(wide > _RATIO * sigma)
            if len(rows):
                out.append(_told(evidence, n, m, rows, sigma, wide))
    return out


def _told(evidence: Evidence, n: int, m: int, rows, sigma, wide) -> str:
    group = evidence.groups[n]
    worst = rows[np.argmax(wide[rows] / sigma[rows])]
    names = " and ".join(dict.fromkeys(group.labels[k][1] for k in rows))
    small, large = (group.scale[worst] * some[worst] for some in (sigma, wide))
    factor, unit = scaled(group.labels[worst][2], large)
    return (
        f"This flight cannot separate {names} of {group.effect.called} from "
        f"{evidence.groups[m].effect.called}: with one of usual size it is known to "
        f"{factor * large:.2g} {unit}, not to {factor * small:.2g}."
    )
