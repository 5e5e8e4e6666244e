"""Errors of single control points and distances, sought before anything else may explain them.

Each point is held against what all others, the GNSS and the images say of it, in its height and
in its plan apart; then what is left once the worst is out; then pairs, which hide each other. With
M and g of the reduced system, of the coordinates S of one hypothesis

    T_S = g_S' M_SS^-1 g_S  ~  chi square of as many degrees of freedom,

of one coordinate the square of Baarda's w. Other hypotheses that leave hardly more are kept: two
points of three that agree may be the wrong ones.
Source: Baarda 1968, "A testing procedure for use in geodetic networks"; Lehmann and Lösler 2016
(several outliers at once, by hypothesis and not one by one).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import pinvh
from scipy.special import chdtrc, gammaln

from corridor.diagnosis.evidence.evidence import Beside, Evidence
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Reduced
from corridor.diagnosis.system.groups import Group

HEIGHT, PLAN = ("z",), ("x", "y")
# What one hypothesis takes for wrong of a control point, and of a measured distance.
_PARTS = {"point": (HEIGHT, PLAN), "distance": (("error",),)}


@dataclass(frozen=True)
class Wrong:
    """A hypothesis: numbers of the groups of points and which of their coordinates are wrong.

    chance: log of the probability that its statistic is as large without it.
    """

    points: tuple[int, ...]
    parts: tuple[tuple[str, ...], ...]
    statistic: float
    chance: float

    @property
    def of_point(self) -> dict[int, tuple[str, ...]]:
        """Coordinates by number of the group."""
        return dict(zip(self.points, self.parts, strict=True))


@dataclass(frozen=True)
class Blunders:
    """What the test says. found: the hypothesis, None where all is well; alike: as good ones."""

    found: Wrong | None = None
    alike: tuple[Wrong, ...] = ()


def blunders(evidence: Evidence) -> Blunders:
    """Control points and distances that contradict everything else, and others that could be wrong
    instead.

    The level holds for all hypotheses of one size together.
    """
    asked = [
        (n, part)
        for n, group in enumerate(evidence.groups)
        if group.single is not None and not group.known
        for part in _PARTS[group.effect.group]
        if len(group) == sum(map(len, _PARTS[group.effect.group]))
    ]
    if not asked:
        return Blunders()
    singles = [_tested(evidence, [one]) for one in asked]
    pairs = [_tested(evidence, pair) for pair in combinations(asked, 2) if pair[0][1] == pair[1][1]]
    found = _worst(singles, ())
    if found is None:
        found = _worst(pairs, ())
    elif (also := _worst(pairs, (found,))) is not None:
        found = also
    if found is None:
        return Blunders()
    near = 2.0 * SETTINGS.look_alike_log_odds
    alike = [
        one
        for one in (*singles, *pairs)
        if one.statistic > found.statistic - near
        and one.chance < np.log(SETTINGS.control_level)
        and not _holds(one, found)
        and not _holds(found, one)
    ]
    return Blunders(found, tuple(sorted(alike, key=lambda one: -one.statistic)))


def rivals(one: Wrong, others: Iterable[Wrong]) -> list[Wrong]:
    """Those of other hypotheses that are not far rarer than one which is taken."""
    return [other for other in others if _log_odds(one, other) < SETTINGS.look_alike_log_odds]


def _log_odds(one: Wrong, other: Wrong) -> float:
    """Log odds of one hypothesis against another: by what chance would leave of each, and by the
    rate at which points are wrong, which two are more rarely than one."""
    usual = np.log((1.0 - SETTINGS.wrong_control) / SETTINGS.wrong_control)
    left = [_log_chance(w.statistic, sum(len(part) for part in w.parts)) for w in (one, other)]
    # One of more points has passed a test of what the rest adds; it owes no more.
    return left[1] - left[0] + max(len(other.points) - len(one.points), 0) * usual


def stands(evidence: Evidence, wrong: Wrong, beside: Mapping[int, float]) -> bool:
    """Whether the points contradict everything else when groups n -> kappa are in the model too."""
    if not beside:
        return True
    at = np.concatenate(
        [evidence.groups[n].columns[_rows(evidence, n, part)] for n, part in wrong.of_point.items()]
    )
    statistic, _ = _chi_square(evidence.beside(beside), at)
    count = sum(
        len(_PARTS[group.effect.group]) for group in evidence.groups if group.single is not None
    )
    return bool(chdtrc(len(at), statistic) * count < SETTINGS.control_level)


def price(groups: list[Group], chosen: Iterable[int]) -> float:
    """Log odds that a model of these groups pays for control points of its own, where many.

    One or two wrong ones are what the test is for. Each of more is one accident more, of the rate
    at which points are wrong, where a single cause may have moved what lies together.
    """
    count = sum(groups[n].single is not None for n in chosen)
    usual = np.log(SETTINGS.wrong_control / (1.0 - SETTINGS.wrong_control))
    return count * float(usual - SETTINGS.log_prior_ground) if count > 2 else 0.0


def listed_points(groups: list[Group], hypotheses: Iterable[Wrong]) -> str:
    """GCP02 and GCP05 in height, or GCP15 in plan, or distance A to B."""
    where = {HEIGHT: " in height", PLAN: " in plan"}
    out = []
    for one in hypotheses:
        names = " and ".join(str(groups[n].single) for n in one.points)
        what = where.get(one.parts[0])
        out.append(f"distance {names}" if what is None else names + what)
    return ", or ".join(out)


def explains_all(evidence: Evidence, wrong: Wrong) -> bool:
    """Whether nothing contradicts any more once these points are out.

    Of the coordinates P of all points g_P' M_PP^-1 g_P is chi square of its rank; less what the
    wrong ones take of it, of as many degrees less.
    """
    at = np.concatenate([g.columns for g in evidence.groups if g.single is not None])
    statistic, rank = _chi_square(evidence.reduced, at)
    free = rank - sum(len(part) for part in wrong.parts)
    left = statistic - wrong.statistic
    return free <= 0 or bool(chdtrc(free, max(left, 0.0)) > SETTINGS.control_level)


def _tested(evidence: Evidence, hypothesis: Iterable[tuple[int, tuple[str, ...]]]) -> Wrong:
    points, parts = zip(*hypothesis, strict=True)
    at = np.concatenate(
        [evidence.groups[n].columns[_rows(evidence, n, part)] for n, part in hypothesis]
    )
    statistic, rank = _chi_square(evidence.reduced, at)
    # A coordinate that nothing else determines cannot be tested.
    chance = _log_chance(statistic, rank) if rank == len(at) else 0.0
    return Wrong(points, parts, statistic, chance)


def _chi_square(left: Reduced | Beside, at: np.ndarray) -> tuple[float, int]:
    """g' M^-1 g of some columns (k,) of the core, and its degrees of freedom."""
    M, g = left.M[np.ix_(at, at)], left.g[at]
    inverse, rank = pinvh(M, atol=SETTINGS.blind_information, rtol=0.0, return_rank=True)
    return float(g @ inverse @ g), rank


