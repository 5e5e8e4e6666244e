"""Noise of the GNSS and what is missing from the model, judged together.

What is missing from a model inflates the noise that one finds, and then hides in it.
Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.linalg import cho_solve

from corridor.adjustment import LinearSystem
from corridor.diagnosis.evidence import Evidence
from corridor.diagnosis.gnss_noise import GnssNoise, Likelihood, estimate, parts_of, stated_noise
from corridor.diagnosis.reduced import Antennas
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
        if not self.few:
            self.P, self.rho, self.core, self.own = antennas

    def touches(self, n: int) -> float:
        """How much of what a group explains the antenna positions see: 0 to 1, or more."""
        if self.few:
            return 0.0
        group = self.evidence.groups[n]
        across = self._across(group)
        if across is None:
            return 0.0
        inside = np.diag(self.evidence.block(group)[0])
        seen = np.einsum("ij,ij->j", across, across * (self.stated.stated**2)[:, None])
        return float(np.max(seen / np.maximum(inside, 1e-12), initial=0.0))

    def _across(self, group) -> np.ndarray | None:
        return self.core[:, group.columns] if group.own is None else self.own[group.own]

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
            return self.stated, self.evidence.model(chosen)[0]
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
        A = self._columns([n])
        if group.own is None:
            _, alone = estimate(self.stated, self.P, self.rho)
            both = [estimate(self.stated, self.P, self.rho + A @ t)[1] for t in (theta, -theta)]
            return float(0.5 * theta @ M @ theta + 0.5 * (np.mean(both) - alone))
        rho, g = self.rho + A @ theta, g + M @ theta
        inside = M + np.eye(len(M)) / np.mean(theta**2)
        step = np.linalg.solve(inside, np.column_stack([g, A.T]))
        _, logdet = np.linalg.slogdet(inside * np.mean(theta**2))
        _, alone = estimate(self.stated, self.P, rho)
        _, with_it = estimate(self.stated, self.P - A @ step[:, 1:], rho - A @ step[:, 0])
        return float(0.5 * (g @ step[:, 0] - logdet + alone - with_it))

    def _left(self, chosen: dict[int, float]) -> tuple[float, np.ndarray, np.ndarray]:
        """Log evidence of groups with the stated noise, and the P and rho that they leave."""
        base, theta, factor = self.evidence.model(chosen)
        P, rho = self.P, self.rho
        if chosen:
            A = self._columns(chosen)
            P = P - A @ cho_solve(factor, A.T, check_finite=False)
            rho = rho - A @ theta
        return base, P, rho

    def _columns(self, chosen: Iterable[int]) -> np.ndarray:
        """Between the antenna positions and groups together (3k, columns)."""
        parts = []
        for n in chosen:
            across = self._across(self.evidence.groups[n])
            empty = np.zeros((len(self.rho), len(self.evidence.groups[n])))
            parts.append(empty if across is None else across)
        return np.concatenate(parts, axis=1)

    def parameters(
        self, chosen: dict[int, float], noise: GnssNoise, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Parameters (p,) of groups n -> kappa together and their covariance (p, p).

        Averaged over the noises that the data allow, near `noise`: how slow and how large it is
        is known from a few correlation times, and what looks like slow noise (a lever arm, a
        drift) is the less certain for it. None where the stated noise knows nothing of a group.
        """
        groups = [self.evidence.groups[n] for n in chosen]
        if any(g.own is not None and self.evidence.block(g)[0] is None for g in groups):
            return None
        theta, K = self.evidence.solution(chosen)
        if self.few:
            return theta, K
        A = self._columns(chosen)
        turned = A @ K
        P, rho = self.P - turned @ A.T, self.rho - A @ theta
        parts = parts_of(self.stated, P, rho)
        count = SETTINGS.noise_draws if len(parts) == 1 else SETTINGS.noise_draws_by_axis
        drawn, log_weight = [], np.zeros(count)
        for one in parts:
            x, length = one.likely(one.arguments(noise), count, rng)
            log_weight -= 0.5 * (np.array([one(each)[0] for each in x]) - length)
            drawn.append(x)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        whole = Likelihood(self.stated, P, rho, list(self.stated.blocks()))
        columns = np.column_stack([turned, rho])
        found, spread = [], np.zeros_like(K)
        for k, share in enumerate(weight):
            one = noise
            for part, x in zip(parts, drawn, strict=True):
                one = part.noise_at(x[k], one)
            left = turned.T @ whole.solved(one, columns)
            found.append(theta - left[:, -1])
            spread += share * (K + left[:, :-1])
        mean = weight @ np.array(found)
        away = np.array(found) - mean
        return mean, spread + (away * weight[:, None]).T @ away


def few_positions(system: LinearSystem) -> bool:
    """Whether there are too few antenna positions to tell of their noise."""
    return system.gnss.sigma.size < SETTINGS.few_antenna_coordinates
