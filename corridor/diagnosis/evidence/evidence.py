"""How much more likely the data are with a group of columns than without it.

Parameters theta ~ N(0, kappa^2) in prior standard deviations, averaged over several kappa:

    log B(kappa) = 1/2 g' (M + I / kappa^2)^-1 g - 1/2 log |I + kappa^2 M|

Given other groups S in the model, M and g are what S leaves of them. Where the scores of a group
vary by a factor phi more than independent residuals would let them, M and g count by 1 / phi.
Source: Kass and Raftery 1995, "Bayes factors"; Chandler and Bate 2007 (phi: see `clusters`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array, diags_array

from corridor.diagnosis.evidence.joint import BesideImages, OfImages, Together
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.elimination import Pieces, Reduced
from corridor.diagnosis.system.groups import Group


def effect_sizes() -> tuple[np.ndarray, np.ndarray]:
    """Sizes of an effect in prior standard deviations, and the logarithm of how likely each is."""
    return np.array(SETTINGS.effect_sizes), np.log(SETTINGS.effect_size_weights)


@dataclass
class Spectrum:
    """Eigenvalues (p,) and vectors (p, p), in columns, of a group's M."""

    value: np.ndarray
    vector: np.ndarray | Pieces

    @classmethod
    def of(cls, M: np.ndarray | Pieces) -> Spectrum:
        """Spectrum of M (p, p), symmetric."""
        if isinstance(M, Pieces):
            each = [cls.of(piece) for piece in M.blocks]
            vectors = Pieces([one.vector for one in each])
            return cls(np.concatenate([one.value for one in each]), vectors)
        value, vector = eigh(0.5 * (M + M.T), check_finite=False)
        return cls(np.maximum(value, 0.0), vector)

    def log_bayes(self, h: np.ndarray) -> np.ndarray:
        """Log Bayes factors (kappas, ...) of h = V'g (p, ...)."""
        k2 = (effect_sizes()[0] ** 2)[:, None]
        grown = k2 * self.value
        gain = np.tensordot(0.5 * k2 / (1.0 + grown), h**2, axes=(1, 0))
        cost = 0.5 * np.log1p(grown).sum(axis=1)
        return gain - cost.reshape((-1,) + (1,) * (h.ndim - 1))


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
        self._alone: dict[int, Spectrum] = {}
        self._of_images: dict[tuple[int, float], OfImages] = {}
        # A search asks for the same models again and again.
        self._totals: dict[frozenset, float] = {}
        self._gains: dict[tuple[frozenset, frozenset], list[Gain]] = {}

    def narrow(self, n: int, names: Iterable[str]) -> None:
        """Only these parameters of the n-th group are asked for from now on."""
        group, names = self.groups[n], set(names)
        self.groups[n] = group.part(
            [k for k, (_, name, _) in enumerate(group.labels) if name in names]
        )
        self._alone.pop(n, None)
        self._forget_answers()

    def narrowed(self, names: Mapping[int, Iterable[str]]) -> Evidence:
        """Another view of the same, that asks some groups n for these parameters only."""
        view = Evidence(self.reduced, self.barred, self.inflation)
        for n, mine in names.items():
            view.narrow(n, mine)
        return view

    def widen(self) -> None:
        """All parameters of every group are asked for again."""
        for n, group in enumerate(self.reduced.groups):
            if self.groups[n] is not group:
                self.groups[n] = group
                self._alone.pop(n, None)
        self._forget_answers()

    def let_go(self) -> None:
        """Forget spectra and factors, which are made anew where they are asked for."""
        self._alone.clear()
        self._of_images.clear()

    def let_go_of_images(self) -> None:
        """Keep of the equations what images share; answers that were given stay."""
        self.let_go()
        nothing = [None] * len(self.reduced.own_matrix)
        self.reduced = replace(
            self.reduced, own_matrix=nothing, own_g=nothing, between=nothing, mutual={}
        )

    def _forget_answers(self):
        self._totals.clear()
        self._gains.clear()

    def spans(self, chosen: Iterable[int]) -> dict[int, slice]:
        """Where the parameters of each of several groups lie when they are taken together."""
        out, end = {}, 0
        for n in chosen:
            out[n] = slice(end, end + len(self.groups[n]))
            end = out[n].stop
        return out

    def freed(self, chosen: Mapping[int, float], size: float | None = None) -> dict:
        """Groups n -> kappa, those of few parameters as free as `size`, or as what can happen."""
        out = {}
        for n, kappa in chosen.items():
            group = self.groups[n]
            held = group.known or len(group) > SETTINGS.most_free
            out[n] = kappa if held else group.free if size is None else size
        return out

    def block(self, group: Group) -> tuple[np.ndarray | Pieces, np.ndarray]:
        """M (p, p), of values for each image its pieces, and g (p,) of a group alone."""
        r = self.reduced
        if group.own is None:
            return r.M[np.ix_(group.columns, group.columns)], r.g[group.columns]
        return r.own_matrix[group.own], r.own_g[group.own]

    def alone(self, n: int) -> Spectrum:
        """Spectrum of the n-th group."""
        if n not in self._alone:
            self._alone[n] = Spectrum.of(self.block(self.groups[n])[0])
        return self._alone[n]

    def across(self, a: Group, b: Group) -> np.ndarray:
        """M between two groups (p, q)."""
        both = self.reduced.between_blocks(a.own, b.own)
        both = both if a.own is not None else both[a.columns]
        return both if b.own is not None else both[:, b.columns]

    def to_core(self, chosen: Iterable[int]) -> np.ndarray:
        """M between several groups together and the core (p, c)."""
        r, groups = self.reduced, [self.groups[n] for n in chosen]
        return np.concatenate(
            [r.M[a.columns] if a.own is None else r.between[a.own] for a in groups]
        )

    def joint(self, chosen: Iterable[int]) -> tuple[np.ndarray, np.ndarray]:
        """M and g of several groups together."""
        groups = [self.groups[n] for n in chosen]
        if not groups:
            return np.zeros((0, 0)), np.zeros(0)
        M = np.block([[self.across(a, b) for b in groups] for a in groups])
        return M, np.concatenate([self.block(group)[1] for group in groups])

    def _vectors(self, chosen: dict[int, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """g, prior means and kappas (p,) of groups n -> kappa together."""
        groups = [self.groups[n] for n in chosen]
        g = np.concatenate([self.block(group)[1] for group in groups])
        mean = np.concatenate([prior_mean(group) for group in groups])
        return g, mean, self._sizes(chosen)

    def _sizes(self, chosen: dict[int, float]) -> np.ndarray:
        """kappa (p,) of each parameter of groups n -> kappa."""
        each = [np.full(len(self.groups[n]), kappa) for n, kappa in chosen.items()]
        return np.concatenate([np.zeros(0), *each])

    def _many(self, chosen: Iterable[int]) -> int | None:
        """The one group of many values for each image among those of a model."""
        own = [n for n in chosen if self.groups[n].own is not None]
        if len(own) != 1 or self.groups[own[0]].known:
            return None
        return own[0] if len(self.groups[own[0]]) > SETTINGS.large_group else None

    def _beside(self, chosen: dict[int, float], many: int) -> BesideImages:
        """The equations of groups n -> kappa of which one has many values for each image."""
        r, kept = self.reduced, self._of_images
        key = many, chosen[many]
        if key not in kept:
            # Of thousands of images one of them weighs some hundred megabytes.
            while len(kept) > 1:
                del kept[next(iter(kept))]
            own = self.groups[many].own
            kept[key] = OfImages(r.own_matrix[own], r.between[own], chosen[many])
        sizes, every = self.spans(chosen), np.arange(sum(len(self.groups[n]) for n in chosen))
        others = [n for n in chosen if n != many]
        empty = [np.zeros(0, dtype=np.int64)]
        rest = np.concatenate(empty + [every[sizes[n]] for n in others])
        core = np.concatenate(empty + [self.groups[n].columns for n in others])
        kappa = self._sizes({n: chosen[n] for n in others})
        return BesideImages(kept[key], many, every[sizes[many]], rest, core, r.M, kappa)

    def model(
        self, chosen: dict[int, float]
    ) -> tuple[float, np.ndarray, Together | BesideImages | None]:
        """Log evidence of groups n -> kappa together, their parameters, and the factor."""
        if not chosen:
            return 0.0, np.zeros(0), None
        g, mean, kappa = self._vectors(chosen)
        many = self._many(chosen)
        if many is None:
            M, _ = self.joint(chosen)
            factor = Together(M, kappa)
            expected = M @ mean
        else:
            factor = self._beside(chosen, many)
            expected = factor.times(mean) if mean.any() else np.zeros_like(g)
        away = g - expected
        step = factor.solve(away)
        logdet = factor.logdet + 2.0 * np.log(kappa).sum()
        total = mean @ g - 0.5 * mean @ expected + 0.5 * away @ step - 0.5 * logdet
        sizes, log_weight = effect_sizes()
        for n, k in chosen.items():
            total += self.groups[n].log_prior
            if not self.groups[n].known:
                total += log_weight[np.argmin(np.abs(sizes - k))]
        return float(total), mean + step, factor

    def total(self, chosen: dict[int, float]) -> float:
        """Log evidence of groups n -> kappa together."""
        key = frozenset(chosen.items())
        if key not in self._totals:
            self._totals[key] = self.model(chosen)[0]
        return self._totals[key]

    def in_pieces(self, chosen: Iterable[int]) -> bool:
        """Whether a model has so many values for each image that they are taken piece by piece."""
        own = [self.groups[n].own for n in chosen]
        return any(n is not None and self.reduced.own_matrix[n].several for n in own)

    def solution(self, chosen: dict[int, float]) -> tuple[np.ndarray, np.ndarray | csr_array]:
        """Parameters (p,) of groups n -> kappa together, and their covariance (p, p).

        The covariance is that of independent residuals: see `honest`. What the data say nothing
        about (a focal length common to all flights, where the camera is free) is zero. Of values
        for each image that are taken piece by piece it has the diagonal alone.
        """
        if not chosen:
            return np.zeros(0), np.zeros((0, 0))
        g, mean, kappa = self._vectors(chosen)
        many = self._many(chosen)
        if many is not None and self.in_pieces(chosen):
            factor = self._beside(chosen, many)
            away = g - (factor.times(mean) if mean.any() else 0.0)
            step, covariance = factor.determined(away, _determined)
            return mean + step, covariance
        M, _ = self.joint(chosen)
        covariance = _determined(M + np.diag(kappa**-2.0))
        return mean + covariance @ (g - M @ mean), covariance

    def honest(self, chosen: Iterable[int], covariance):
        """A covariance (p, p) of groups as the spread of their scores has it."""
        each = [np.full(len(self.groups[n]), self.inflation[n]) for n in chosen]
        if not each:
            return covariance
        root = diags_array(np.sqrt(np.concatenate(each)))
        return root @ covariance @ root

    def _own_given(self, chosen: Collection[int], theta, factor, k: int) -> tuple:
        """M and g of a block of per-image columns beside groups with parameters theta.

        None where the block is asked no more; M alone where it keeps the spectrum it has alone.
        """
        r, members = self.reduced, [self.groups[n] for n in chosen]
        inside = [a.own for a in members if a.own is not None]
        # Of thousands of images one kind of values for each is as much as can be told apart.
        crowded = any(r.own_matrix[i].several for i in inside)
        if r.own_g[k] is None or k in inside or (crowded and r.own_matrix[k].several):
            return None, None
        g = r.own_g[k].copy()
        for a, at in zip(members, self.spans(chosen).values(), strict=True):
            if a.own is None:
                g -= r.between[k][:, a.columns] @ theta[at]
            else:
                g -= r.across(k, a.own, theta[at])
        if len(g) > SETTINGS.large_group:
            return None, g
        group = next(group for group in self.groups if group.own == k)
        to_own = np.concatenate([self.across(a, group) for a in members])
        return r.own_matrix[k].less(to_own.T, factor.solve(to_own)), g

    def given(
        self, chosen: dict[int, float], spread: bool = False, only: int | None = None
    ) -> list[Gain]:
        """What every group would add to a model of groups n -> kappa; nothing of those not asked.

        only: the one that is asked; default: all. spread: count its scores by what they vary.
        Between groups that compete only one factor for all would be fair, and that is as good as
        none.
        """
        key = frozenset(chosen.items()), frozenset(self.barred)
        if not spread and key in self._gains:
            return self._gains[key]
        asked = [n for n in (range(len(self.groups)) if only is None else [only])]
        asked = [n for n in asked if n not in chosen and self.groups[n].key not in self.barred]
        r = self.reduced
        M, g, own = r.M, r.g, dict(enumerate(zip(r.own_matrix, r.own_g, strict=True)))
        if chosen:
            _, theta, factor = self.model(chosen)
            to_core = self.to_core(chosen)
            g = r.g - to_core.T @ theta
            blocks = {self.groups[n].own for n in asked}
            M = r.M - factor.taken(to_core) if None in blocks else r.M
            own = {k: self._own_given(chosen, theta, factor, k) for k in blocks - {None}}
        out = [Gain(-np.inf, 1.0, 0.0)] * len(self.groups)
        for n in asked:
            group = self.groups[n]
            if group.own is None:
                inside, mine = M[np.ix_(group.columns, group.columns)], g[group.columns]
            else:
                inside, mine = own[group.own]
            if mine is None:
                continue
            spectrum = self.alone(n) if not chosen or inside is None else Spectrum.of(inside)
            phi = self.inflation[n] if spread else 1.0
            if phi > 1.0:
                spectrum, mine = Spectrum(spectrum.value / phi, spectrum.vector), mine / phi
                inside = None if inside is None else inside / phi
            gain = gain_of(group, inside, mine, spectrum)
            out[n] = gain if group.point is None else _of_a_point(group, inside, mine, gain)
        if not spread and only is None:
            self._gains[key] = out
        return out


def _determined(M: np.ndarray) -> np.ndarray:
    """Inverse (p, p) of M, zero in what it does not determine."""
    value, vector = eigh(M, check_finite=False)
    known = value > SETTINGS.blind_information
    inverse = np.where(known, 1.0 / np.maximum(value, SETTINGS.blind_information), 0.0)
    return (vector * inverse) @ vector.T


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
