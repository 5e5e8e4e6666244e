"""What the strips of a flight say of an effect one by one, each left out in turn.

An effect that is there in all of a flight is there in what the fit has not seen: with its value
from the other strips, a strip is predicted better than without. Of the equations of a strip c with
score s_c and information m_c of the effect, and M and g of all,

    theta_c = (M - m_c)^-1 (g - s_c)
    gain in log likelihood = theta_c' s_c - 1/2 theta_c' m_c theta_c

Source: Efron and Tibshirani 1993, chapter 11 (jackknife), 17 (cross-validation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.core.geometry import jackknife
from corridor.core.preparation import strips_of
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.evidence.scores import Influence, responding
from corridor.diagnosis.forward_selection import Round
from corridor.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class ByStrips:
    """A group as the strips see it.

    count: strips, or parts of them. left (count, p): parameters without each, in prior standard
    deviations. sigma: (p,) by the jackknife.
    gain (count,): log likelihood by which each is predicted better with what the others say.
    """

    count: int
    left: np.ndarray
    sigma: np.ndarray
    gain: np.ndarray

    @property
    def proved(self) -> bool:
        """Whether what was left out is predicted better."""
        return float(self.gain.sum()) > 0.0


def by_strips(one: Round) -> dict[int, ByStrips]:
    """What was found, as the strips see it: groups n of few parameters that images share.

    one: a round whose adjustment has what it found in its model. Ground points lie in no strip.
    """
    evidence, found = one.evidence, list(one.found.chosen)
    asked = [n for n in found if _can_be_asked(one, n)]
    strips = strips_of(one.equations.system.block)
    if not asked or len(strips) < SETTINGS.fewest:
        return {}
    influence = Influence(evidence.reduced.elimination)
    of_file = np.empty(len(one.equations.system.images.names), dtype=np.int64)
    for number, (_, rows) in enumerate(strips):
        of_file[rows] = number
    strip = of_file[one.equations.system.image_order]
    return {n: of_group(evidence, influence, strip, n, found) for n in asked}


def _can_be_asked(one: Round, n: int) -> bool:
    group = one.evidence.groups[n]
    return (
        group.own is None
        and group.effect.place != "ground"
        and len(group) <= SETTINGS.most_free
        and group.key in one.log["model"]
    )


def of_group(
    evidence: Evidence, influence: Influence, strip: np.ndarray, n: int, found: list[int]
) -> ByStrips:
    """The n-th group beside all that was found; strip: number (images,) of that of each image."""
    group = evidence.groups[n]
    shared = [k for k in found if evidence.groups[k].own is None]
    core, M, g = responding(evidence, n, dict.fromkeys(shared, SETTINGS.free_size))
    score, inside = influence.by_cluster(core, strip)
    # The adjustment has taken out what it estimated.
    score = score + inside @ influence.equations.core.value[group.columns]
    left, gain = [], []
    held = np.diag(group.free**-2.0)
    # What the data do not determine, as what values of flights have in common where the camera has
    # it too, is left where it is: the sigma is that of their differences.
    value, vector = np.linalg.eigh(0.5 * (M + M.T))
    known = vector[:, value > SETTINGS.blind_information]
    for s, m in zip(score, inside, strict=True):
        theta = known @ (known.T @ np.linalg.solve(M - m + held, g - s))
        left.append(theta)
        gain.append(theta @ s - 0.5 * theta @ m @ theta)
    sigma = np.array([jackknife(values) for values in np.array(left).T])
    return ByStrips(len(score), np.array(left), sigma, np.array(gain))
