"""Which values hold only as long as another effect is not there.

A clock that is late moves the antenna along the flight, as a lever arm does whose camera always
looks ahead: the arm alone explains both, with a value that is neither. Its standard deviation says
how well the value is known if there is no such clock; beside one of usual size it is another.
Source: variance of an estimate beside a nuisance parameter, as of any least squares.
"""

from __future__ import annotations

import numpy as np

from corridor.diagnosis.findings.findings import Findings
from corridor.diagnosis.findings.verdict import refines
from corridor.diagnosis.forward_selection import Round

# What another effect may move by three of its standard deviations is not known to one.
_RATIO = 3.0


def not_separated(one: Round, findings: Findings) -> list[dict]:
    """`not_separated` of diagnosis.json: values that were found and another effect of usual size
    would change, the most uncertain first, without what the findings name as alternatives.

    sigma, sigma_beside: standard deviation of the one that changes most, without and with it.
    """
    evidence, chosen = one.evidence, one.found.chosen
    free = evidence.freed(evidence.of_core(chosen))
    named = [
        n for n in free if not evidence.groups[n].generic and evidence.groups[n].single is None
    ]
    if not named:
        return []
    told = {(each.slug, other) for each in findings.effects for other in each.alternatives}
    alone = evidence.solution(free, each_image=False)[1]
    out = []
    for m, other in enumerate(evidence.groups):
        if m in chosen or other.generic or other.own is not None or other.single is not None:
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
                out.append({
                    "slug": group.slug, "from": other.slug, "unit": group.labels[k][2],
                    "parameters": list(dict.fromkeys(group.labels[row][1] for row in rows)),
                    "sigma": float(group.scale[k] * sigma[k]),
                    "sigma_beside": float(group.scale[k] * wide[k]),
                })  # fmt: skip
    return sorted(out, key=lambda each: each["sigma"] / each["sigma_beside"])
