"""Profile likelihood: noise of the GNSS is estimated anew with each model, and judged with it.

What is missing from a model inflates the noise that one finds, and then hides in it: what the
antenna feels is judged beside noise that may do the same.
Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from corridor.core.adjustment import LinearSystem
from corridor.diagnosis.evidence.evidence import Evidence, Size, near_the_best
from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.noise.gnss import GnssNoise, bounds, stated_noise
from corridor.diagnosis.noise.likelihood import Arguments, Likely, estimate, value_of
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Elimination, too_wide

# Random signs that tell how much of values for each image the antenna sees: to a tenth.
_SIGNS = 24
# Rows of an image: its pose, and the slow noise of its antenna position on three axes.
_WITH_STATES = 9


class NoiseModel:
    """The noise of the GNSS by restricted maximum likelihood, for any set of effects.

    `given` finds the noise of a model of some groups, and how probable the data are with both.
    stated: the noise that gnss.csv states. evidence: with that noise. equations, lens: of its
    system, and what is in all models; arguments: what is known of the noise beforehand.
    """

    def __init__(
        self,
        evidence: Evidence,
        near: GnssNoise | None = None,
        start: Mapping[int, Size] | None = None,
    ):
        """evidence: of a system with the stated noise. near: the noise of an earlier round.
        start: the groups that have been adjusted."""
        self.evidence = evidence
        self.start = start or {}
        made = evidence.reduced.elimination
        self.equations = made.equations if made is not None else None
        self.lens = made.rows if made is not None else ()
        self.few = made is None or not known(made.equations.system)
        self._touches: dict[tuple, float] = {}
        self._found: dict[tuple, Likely] = {}
        if self.few:
            return
        redundancy = _redundancy(made)
        self.stated = stated_noise(made.equations.system, redundancy)
        # Of code solutions nobody expects more than is stated.
        fixed = np.isfinite(self.stated.most[1]).all()
        self._followed = bool(fixed and not bounds(redundancy).all())
        self.arguments = Arguments(self.stated)
        self._near = None if near is None else self.arguments.of(near)
        self._base = made.log_probability

    @property
    def misstated(self) -> np.ndarray | None:
        """Factors (flights, 3) on stated standard deviations so small that cameras follow the
        positions, beside what has been adjusted; None where what is stated can be asked as it
        is."""
        if self.few or not self._followed:
            return None
        factor = self._likely(self.start).noise.white
        large = (factor > SETTINGS.white_of_scatter).any(axis=1, keepdims=True)
        return np.where(large, np.maximum(factor, 1.0), 1.0) if large.any() else None

    def touches(self, n: int) -> float:
        """Share of what a group explains that the antenna positions see: 0 to 1, or more."""
        if self.few:
            return 0.0
        group = self.evidence.groups[n]
        key = group.key, tuple(group.columns[:1]), len(group)
        if key not in self._touches:
            made = self.evidence.reduced.elimination
            variance = (self.stated.stated**2)[:, None]
            if group.own is None:
                felt = made.felt(group.columns)
                inside = self.evidence.block(group)[0].diagonal()
                share = (felt**2 * variance).sum(axis=0) / np.maximum(inside, 1e-12)
                self._touches[key] = float(np.max(share, initial=0.0))
            else:
                sign = signs(len(group), _SIGNS)
                moved, felt = made.spread(group, sign)
                whole = max(float((sign * moved).sum()), 1e-12)
                self._touches[key] = float((felt**2 * variance).sum()) / whole
        return self._touches[key]

    def freedom(self, noise: GnssNoise) -> float:
        """Degrees of freedom with which the size of slow noise is known.

        Correlation times of all flights and axes, and what the prior knowledge is worth.
        """
        span = [
            np.ptp(noise.time[rows // 3]) / noise.tau[f, axis] for rows, f, axis in noise.blocks()
        ]
        return float(np.sum(span)) + 0.5 / SETTINGS.slow_prior[1] ** 2

    def given(self, chosen: Mapping[int, Size]) -> tuple[GnssNoise | None, float]:
        """The noise of a model of groups n -> kappa, and the log probability of the data.

        It is sought from the noise of the largest part of that model for which it is known.
        """
        if self.few:
            return None, self.evidence.total(chosen)
        found = self._likely(chosen)
        return found.noise, self._probability(chosen, found.value)

    def at(self, chosen: Mapping[int, Size], noise: GnssNoise) -> float:
        """The log probability of the data with groups n -> kappa and this noise."""
        x = self.arguments.of(noise)
        made = Elimination(self.equations, noise, self._rows(chosen))
        return self._probability(chosen, value_of(made, self.arguments, x))

    def _likely(self, chosen: Mapping[int, Size]) -> Likely:
        key = tuple((n, np.asarray(chosen[n], dtype=float).tobytes()) for n in sorted(chosen))
        if key not in self._found:
            parts = [one for one in self._found if {n for n, _ in one} <= set(chosen)]
            near = self._found[max(parts, key=len)].x if parts else self._near
            self._found[key] = estimate(self.equations, self._rows(chosen), self.arguments, near)
        return self._found[key]

    def _rows(self, chosen: Mapping[int, Size]):
        return (*self.lens, *self.evidence.rows(chosen))

    def _probability(self, chosen: Mapping[int, Size], value: float) -> float:
        """Log probability beside that with the stated noise and no group, of -2 log L."""
        return -0.5 * value - self._base + self.evidence.prior(chosen)

    def parameters(
        self, chosen: Mapping[int, Size], noise: GnssNoise, rng: np.random.Generator
    ) -> tuple[dict, dict]:
        """Parameters (p,) of groups n -> kappa together and their covariance (p, p), each.

        Averaged over the noises that the data allow, near `noise`: how slow and how large it is
        is known from a few correlation times, and what looks like slow noise (a lever arm, a
        drift) is the less certain for it.
        """
        likely = estimate(
            self.equations, self._rows(chosen), self.arguments, self.arguments.of(noise)
        )
        draws, length = self._drawn(likely, rng)
        log_weight, found = [], []
        for x, away in zip(draws, length, strict=True):
            made = Elimination(
                self.equations, self.arguments.noise_at(x), self._rows_of_images(chosen)
            )
            here = Evidence(made.reduced())
            here.groups = self.evidence.groups
            core = self.evidence.of_core(chosen)
            log_weight.append(
                here.total(core) + made.log_probability - 0.5 * self.arguments.far(x) + 0.5 * away
            )
            found.append(here.solution(core))
        weight = np.exp(np.array(log_weight) - max(log_weight))
        weight /= weight.sum()
        whole = Evidence(Elimination(self.equations, likely.noise, self.lens).reduced())
        whole.groups = self.evidence.groups
        theta, spread = whole.solution(chosen)
        for n in self.evidence.of_core(chosen):
            each = np.array([values[n] for values, _ in found])
            theta[n] = weight @ each
            away = each - theta[n]
            within = sum(w * one[n] for w, (_, one) in zip(weight, found, strict=True))
            spread[n] = within + (away * weight[:, None]).T @ away
        return theta, spread

    def _rows_of_images(self, chosen: Mapping[int, Size]):
        return self._rows(self.evidence.of_images(chosen))

    def _drawn(self, likely: Likely, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Arguments (draws, n) that are likely too, and -2 log of the density of each.

        From the normal distribution of the curvature.
        """
        value, vector = np.linalg.eigh(0.5 * likely.curve)
        # Nothing is known less well than the prior says.
        least = np.linalg.eigvalsh(self.arguments.precision)[0]
        spread = 1.0 / np.sqrt(np.maximum(value, least))
        unit = rng.standard_normal((SETTINGS.noise_draws, len(likely.x)))
        made = likely.x + (unit @ vector * spread) @ vector.T
        return np.clip(made, self.arguments.low, self.arguments.high), np.sum(unit**2, axis=1)


