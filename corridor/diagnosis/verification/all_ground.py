"""Control points that check points contradict.

Two control points that are both given too low agree with each other; with few more, or with a
GNSS that knows heights badly, nothing in the fit contradicts them, and every check point is off
instead. So where check points are off by more than chance the test of single points is made once
more with all of them as control, beside what was found and the lens as it is there. What it calls
wrong has to explain all that contradicts: a ground that is bent, or moves, is no blunder.
Source: Baarda 1968 (the test of all before, and after, those of one); Lehmann and Lösler 2016.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from corridor.core.effects import Effect
from corridor.diagnosis.evidence.blunders import (
    Blunders,
    Wrong,
    blunders,
    explains_all,
    listed_points,
    rivals,
)
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.search import contributions, tuned
from corridor.diagnosis.findings.findings import Estimate
from corridor.diagnosis.findings.verdict import rows_of
from corridor.diagnosis.forward_selection import Round
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class AllGround:
    """What the test says of all ground points together.

    evidence: of errors of single points. wrong: those that are, found None where none is or where
    they do not explain what contradicts.
    """

    evidence: Evidence
    wrong: Blunders

    @classmethod
    def of(cls, believed: ReferenceModel, last: Round, model: list[Effect], blunder: Effect):
        """model: what was found beside errors of points; blunder: the effect of one point.

        Raises InputError and AdjustmentFailed as the adjustment does.
        """
        points = believed.block.ground["point"].astype(str).to_numpy()
        every = asked(points, np.array(believed.model.roles(believed.block)))
        named = replace(believed.model, control=every, check=None)
        result = replace(believed, model=named).adjust(model)
        evidence = last.evidence_at(result, [blunder], {})
        told = blunders(evidence)
        if told.found is not None and not explains_all(evidence, told.found):
            told = Blunders()
        return cls(evidence, told)

    def estimates(self, control: set[str]) -> list[Estimate]:
        """Errors of control points, by the best hypothesis that has any; control: their names."""
        if self.wrong.found is None:
            return []
        groups, every = self.evidence.groups, [self.wrong.found, *self.wrong.alike]
        mine = [w for w in every if any(groups[n].single in control for n in w.points)]
        if not mine:
            return []
        out = self._estimates(mine[0], control)
        others = rivals(mine[0], [w for w in every if w is not mine[0]])
        if others:
            told = listed_points(groups, others[: SETTINGS.most_rivals])
            for one in out:
                one.or_instead(told)
        return out

    def _estimates(self, wrong: Wrong, control: set[str]) -> list[Estimate]:
        view = self.evidence.narrowed(wrong.of_point)
        chosen = tuned(view, dict.fromkeys(wrong.points, 1.0))
        each = contributions(view, chosen)
        theta, covariance = view.solution(view.freed(chosen))
        out = []
        for n in chosen:
            group = view.groups[n]
            if group.single in control:
                value, error = theta[n] * group.scale, covariance[n].diagonal() ** 0.5 * group.scale
                rows = rows_of(group, group.single, value, error, error)
                where = {"point": group.single}
                out.append(Estimate(group.slug, "named", each[n], rows, where=where, key=group.key))
        return out


def asked(points: np.ndarray, roles: np.ndarray) -> list[str]:
    """Names of all control points and of check points, of many as many as are enough.

    points, roles (n,). Hypotheses grow with the square of the points; a few dozen tell as well who
    is wrong, taken evenly as they are listed.
    """
    check = points[roles == "check"]
    few = min(len(check), SETTINGS.most_asked_points)
    chosen = check[np.linspace(0, len(check) - 1, few).round().astype(int)]
    return [*points[roles == "control"].tolist(), *chosen.tolist()]


def contradicted(misfit: float, coordinates: int) -> bool:
    """Whether check points are off by more than chance: misfit in squared sigmas."""
    return bool(chdtrc(coordinates, misfit) < SETTINGS.doubt_level)
