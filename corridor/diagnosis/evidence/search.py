"""Which groups together explain the data: add, drop, swap and merge on M and g.

What a group has to bring follows from how large the largest evidence of all becomes when nothing is
missing: g ~ N(0, M) for all columns together, which tells at once how strongly candidates are
correlated, so that no correction for the number of tests is needed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from corridor.diagnosis.evidence.evidence import Evidence, Spectrum
from corridor.diagnosis.settings import SETTINGS


@dataclass
class Found:
    """A model: groups n -> kappa, in order of what they bring; evidence of each given the rest.

    kept: groups that a test of their own has found.
    """

    chosen: dict[int, float]
    evidence: dict[int, float]
    total: float
    kept: frozenset[int] = frozenset()

    @classmethod
    def of(cls, evidence: Evidence, chosen: dict[int, float], kept: Collection[int]) -> Found:
        """The model of groups n -> kappa, in their order."""
        each = contributions(evidence, chosen)
        return cls(chosen, each, evidence.total(chosen), frozenset(kept))

    @property
    def ordered(self) -> Found:
        """The same, what brings most first."""
        order = sorted(self.chosen, key=lambda n: -self.evidence[n])
        chosen, each = ({n: one[n] for n in order} for one in (self.chosen, self.evidence))
        return Found(chosen, each, self.total, self.kept)

    def without(self, gone: Collection[int]) -> Found:
        """The same without some groups; what the others bring is what it was beside them."""
        chosen, each = (
            {n: v for n, v in one.items() if n not in gone} for one in (self.chosen, self.evidence)
        )
        return Found(chosen, each, self.total, self.kept)

    def beyond(self, each: dict[int, float], threshold: float) -> Found:
        """Of these groups those whose evidence `each` is beyond a threshold, or which are kept."""
        order = sorted(
            (n for n in each if each[n] > threshold or n in self.kept), key=lambda n: -each[n]
        )
        chosen = {n: self.chosen[n] for n in order}
        return Found(chosen, {n: each[n] for n in order}, self.total, self.kept)


def search(evidence: Evidence, threshold: float, adjusted=(), kept: Collection[int] = ()) -> Found:
    """The model in which every group brings more than the threshold given all others.

    adjusted: keys of groups that the adjustment at hand has estimated. kept: groups that stay.
    """
    kept = frozenset(kept)
    chosen = tuned(evidence, dict.fromkeys(sorted(kept), 1.0))
    for _ in range(4 * SETTINGS.most_groups):
        before = dict(chosen)
        if len(chosen) < SETTINGS.most_groups:
            gains = evidence.given(chosen)
            best = max(range(len(gains)), key=lambda n: gains[n].evidence, default=None)
            if best is not None and gains[best].evidence > threshold:
                chosen[best] = gains[best].kappa
        chosen = _dropped(evidence, chosen, threshold, kept)
        chosen = _swapped(evidence, chosen, kept)
        chosen = _merged(evidence, chosen, kept)
        chosen = _named(evidence, chosen)
        chosen = tuned(evidence, chosen)
        if set(chosen) == set(before):
            break

    def leftover(n: int) -> float:
        # A generic shape stands in for physics, and leaves some of them however it is adjusted.
        known = evidence.groups[n].key in adjusted and not evidence.groups[n].generic
        return SETTINGS.leftover_share_adjusted if known else SETTINGS.leftover_share

    chosen = _dropped(evidence, chosen, threshold, kept, leftover)
    return Found.of(evidence, chosen, kept).ordered


def contributions(evidence: Evidence, chosen: dict[int, float]) -> dict[int, float]:
    """What each group of a model brings given the others."""
    out = {}
    for n in chosen:
        rest = {k: v for k, v in chosen.items() if k != n}
        out[n] = evidence.given(rest, only=n)[n].evidence
    return out


def _dropped(evidence, chosen, threshold, kept, leftover=lambda n: 0.0):
    """Without groups that bring less than the threshold, or than what the others leave.

    leftover: share of the evidence of a group that its linearisation, or its physics, may leave.
    """
    while len(chosen) > len(kept):
        each = contributions(evidence, chosen)
        least = min((n for n in each if n not in kept), key=each.get)
        if each[least] > max(threshold, *(leftover(n) * gain for n, gain in each.items())):
            break
        chosen = {k: v for k, v in chosen.items() if k != least}
    return chosen


def _swapped(evidence, chosen, kept):
    """Each group in turn replaced by the one that does better in its place."""
    for n in [n for n in chosen if n not in kept]:
        rest = {k: v for k, v in chosen.items() if k != n}
        gains = evidence.given(rest)
        best = max(range(len(gains)), key=lambda k: gains[k].evidence)
        if best != n and gains[best].evidence > gains[n].evidence:
            chosen = rest | {best: gains[best].kappa}
    return chosen


def _merged(evidence, chosen, kept):
    """Two groups replaced by one, where that is as good."""
    if len(chosen) < 2:
        return chosen
    total = evidence.total(chosen)
    best = None
    names = [n for n in chosen if n not in kept]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            rest = {k: v for k, v in chosen.items() if k not in (a, b)}
            gains = evidence.given(rest)
            one = max(range(len(gains)), key=lambda k: gains[k].evidence)
            trial = rest | {one: gains[one].kappa}
            found = evidence.total(trial)
            if found > total and (best is None or found > best[0]):
                best = found, trial
    return best[1] if best else chosen


def _named(evidence, chosen):
    """Each shape replaced by a named effect that explains nearly as much of the data.

    Residuals of a real flight hang together, and a shape with many parameters follows them where
    an effect of few cannot: what it brings beyond the effect is of the kind that it always brings.
    """
    for n in list(chosen):
        if not evidence.groups[n].generic:
            continue
        rest = {k: v for k, v in chosen.items() if k != n}
        gains = evidence.given(rest)
        names = [
            k
            for k, group in enumerate(evidence.groups)
            if not group.generic and group.own is None and group.single is None and k not in rest
        ]
        best = max(names, key=lambda k: gains[k].evidence, default=None)
        if best is None:
            continue
        near = gains[n].evidence - gains[best].evidence <= max(
            SETTINGS.look_alike_log_odds, SETTINGS.shape_advantage * gains[n].evidence
        )
        if near and gains[best].fit >= SETTINGS.named_share_of_shape * gains[n].fit:
            chosen = rest | {best: gains[best].kappa}
    return chosen


def tuned(evidence: Evidence, chosen: dict[int, float]) -> dict[int, float]:
    """The best kappa of each group given the others."""
    for n in list(chosen):
        if not evidence.groups[n].known:
            chosen = chosen | {n: evidence.likeliest(chosen, n)}
    return chosen


def thresholds(evidence: Evidence, level: float, rng: np.random.Generator) -> dict[str, float]:
    """Log evidence beyond which a group is `named` (`beside_noise`: the antenna's) and `suspected`.

    level: probability of a false name in a block without any; suspected: one block in twenty.
    """
    largest = largest_of_null(evidence, SETTINGS.null_draws, rng)
    rare = float(np.quantile(largest, 1.0 - level))
    less_rare = float(np.quantile(largest, 1.0 - max(SETTINGS.doubt_level, level)))
    return {
        "named": max(rare, SETTINGS.named_least),
        "beside_noise": max(rare, SETTINGS.model_log_odds),
        "suspected": max(less_rare, SETTINGS.suspected_least),
    }


def largest_of_null(evidence: Evidence, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Largest evidence (draws,) over all groups that images share, in blocks without an effect.

    Values for each image are many, and in such a block their Bayes factor is far below one; beyond
    e^T it is by a chance of e^-T at most, whatever there is (Good 1950).
    """
    core = Spectrum.of(evidence.reduced.M).drawn(draws, rng)
    # No effect at all has the evidence zero.
    return np.max([np.zeros(draws), *evidence.of_scores(core)], axis=0)