def _redundancy(made: Elimination) -> np.ndarray:
    """Mean redundancy (3,) of the antenna positions on each axis, with their stated noise."""
    sigma = made.equations.system.gnss.sigma.ravel()
    sign = signs(len(sigma), _SIGNS)
    share = (sign * made.weight(sign)).mean(axis=1) * sigma**2
    return share.reshape(-1, 3).mean(axis=0)


def signs(count: int, many: int) -> np.ndarray:
    """Random signs (count, many): the mean of z'Mz is the trace of M.

    Source: Hutchinson 1990.
    """
    return np.random.default_rng(0).choice([-1.0, 1.0], (count, many))


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
    short = [n for n in order if at_stated[n].evidence > threshold["named"]][: SETTINGS.most_groups]
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
        rest = {k: kappa for k, kappa in found.chosen.items() if k != n}
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
    each = near_the_best(lambda size: noises.at(base | {n: size}, found), kappa)
    return float(np.logaddexp.reduce(list(each.values()))), max(each, key=each.get)


def known(system: LinearSystem) -> bool:
    """Whether the noise of the antenna positions can be told: there are enough of them, and the
    block is no area of photographs, in which a state for each of them would be too much."""
    enough = system.gnss.sigma.size >= 3 * SETTINGS.fewest
    return enough and has_states(system)


def has_states(system: LinearSystem) -> bool:
    """Whether a block can have a state of slow noise for each antenna position."""
    return not too_wide(system, _WITH_STATES)
