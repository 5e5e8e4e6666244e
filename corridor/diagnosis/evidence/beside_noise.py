"""Noise of the GNSS and what is missing from the model, judged together.

What is missing from a model inflates the noise that one finds, and then hides in it: what the
antenna feels is judged beside noise that may do the same.
Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from corridor.core.adjustment import LinearSystem
from corridor.diagnosis.evidence.evidence import Evidence, effect_sizes
from corridor.diagnosis.evidence.joint import Together
from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.noise.gnss import (
    GnssNoise,
    Likelihood,
    Weight,
    estimate,
    parts_of,
    stated_noise,
)
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Antennas

# Columns of which it is asked together what the antenna feels of them.
_AT_ONCE = 200


class NoiseModel:
    """The noise of the GNSS by restricted maximum likelihood, for any set of effects.

    `given` finds the noise of a model of some groups, and how probable the data are with both.
    stated: the noise that gnss.csv states; P, rho: what the antenna positions know of it.
    """

    def __init__(self, system: LinearSystem, antennas: Antennas | None, evidence: Evidence):
        """antennas, evidence: of the system with the stated noise; None without positions."""
        self.stated = stated_noise(system)
        self.evidence = evidence
        self.few = antennas is None or few_positions(system)
        self._found: dict[tuple, tuple[GnssNoise, float]] = {}
        self._start: GnssNoise | None = None
        self._touches: dict[tuple, float] = {}
        if not self.few:
            self.P, self.rho, self.core, self.own, self._under = antennas
            self.P = Weight.of(self.P)

    def touches(self, n: int) -> float:
        """How much of what a group explains the antenna positions see: 0 to 1, or more."""
        if self.few:
            return 0.0
        group = self.evidence.groups[n]
        if group.own is not None and self.own[group.own] is None:
            return 0.0
        key = group.key, tuple(group.columns[:1]), len(group)
        if key not in self._touches:
            matrix = self.evidence.block(group)[0]
            if matrix is None:
                # Several values for each image, which are in no model yet, are not asked about.
                return 0.0
            inside = matrix.diagonal()
            count = len(group)
            some = [slice(at, min(at + _AT_ONCE, count)) for at in range(0, count, _AT_ONCE)]
            seen = np.concatenate([self._seen(group, at) for at in some])
            self._touches[key] = float(np.max(seen / np.maximum(inside, 1e-12), initial=0.0))
        return self._touches[key]

    def _seen(self, group, at: slice) -> np.ndarray:
        """Information (p,) on some columns of a group that the antenna positions feel."""
        across = self._across(group, at)
        return np.einsum("ij,ij->j", across, across * (self.stated.stated**2)[:, None])

    def _across(self, group, at: slice = slice(None)) -> np.ndarray | None:
        if group.own is None:
            return self.core[:, group.columns[at]]
        return None if self.own[group.own] is None else self.own[group.own](at)

    def freedom(self, noise: GnssNoise) -> float:
        """Degrees of freedom with which the size of slow noise is known.

        Correlation times of all flights and axes, and what the prior knowledge is worth.
        """
        span = [
            np.ptp(noise.time[rows // 3]) / noise.tau[f, axis] for rows, f, axis in noise.blocks()
        ]
        return float(np.sum(span)) + 0.5 / SETTINGS.slow_prior[1] ** 2

    def given(self, chosen: dict[int, float]) -> tuple[GnssNoise, float]:
        """The noise of a model of groups n -> kappa, and the log probability of the data.

        It is sought from the noise of the model without any, whatever was asked before.
        """
        if self.few:
            return self.stated, self.evidence.total(chosen)
        key = tuple(sorted(chosen.items()))
        if key not in self._found:
            if self._start is None:
                self._start, _ = estimate(self.stated, self.P, self.rho)
            base, P, rho = self._left(chosen)
            noise, value = estimate(self.stated, P, rho, self._start)
            self._found[key] = noise, base - 0.5 * value
        return self._found[key]

    def at(self, chosen: dict[int, float], noise: GnssNoise) -> float:
        """The log probability of the data with groups n -> kappa and this noise."""
        base, P, rho = self._left(chosen)
        parts = parts_of(self.stated, P, rho)
        return base - 0.5 * sum(one.value(one.arguments(noise)) for one in parts)

    def _left(self, chosen: dict[int, float]) -> tuple[float, Weight, np.ndarray]:
        """Log evidence of groups with the stated noise, and the P and rho that they leave."""
        base, theta, factor = self.evidence.model(chosen)
        P, rho = self.P, self.rho
        if chosen:
            # The antenna hardly feels several values for each image, and they are many.
            felt = isinstance(factor, Together) or self._is_felt(chosen)
            A = self.columns(chosen if felt else factor.others(chosen))
            P = P.less(A, factor.solve(A.T) if felt else factor.solve_others(A.T))
            rho = rho - A @ (theta if felt else theta[factor.rest])
        return base, P, rho

    def _is_felt(self, chosen: Iterable[int]) -> bool:
        """Whether the antenna feels all per-image columns of a model."""
        own = [self.evidence.groups[n].own for n in chosen]
        return all(self.own[n] is not None for n in own if n is not None)

    def columns(self, chosen: Iterable[int]) -> np.ndarray:
        """Between the antenna positions and groups together (3k, columns)."""
        parts = []
        for n in chosen:
            across = self._across(self.evidence.groups[n])
            empty = np.zeros((len(self.rho), len(self.evidence.groups[n])))
            parts.append(empty if across is None else across)
        return np.concatenate([np.zeros((len(self.rho), 0)), *parts], axis=1)

    def parameters(
        self, chosen: dict[int, float], noise: GnssNoise, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Parameters (p,) of groups n -> kappa together and their covariance (p, p).

        Averaged over the noises that the data allow, near `noise`: how slow and how large it is
        is known from a few correlation times, and what looks like slow noise (a lever arm, a
        drift) is the less certain for it. None where the stated noise knows nothing of a group, or
        values for each image are taken piece by piece.
        """
        groups = [self.evidence.groups[n] for n in chosen]
        if any(g.own is not None and self.evidence.block(g)[0] is None for g in groups):
            return None
        if self.evidence.in_pieces(chosen):
            return None
        theta, K = self.evidence.solution(chosen)
        if self.few:
            return theta, K
        A = self.columns(chosen)
        turned = A @ K
        P, rho = self.P.less(turned, A.T), self.rho - A @ theta
        parts = parts_of(self.stated, P, rho)
        count = SETTINGS.noise_draws if len(parts) == 1 else SETTINGS.noise_draws_by_axis
        drawn, log_weight = [], np.zeros(count)
        for one in parts:
            x, length = one.likely(one.arguments(noise), count, rng)
            log_weight -= 0.5 * (np.array([one(each)[0] for each in x]) - length)
            drawn.append(x)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        # Solved at once where there are few, along the chain where there are many.
        dense = len(parts) == 1 or self._under is None
        at_once = Likelihood(self.stated, P, rho, list(self.stated.blocks())) if dense else None
        columns = np.column_stack([turned, rho])
        found, spread = [], np.zeros_like(K)
        for k, share in enumerate(weight):
            one = noise
            for part, x in zip(parts, drawn, strict=True):
                one = part.noise_at(x[k], one)
            solved = at_once.solved(one, columns) if dense else self._solved(P, one, columns)
            left = turned.T @ solved
            found.append(theta - left[:, -1])
            spread += share * (K + left[:, :-1])
        mean = weight @ np.array(found)
        away = np.array(found) - mean
        return mean, spread + (away * weight[:, None]).T @ away

    def _solved(self, P: Weight, noise: GnssNoise, columns: np.ndarray) -> np.ndarray:
        """D (I + P D)^-1 columns (3k, n) of a noise, never with P as a whole.

        With the noise in place of the stated one the antenna positions weigh P (I + D P)^-1, which
        gives (I + P D)^-1 = I - P (I + D P)^-1 D; what P has lost since is of low rank.
        Source: Golub and Van Loan 2013, 2.1.4 (Sherman, Morrison and Woodbury).
        """
        weight = self._under(noise)

        def spread(rows: np.ndarray) -> np.ndarray:
            return noise.spread(rows) - self.stated.spread(rows)

        left = np.concatenate([np.zeros((len(P), 0)), *(a for a, _ in P.taken)], axis=1)
        right = np.concatenate([np.zeros((0, len(P))), *(b for _, b in P.taken)])
        both = np.concatenate([columns, left], axis=1)
        both = both - weight(spread(both))
        out, left = both[:, : columns.shape[1]], both[:, columns.shape[1] :]
        inside = np.eye(left.shape[1]) - right @ spread(left)
        return spread(out + left @ np.linalg.solve(inside, right @ spread(out)))


