"""How much more likely the data are with a group of columns than without it.

Parameters theta ~ N(0, kappa^2) in prior standard deviations, averaged over several kappa:

    log B(kappa) = 1/2 g' (M + I / kappa^2)^-1 g - 1/2 log |I + kappa^2 M|

Given other groups S in the model, M and g are what S leaves of them. Values for each image are many
and far apart: their log B is the difference of two exact probabilities of the block (see
`elimination`), with them beside the poses and without. Where the scores of a group
vary by a factor phi more than independent residuals would let them, M and g count by 1 / phi.
Source: Kass and Raftery 1995, "Bayes factors"; Chandler and Bate 2007 (phi: see `clusters`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from threading import Lock

import numpy as np
from scipy.linalg import eigh, pinvh

from corridor.diagnosis.settings import SETTINGS, side_by_side
from corridor.diagnosis.system.elimination import Elimination, Reduced, rows_of
from corridor.diagnosis.system.groups import Group

# Systems beside values for each image, and models, that are kept; and what eliminations may weigh:
# one is kept whatever it weighs, of a thousand images more than a hundred megabytes.
_SYSTEMS, _MODELS, _CHAIN_BYTES = 48, 8, 1e8
_ONE = Lock()

# A size in prior standard deviations, of all parameters of a group or of each (p,).
Size = float | np.ndarray


def effect_sizes() -> tuple[np.ndarray, np.ndarray]:
    """Sizes of an effect in prior standard deviations, and the logarithm of how likely each is."""
    return np.array(SETTINGS.effect_sizes), np.log(SETTINGS.effect_size_weights)


@dataclass
class Spectrum:
    """Eigenvalues (p,) and vectors (p, p), in columns, of a group's M."""

    value: np.ndarray
    vector: np.ndarray

    @classmethod
    def of(cls, M: np.ndarray) -> Spectrum:
        """Spectrum of M (p, p), symmetric."""
        value, vector = eigh(0.5 * (M + M.T), check_finite=False)
        return cls(np.maximum(value, 0.0), vector)

    def drawn(self, draws: int, rng: np.random.Generator) -> np.ndarray:
        """Normal deviates (p, draws) of covariance M.

        By its symmetric root: vectors alone are a matter of rounding where values are alike.
        """
        normal = self.vector.T @ rng.standard_normal((len(self.value), draws))
        return self.vector @ (np.sqrt(self.value)[:, None] * normal)

    def log_bayes(self, h: np.ndarray) -> np.ndarray:
        """Log Bayes factors (kappas, ...) of h = V'g (p, ...).

        What nothing determines says nothing, whatever a huge size would make of it: see `solution`.
        """
        k2 = (effect_sizes()[0] ** 2)[:, None]
        seen = self.value > SETTINGS.blind_information
        grown = k2 * np.where(seen, self.value, 0.0)
        gain = np.tensordot(seen * 0.5 * k2 / (1.0 + grown), h**2, axes=(1, 0))
        cost = 0.5 * np.log1p(grown).sum(axis=1)
        return gain - cost.reshape((-1,) + (1,) * (h.ndim - 1))


def near_the_best(of: Callable[[float], float], start: float) -> dict[float, float]:
    """Log evidence by size, from one near `start` to both sides until it falls far behind."""
    sizes, each = np.array(SETTINGS.effect_sizes), {}
    begin = int(np.argmin(np.abs(sizes - start)))
    for some in (sizes[begin:], sizes[:begin][::-1]):
        for size in some.tolist():
            each[size] = of(size)
            if each[size] < max(each.values()) - SETTINGS.model_log_odds:
                break
    return each


def averaged(log_bayes: np.ndarray) -> np.ndarray:
    """Average over kappa of Bayes factors (kappas, ...), as logarithm."""
    weight = effect_sizes()[1].reshape((-1,) + (1,) * (log_bayes.ndim - 1))
    return np.logaddexp.reduce(log_bayes + weight, axis=0)


@dataclass
class Gain:
    """What a group adds to a model: log evidence, its best kappa, and half the chi square."""

    evidence: float
    kappa: float
    fit: float


@dataclass(frozen=True)
class Beside:
    """What a model leaves of what images share, and what it explains.

    M (c, c), g (c,): of all the core, the model's own columns too. fit - cost: its log evidence.
    """

    M: np.ndarray
    g: np.ndarray
    fit: float
    cost: float


