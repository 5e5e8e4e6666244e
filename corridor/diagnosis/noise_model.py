"""Noise of the GNSS and what is missing from the model, judged together.

What is missing from a model inflates the noise that one finds, and then hides in it.
Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from corridor.adjustment import LinearSystem
from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.gnss_noise import (
    GnssNoise,
    Likelihood,
    Weight,
    estimate,
    parts_of,
    stated_noise,
)
from corridor.diagnosis.joint import Together
from corridor.diagnosis.reduced import CHUNK, Antennas, whole
from corridor.diagnosis.settings import SETTINGS


class NoiseModel:
    """The noise of the GNSS by restricted maximum likelihood, for any set of effects.

    What is missing from a model inflates the noise that one finds, and then hides in it: noise
    and effects have to be compared together. `given` finds the noise of a model of some groups,
    and how probable the data are with both.
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
            inside = self.evidence.block(group)[0].diagonal()
            seen = np.concatenate([self._seen(group, at) for at in chunks(len(group))])
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

    def apart(self, n: int, theta: np.ndarray) -> float:
        """Log likelihood by which the n-th group explains more than the noise could in its place.

        Of data like these, in which nothing is missing, with parameters theta (p,), in prior
        standard deviations, on top: once the noise alone is fitted to them, once the noise with
        the group. Of values for each image only their size is known then; of others all, and the
        mean of theta and -theta is taken, so that this block's noise has no part in it.
        """
        group = self.evidence.groups[n]
        M, g = self.evidence.block(group)
        M, A = whole(M), self._columns([n])
        if group.own is None:
            _, alone = estimate(self.stated, self.P, self.rho)
            both = [estimate(self.stated, self.P, self.rho + A @ t)[1] for t in (theta, -theta)]
            return float(0.5 * theta @ M @ theta + 0.5 * (np.mean(both) - alone))
        rho, g = self.rho + A @ theta, g + M @ theta
        inside = M + np.eye(len(M)) / np.mean(theta**2)
        step = np.linalg.solve(inside, np.column_stack([g, A.T]))
        _, logdet = np.linalg.slogdet(inside * np.mean(theta**2))
        _, alone = estimate(self.stated, self.P, rho)
        _, with_it = estimate(self.stated, self.P.less(A, step[:, 1:]), rho - A @ step[:, 0])
        return float(0.5 * (g @ step[:, 0] - logdet + alone - with_it))

    def _left(self, chosen: dict[int, float]) -> tuple[float, Weight, np.ndarray]:
        """Log evidence of groups with the stated noise, and the P and rho that they leave."""
        base, theta, factor = self.evidence.model(chosen)
        P, rho = self.P, self.rho
        if chosen:
            # The antenna hardly feels several values for each image, and they are many.
            felt = isinstance(factor, Together) or self._is_felt(chosen)
            A = self._columns(chosen if felt else factor.others(chosen))
            P = P.less(A, factor.solve(A.T) if felt else factor.solve_others(A.T))
            rho = rho - A @ (theta if felt else theta[factor.rest])
        return base, P, rho

    def _is_felt(self, chosen: Iterable[int]) -> bool:
        """Whether the antenna feels all per-image columns of a model."""
        own = [self.evidence.groups[n].own for n in chosen]
        return all(self.own[n] is not None for n in own if n is not None)

    def _columns(self, chosen: Iterable[int]) -> np.ndarray:
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
        A = self._columns(chosen)
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


def chunks(count: int) -> list[slice]:
    """Columns that are solved together."""
    return [slice(a, min(a + CHUNK, count)) for a in range(0, count, CHUNK)]


def few_positions(system: LinearSystem) -> bool:
    """Whether there are too few antenna positions to tell of their noise."""
    return system.gnss.sigma.size < SETTINGS.few_antenna_coordinates