def through_noise(
    noises: NoiseModel,
    plain: Evidence,
    evidence: Evidence,
    found: Found,
    threshold: dict[str, float],
    model: list[str],
) -> dict[int, float] | None:
    """A model with one more group, where noise and group together explain the data better.

    None where nothing hides in the noise, or strong effects wait to be adjusted first. plain,
    evidence: with the stated noise, and with that of the model. model: keys of what has been
    adjusted. The shortlist is what would win if the GNSS were as good as it says.
    """
    if noises.few:
        return None
    strong = [
        evidence.groups[n].key for n, v in found.evidence.items() if v > SETTINGS.clear_evidence
    ]
    if not set(strong) <= set(model):
        return None
    here = evidence.given(found.chosen)
    if max((gain.evidence for gain in here), default=0.0) > SETTINGS.clear_evidence:
        return None
    base = {
        n: max(k, 1.0)
        for n, k in found.chosen.items()
        if found.evidence[n] >= SETTINGS.clear_evidence
    }
    at_stated = plain.given(base)
    order = sorted(range(len(at_stated)), key=lambda n: -at_stated[n].evidence)
    short = [n for n in order if at_stated[n].evidence > threshold["named"]][: SETTINGS.shortlist]
    ranked = sorted(range(len(here)), key=lambda n: -here[n].evidence)
    short += [n for n in ranked[:2] if n not in short and here[n].evidence > 0.0]
    short = [n for n in short if n not in base and noises.touches(n) > SETTINGS.gnss_share]
    if not short:
        return None
    _, total = noises.given(base)
    best = None
    for n in short:
        found_total, kappa = _probability(noises, base, n, at_stated[n].kappa)
        if best is None or found_total > best[0]:
            best = found_total, base | {n: kappa}
    return best[1] if best[0] - total > threshold["suspected"] else None