@dataclass(frozen=True)
class _Explained:
    """What groups that images share explain, and what they cost; their parameters theta (q,), and
    the inverse (q, q) of M with the priors."""

    fit: float
    cost: float
    theta: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, M: np.ndarray, g: np.ndarray, kappa: np.ndarray, mean: np.ndarray) -> _Explained:
        """Of M (q, q) and g (q,), and of the sizes and means (q,) of their priors."""
        inverse, logdet = inverted(M + np.diag(kappa**-2.0))
        expected = M @ mean
        away = g - expected
        step = inverse @ away
        fit = mean @ g - 0.5 * mean @ expected + 0.5 * away @ step
        cost = 0.5 * logdet + float(np.log(kappa).sum())
        return cls(float(fit), cost, mean + step, inverse)


class Evidence:
    """Evidence of groups, alone and given others, on one reduced system."""

    def __init__(
        self, reduced: Reduced, barred: Iterable[str] = (), inflation: np.ndarray | None = None
    ):
        """inflation: factor (groups,) on the variance of each group's scores; default: one."""
        self.reduced = reduced
        self.inflation = np.ones(len(reduced.groups)) if inflation is None else inflation
        # Keys of groups that are no explanation, however well they fit.
        self.barred = set(barred)
        self.groups: list[Group] = list(reduced.groups)
        self.number = {group.key: n for n, group in enumerate(self.groups)}
        # Systems beside values for each image, which many models share, and the last models.
        self._systems: dict[tuple, Reduced] = {}
        self._chains: dict[tuple, Elimination] = {}
        self._models: dict[tuple, Beside] = {}
        # A search asks for the same models again and again.
        self._sums: dict[tuple, tuple[float, float]] = {}
        self._gains: dict[tuple, list[Gain]] = {}

    def narrow(self, n: int, names: Iterable[str]) -> None:
        """Only these parameters of the n-th group are asked for from now on."""
        group, names = self.groups[n], set(names)
        self.groups[n] = group.part(
            [k for k, (_, name, _) in enumerate(group.labels) if name in names]
        )
        self._forget()

    def narrowed(self, names: Mapping[int, Iterable[str]]) -> Evidence:
        """Another view of the same, that asks some groups n for these parameters only."""
        view = Evidence(self.reduced, self.barred, self.inflation)
        for n, mine in names.items():
            view.narrow(n, mine)
        return view

    def widen(self) -> None:
        """All parameters of every group are asked for again."""
        for n, group in enumerate(self.reduced.groups):
            self.groups[n] = group
        self._forget()

    def _forget(self):
        self._models.clear()
        self._sums.clear()
        self._gains.clear()

    def let_go(self) -> None:
        """Forget systems and models, which are made anew where they are asked for."""
        self._systems.clear()
        self._chains.clear()
        self._models.clear()

    def let_go_of_images(self) -> None:
        """Keep of the equations what images share; answers that were given stay."""
        self.let_go()
        self.reduced = replace(self.reduced, beside=None, elimination=None)

    def spans(self, chosen: Iterable[int]) -> dict[int, slice]:
        """Where the parameters of each of several groups lie when they are taken together."""
        out, end = {}, 0
        for n in chosen:
            out[n] = slice(end, end + len(self.groups[n]))
            end = out[n].stop
        return out

    def freed(self, chosen: Mapping[int, Size], size: float | None = None) -> dict[int, Size]:
        """Groups n -> kappa, those of few parameters as free as `size`, or as what can happen."""
        out = {}
        for n, kappa in chosen.items():
            group = self.groups[n]
            held = group.known or group.own is not None or len(group) > SETTINGS.most_free
            out[n] = kappa if held else group.free if size is None else size
        return out

    def block(self, group: Group) -> tuple[np.ndarray, np.ndarray]:
        """M (p, p) and g (p,) of a group of the core alone."""
        r = self.reduced
        return r.M[np.ix_(group.columns, group.columns)], r.g[group.columns]

    def beyond_chance(self, n: int, gain: Gain) -> float:
        """What a group fits but for noise, of which every parameter follows half a unit."""
        group = self.groups[n]
        if group.own is not None:
            return gain.fit
        value = Spectrum.of(self.block(group)[0]).value
        grown = max(gain.kappa, SETTINGS.least_fit_size) ** 2 * value
        return gain.fit - 0.5 * float(np.sum(grown / (1.0 + grown)))

    def across(self, a: Group, b: Group) -> np.ndarray:
        """M between two groups of the core (p, q)."""
        return self.reduced.M[np.ix_(a.columns, b.columns)]

    def of_images(self, chosen: Mapping[int, Size]) -> dict[int, Size]:
        """Of groups n -> kappa those with values for each image."""
        return {n: kappa for n, kappa in chosen.items() if self.groups[n].own is not None}

    def of_core(self, chosen: Mapping[int, Size]) -> dict[int, Size]:
        """Of groups n -> kappa those that images share."""
        return {n: kappa for n, kappa in chosen.items() if self.groups[n].own is None}

    def laid(self, core: Mapping[int, Size]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns (q,) of groups n -> kappa that images share, and sizes and means of these."""
        groups = [self.groups[n] for n in core]
        sizes = [np.broadcast_to(k, len(g)) for g, k in zip(groups, core.values(), strict=True)]
        each = [group.columns for group in groups], sizes, [prior_mean(group) for group in groups]
        return tuple(np.concatenate(one) for one in each)

    def rows(self, chosen: Mapping[int, Size]):
        """Groups n -> kappa as rows of an elimination."""
        return rows_of((self.groups[n], kappa) for n, kappa in chosen.items())

    def _system(self, images: Mapping[int, Size]) -> Reduced:
        """The reduced system beside values for each image."""
        if not images:
            return self.reduced
        key = _key(images)
        found = self._systems.get(key)
        if found is None:
            made = self._chain(key, images).reduced()
            found = replace(made, beside=None, elimination=None)
            _keep(self._systems, key, found, _SYSTEMS)
        return found

    def _chain(self, key: tuple, images: Mapping[int, Size]) -> Elimination:
        """The elimination with values for each image among its rows."""
        found = self._chains.get(key)
        if found is None:
            found = self.elimination(images)
            weight = 8 * found.chain.layout.length + found.cross.nbytes
            most = max(1, int(_CHAIN_BYTES / weight))
            _keep(self._chains, key, found, min(most, _SYSTEMS))
        return found

    def beside(self, chosen: Mapping[int, Size]) -> Beside:
        """What groups n -> kappa leave of the core, and what they explain."""
        key = _key(chosen)
        found = self._models.get(key)
        if found is None:
            found = self._beside(chosen)
            _keep(self._models, key, found, _MODELS)
            self._sums[key] = found.fit, found.cost
        return found

    def explained(self, chosen: Mapping[int, Size]) -> tuple[float, float]:
        """What groups n -> kappa explain, and what they cost: their log evidence is the difference.

        Both in natural logarithms.
        """
        key = _key(chosen)
        if key not in self._sums:
            images = self.of_images(chosen)
            if images and _key(images) not in self._systems:
                # One of many sizes: no more of the core is asked than what the model has of it.
                made, core = self._chain(_key(images), images), self.of_core(chosen)
                fit, cost = made.fit - self.reduced.fit, made.cost - self.reduced.cost
                if core:
                    at, *prior = self.laid(core)
                    mine = _Explained.of(*made.core_of(at), *prior)
                    fit, cost = fit + mine.fit, cost + mine.cost
                self._sums[key] = fit, cost
            else:
                self.beside(chosen)
        return self._sums[key]

    def _beside(self, chosen: Mapping[int, Size]) -> Beside:
        r, core = self._system(self.of_images(chosen)), self.of_core(chosen)
        fit, cost = r.fit - self.reduced.fit, r.cost - self.reduced.cost
        if not core:
            return Beside(r.M, r.g, fit, cost)
        at, *prior = self.laid(core)
        to_core = r.M[at]
        mine = _Explained.of(to_core[:, at], r.g[at], *prior)
        M = r.M - to_core.T @ mine.inverse @ to_core
        return Beside(M, r.g - to_core.T @ mine.theta, fit + mine.fit, cost + mine.cost)

    def total(self, chosen: Mapping[int, Size]) -> float:
        """Log evidence of groups n -> kappa together."""
        fit, cost = self.explained(chosen)
        return fit - cost + self.prior(chosen)

    def prior(self, chosen: Mapping[int, Size]) -> float:
        """How likely groups n -> kappa are beforehand, as logarithm."""
        sizes, log_weight = effect_sizes()
        total = 0.0
        for n, k in chosen.items():
            total += self.groups[n].log_prior
            if not self.groups[n].known:
                total += log_weight[np.argmin(np.abs(sizes - np.max(k)))]
        return float(total)

    def solution(self, chosen: Mapping[int, Size], each_image: bool = True) -> tuple[dict, dict]:
        """Of groups n -> kappa together the parameters (p,) of each, and their covariance (p, p).

        each_image: those with values for each image, too.
        The covariance is that of independent residuals: see `honest`; of values for each image it
        has the diagonal alone. What the data say nothing about (a focal length common to all
        flights, where the camera is free) is zero.
        """
        core, images = self.of_core(chosen), self.of_images(chosen)
        asked = chosen if each_image else core
        theta, covariance = self._of_core(chosen) if core else (np.zeros(0), np.zeros((0, 0)))
        spans = self.spans(core)
        values = {n: theta[at] for n, at in spans.items()}
        spreads = {n: covariance[at, at] for n, at in spans.items()}
        if images and each_image:
            whole = self.elimination(chosen)
            number = len(whole.rows) - len(chosen)
            for k, n in enumerate(chosen):
                if n in images:
                    values[n] = whole.values(number + k)
                    spreads[n] = np.diag(whole.variances(number + k))
        return {n: values[n] for n in asked}, {n: spreads[n] for n in asked}

    def of_each_image(self, chosen: Mapping[int, Size], n: int) -> np.ndarray:
        """Values (p,) for each image of the n-th group of a model n -> kappa."""
        whole = self.elimination(chosen)
        return whole.values(len(whole.rows) - len(chosen) + list(chosen).index(n))

    def elimination(self, chosen: Mapping[int, Size]) -> Elimination:
        """The equations with groups n -> kappa, too, as rows."""
        made = self.reduced.elimination
        return Elimination(made.equations, made.noise, (*made.rows, *self.rows(chosen)))

    def _of_core(self, chosen: Mapping[int, Size]) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (q,) and covariance (q, q) of a model's groups in the core together."""
        core = self.of_core(chosen)
        r, (at, kappa, mean) = self._system(self.of_images(chosen)), self.laid(core)
        M = r.M[np.ix_(at, at)]
        # Zero in what is not determined.
        M_held = M + np.diag(kappa**-2.0)
        covariance = pinvh(M_held, atol=SETTINGS.blind_information, rtol=0.0)
        return mean + covariance @ (r.g[at] - M @ mean), covariance

    def honest(self, n: int, covariance: np.ndarray) -> np.ndarray:
        """A covariance (p, p) of the n-th group as the spread of its scores has it."""
        return self.inflation[n] * covariance

    def given(
        self, chosen: Mapping[int, Size], spread: bool = False, only: int | None = None
    ) -> list[Gain]:
        """What every group would add to a model of groups n -> kappa; nothing of those not asked.

        only: the one that is asked; default: all. spread: count its scores by what they vary.
        Between groups that compete only one factor for all would be fair, and that is as good as
        none.
        """
        key = _key(chosen), frozenset(self.barred)
        if not spread and key in self._gains:
            return self._gains[key]
        asked = [n for n in (range(len(self.groups)) if only is None else [only])]
        asked = [n for n in asked if n not in chosen and self.groups[n].key not in self.barred]
        base = self.beside(chosen)
        out = [Gain(-np.inf, 1.0, 0.0)] * len(self.groups)
        factor = self.inflation if spread else np.ones(len(self.groups))
        own = [n for n in asked if self.groups[n].own is not None and self.reduced.beside]
        works = (partial(self._gain_of_images, chosen, n, factor[n]) for n in own)
        for n, gain in zip(own, side_by_side(self._threads, *works), strict=True):
            out[n] = gain
        for n in asked:
            group, phi = self.groups[n], factor[n]
            if group.own is not None:
                continue
            inside = base.M[np.ix_(group.columns, group.columns)] / phi
            mine = base.g[group.columns] / phi
            gain = gain_of(group, inside, mine)
            out[n] = gain if group.single is None else _of_a_point(group, inside, mine, gain)
        if not spread and only is None:
            self._gains[key] = out
        return out

    @property
    def _threads(self) -> int:
        """Of small blocks threads wait for each other longer than they work."""
        made = self.reduced.elimination
        large = made and len(made.equations.system.columns.images) > SETTINGS.large_block
        return made.equations.system.threads if large else 1

    def _gain_of_images(self, chosen: Mapping[int, Size], n: int, phi: float) -> Gain:
        """What values for each image add to a model.

        Sizes are asked upwards, from none, as long as they do not fall far behind the best. Beside
        other values for each image, which compete with them for the same residuals, they are asked
        only where they add something without those.
        """
        shared = self.of_core(chosen)
        if len(shared) < len(chosen) and self._gain_of_images(shared, n, phi).evidence <= 0.0:
            return Gain(-np.inf, 1.0, 0.0)
        group, (fit_without, cost_without) = self.groups[n], self.explained(chosen)

        def gain(size: float) -> tuple[float, float]:
            """Log Bayes factor of a size, and what it fits: see `inflation`."""
            fit, cost = self.explained({**chosen, n: size / np.sqrt(phi)})
            fit = (fit - fit_without) / phi
            return fit - (cost - cost_without), fit

        if group.known:
            value, _ = gain(1.0)
            return Gain(value + group.log_prior, 1.0, value)
        sizes, log_weight = effect_sizes()
        found = near_the_best(lambda size: gain(size)[0], 0.0)
        each = np.array([found.get(size, -np.inf) for size in sizes.tolist()])
        best = int(np.argmax(each + log_weight))
        size = float(sizes[best])
        _, fit = gain(max(size, SETTINGS.least_fit_size) if each[best] > 0.0 else size)
        return Gain(float(averaged(each) + group.log_prior), size, float(fit))

    def likeliest(self, chosen: Mapping[int, Size], n: int) -> float:
        """The size of the n-th group of a model that makes it most likely."""
        each = near_the_best(lambda size: self.total({**chosen, n: size}), np.max(chosen[n]))
        return max(each, key=each.get)

    def of_scores(self, core: np.ndarray) -> Iterator[np.ndarray]:
        """Log evidence (k,) of each group that images share alone, of scores (c, k) of the core."""
        for group in self.groups:
            if group.known or group.own is not None or not len(group) or group.key in self.barred:
                continue
            spectrum = Spectrum.of(self.block(group)[0])
            each = spectrum.log_bayes(spectrum.vector.T @ core[group.columns])
            yield averaged(each) + group.log_prior


def _keep(kept: dict, key: tuple, value, most: int) -> None:
    """Keep a value, and of those before it the last ones: each weighs a megabyte."""
    with _ONE:
        while len(kept) >= most:
            del kept[next(iter(kept))]
        kept[key] = value


def _key(chosen: Mapping[int, Size]) -> tuple:
    """A model of groups n -> kappa, whatever its order."""
    return tuple((n, np.asarray(chosen[n], dtype=float).tobytes()) for n in sorted(chosen))


def inverted(M: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse (p, p) of a symmetric matrix without negative directions, and log |M|.

    Scaled to a unit diagonal first; what rounding has left of a direction is not below it.
    """
    scale = 1.0 / np.sqrt(np.maximum(M.diagonal(), 1e-300))
    value, vector = eigh(scale[:, None] * M * scale, check_finite=False)
    value = np.maximum(value, 1e-13 * max(value[-1], 1.0))
    turned = scale[:, None] * vector
    logdet = float(np.log(value).sum()) - 2.0 * float(np.log(scale).sum())
    return (turned / value) @ turned.T, logdet


def _of_a_point(group: Group, M, g, whole: Gain) -> Gain:
    """What an error of a ground point adds, where it may be in its height or in its plan alone.

    A mark is mostly wrong in one of them: a pole of the wrong length, a name mixed up. Three
    coordinates at a time cost more than one, and hide an error of five sigmas in the height.
    Source: Baarda 1968 (one error at a time).
    """
    names = [name for _, name, _ in group.labels]
    if sorted(names) != ["x", "y", "z"] or group.known:
        return whole
    each = [whole]
    for part in (["z"], ["x", "y"]):
        at = [names.index(name) for name in part]
        each.append(gain_of(group.part(at), M[np.ix_(at, at)], g[at]))
    best = max(each, key=lambda gain: gain.evidence)
    together = np.logaddexp.reduce([gain.evidence for gain in each]) - np.log(len(each))
    return Gain(float(together), best.kappa, whole.fit)


def gain_of(group: Group, M, g, spectrum: Spectrum | None = None) -> Gain:
    """What a group with M and g adds."""
    spectrum = spectrum or Spectrum.of(M)
    mean = prior_mean(group)
    if group.known:
        away = g - M @ mean
        h = spectrum.vector.T @ away
        one = 0.5 * np.sum(h**2 / (1.0 + spectrum.value)) - 0.5 * np.log1p(spectrum.value).sum()
        total = mean @ g - 0.5 * mean @ (M @ mean) + one
        return Gain(float(total + group.log_prior), 1.0, float(total))
    h = spectrum.vector.T @ g
    each = spectrum.log_bayes(h)
    sizes, log_weight = effect_sizes()
    size = float(sizes[np.argmax(each + log_weight)])
    fit = 0.5 * np.sum(h**2 / (spectrum.value + max(size, SETTINGS.least_fit_size) ** -2.0))
    return Gain(float(averaged(each) + group.log_prior), size, float(fit))


def prior_mean(group: Group) -> np.ndarray:
    """Prior mean (p,) of a group, in prior standard deviations."""
    return np.zeros(len(group)) if group.mean is None else group.mean