def _rows(evidence: Evidence, n: int, part: tuple[str, ...]) -> list[int]:
    return [k for k, (_, name, _) in enumerate(evidence.groups[n].labels) if name in part]


def _worst(hypotheses: list[Wrong], given: tuple[Wrong, ...]) -> Wrong | None:
    """The least likely of what passes the level; of pairs that hold a given one, by the rest."""
    if given:
        (first,) = given
        hypotheses = [
            Wrong(
                one.points,
                one.parts,
                one.statistic,
                _log_chance(max(one.statistic - first.statistic, 0.0), len(first.parts[0])),
            )
            for one in hypotheses
            if _holds(one, first)
        ]
    best = min(hypotheses, key=lambda one: one.chance, default=None)
    limit = np.log(SETTINGS.control_level / max(len(hypotheses), 1))
    return best if best is not None and best.chance < limit else None


def _log_chance(statistic: float, count: int) -> float:
    """Log of the probability that chi square of so many degrees of freedom is larger.

    Of a point a hundred sigmas off the probability itself is no number any more, nor are those of
    the points that it draws: from there on its leading term (Abramowitz and Stegun 1964, 6.5.32).
    """
    chance = float(chdtrc(count, statistic))
    if chance > np.finfo(float).tiny:
        return float(np.log(chance))
    half = 0.5 * statistic
    return float((0.5 * count - 1.0) * np.log(half) - half - gammaln(0.5 * count))


def _holds(larger: Wrong, smaller: Wrong) -> bool:
    """Whether a hypothesis holds all that another does."""
    return smaller.of_point.items() <= larger.of_point.items()