def beyond_noise(noises: NoiseModel, found: Found, threshold: float) -> Found:
    """The model with the evidence of what the antenna feels against noise that may do the same.

    Noise that was estimated with an effect in the model leaves all of it to the effect. What is
    missing without the effect is what noise of another size and slowness cannot make up for.
    """
    if noises.few:
        return found
    each = dict(found.evidence)
    for n, gain in found.evidence.items():
        clear = n in found.kept or gain > SETTINGS.clear_evidence
        if clear or noises.touches(n) <= SETTINGS.gnss_share:
            continue
        rest = {
            k: kappa
            for k, kappa in found.chosen.items()
            if k != n and noises.evidence.block(noises.evidence.groups[k])[0] is not None
        }
        _, without = noises.given(rest)
        total, _ = _probability(noises, rest, n, found.chosen[n])
        each[n] = min(gain, total - without)
    return found.beyond(each, threshold)


def _probability(
    noises: NoiseModel, base: dict[int, float], n: int, kappa: float
) -> tuple[float, float]:
    """Log probability of the data with one more group, averaged over its sizes, and the likeliest.

    The noise is estimated with the group in the model, of size `kappa`.
    """
    found, total = noises.given(base | {n: kappa})
    if noises.evidence.groups[n].known:
        return total, kappa
    each: dict[int, float] = {}
    sizes, _ = effect_sizes()
    begin = int(np.argmin(np.abs(np.log(sizes / kappa))))
    for upwards in (range(begin, len(sizes)), range(begin - 1, -1, -1)):
        for k in upwards:
            each[k] = noises.at(base | {n: float(sizes[k])}, found)
            if each[k] < max(each.values()) - SETTINGS.model_log_odds:
                break
    return float(np.logaddexp.reduce(list(each.values()))), float(sizes[max(each, key=each.get)])


def few_positions(system: LinearSystem) -> bool:
    """Whether there are too few antenna positions to tell of their noise."""
    return system.gnss.sigma.size < SETTINGS.few_antenna_coordinates
