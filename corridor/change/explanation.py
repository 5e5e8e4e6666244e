"""What of a change the effects of camera and flight explain, and what they cannot.

Each effect of the catalogue has a shape on the ground and an amount that the measurements of its
own epoch say, or leave open. Three vectors of the same change follow: as adjusted; with all
effects estimated with their priors, one and all; with those that the measurements show. What
survives the second moved; what was there, was to be seen, and is gone in the third was the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.brief import brief
from corridor.change.evidence import Evidence, Test
from corridor.change.signature import Signatures

# Log evidence from which on the measurements of an epoch show an effect: one in a hundred blocks
# without any would show one of some twenty candidates.
SHOWN = 7.6
# Lengths (m, as shares of the extent) and heights of the motions that ground may make.
_LENGTHS = (0.1, 0.25)
_EPOCHS = ("before", "after")


@brief
@dataclass(frozen=True)
class Explanation:
    """What effects do to a change.

    as_adjusted, all_modelled, shown_modelled: tests of the change as adjusted, with every effect
    estimated with its prior, and with those that the measurements show. visible: whether the
    change as adjusted would be significant with the covariance of `shown_modelled`. shown: the
    effects that the measurements of each epoch show. table: epoch, effect, what the epoch says of
    it (log_evidence), share of the change that has its shape, share that its value explains,
    probability against ground motion, whether it alone could hide the change. remaining (k,): the
    change with all of `shown` modelled; explained: share of what is beyond noise that is then gone.
    """

    as_adjusted: Test
    all_modelled: Test
    shown_modelled: Test
    visible: bool
    shown: tuple[set[str], ...]
    table: pd.DataFrame
    remaining: np.ndarray
    explained: float = 0.0

    @property
    def verdict(self) -> str:
        """`moved`, `camera`, `undecided`, or `nothing` where no change is significant."""
        if self.all_modelled.significant:
            return "moved"
        if not self.as_adjusted.significant:
            return "nothing"
        told = self.visible or self.explained > 0.5
        if any(self.shown) and told and not self.shown_modelled.significant:
            return "camera"
        return "undecided"


def explain(
    evidence: Evidence, level: float, modelled: tuple[set[str], ...] | None = None
) -> Explanation:
    """What effects do to a change.

    modelled: effects that the adjustments have estimated already; they count as shown.
    """
    modelled = modelled or tuple(set() for _ in evidence.signatures)
    plain = evidence.test(level)
    every = evidence.test(level, evidence.every)
    shown = tuple(shown_in(signatures) for signatures in evidence.signatures)
    value, covariance = evidence.without(shown)
    some = evidence.test(level, shown)
    visible = evidence.tested(evidence.value, covariance, level).significant
    table = _table(evidence, level, plain.significant)
    both = tuple(a | b for a, b in zip(shown, modelled, strict=True))
    gone = _Shares.of(evidence, plain.significant).of_values(value)
    return Explanation(plain, every, some, visible, both, table, value, gone)


def shown_in(signatures: Signatures) -> set[str]:
    """Effects that the measurements of an epoch show, the strongest first, each beside those
    before it."""
    found: list[str] = []
    for _ in range(4):
        gain = {
            slug: log_evidence(signatures, [*found, slug]) - log_evidence(signatures, found)
            for slug in signatures.effects
            if slug not in found
        }
        if not gain:
            break
        best = max(gain, key=gain.get)
        if gain[best] < SHOWN:
            break
        found.append(best)
    return set(found)


def log_evidence(signatures: Signatures, slugs) -> float:
    """Log Bayes factor of effects with their priors, against a model without them."""
    at = signatures.of(slugs)
    if not len(at):
        return 0.0
    matrix = signatures.matrix[np.ix_(at, at)] + np.eye(len(at))
    right = signatures.right[at]
    _, volume = np.linalg.slogdet(matrix)
    return float(0.5 * right @ np.linalg.solve(matrix, right) - 0.5 * volume)


def _table(evidence: Evidence, level: float, significant: bool) -> pd.DataFrame:
    """A row an effect and epoch, the likeliest explanation first."""
    shares = _Shares.of(evidence, significant)
    ground = ground_motion(evidence)
    rows = []
    for n, (signatures, effect) in enumerate(
        zip(evidence.signatures, evidence.effect, strict=True)
    ):
        for slug in signatures.effects:
            some = [set()] * len(evidence.signatures)
            some[n] = {slug}
            value, covariance = evidence.without(tuple(some))
            at = signatures.of([slug])
            shape = effect[:, at]
            fitted = np.linalg.lstsq(shares.root @ shape, shares.root @ evidence.value, 1e-8)[0]
            likely = _log_density(value, covariance) - ground
            estimate = signatures.estimate(at)
            free = signatures.estimate(at, free=True)
            rows.append(
                {
                    "epoch": _EPOCHS[n] if len(evidence.signatures) == 2 else "both",
                    "effect": slug,
                    "place": signatures.effects[slug].place,
                    "log_evidence": log_evidence(signatures, [slug]),
                    "shape_share": shares.of_values(evidence.value - shape @ fitted),
                    "explained": shares.of_values(value),
                    "probability": float(1.0 / (1.0 + np.exp(-np.clip(likely, -700, 700)))),
                    "hides": significant
                    and not evidence.tested(value, covariance, level).significant,
                    "needed": float(np.abs(fitted).max(initial=0.0)),
                    "value": float(estimate.value[0]) * signatures.scale[at[0]],
                    "sigma": float(np.sqrt(max(free.covariance[0, 0], 0.0)))
                    * signatures.scale[at[0]],
                    "parameter": signatures.labels[at[0]].rpartition(".")[2],
                    "unit": signatures.units[at[0]],
                }
            )
    table = pd.DataFrame(rows)
    if not len(table):
        return table
    return table.sort_values(
        ["hides", "probability", "explained"], ascending=False, kind="stable"
    ).reset_index(drop=True)


@dataclass(frozen=True)
class _Shares:
    """Shares of a change: of its weighted square, less what noise alone would have.

    root: of the weights; whole: the weighted square; noise: its expectation. Of a change that is
    not significant there is nothing to share: 0.
    """

    root: np.ndarray
    whole: float
    noise: float

    @classmethod
    def of(cls, evidence: Evidence, significant: bool) -> _Shares:
        weight = np.linalg.pinv(evidence.covariance, rcond=1e-10, hermitian=True)
        value, vector = np.linalg.eigh(weight)
        root = np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T
        whole = float(np.sum((root @ evidence.value) ** 2))
        kept = value > 1e-10 * value[-1] if len(value) else value
        return cls(root, whole, float(np.sum(kept)) if significant else np.inf)

    def of_values(self, left: np.ndarray) -> float:
        """The share that is gone where these changes are left."""
        beyond = max(self.whole - self.noise, 0.05 * self.whole)
        if not np.isfinite(self.noise) or not beyond > 0:
            return 0.0
        return float(min((self.whole - np.sum((self.root @ left) ** 2)) / beyond, 1.0))


def ground_motion(evidence: Evidence) -> float:
    """Log density of the change, were it motion of the ground: patches of a tenth or a quarter of
    the extent, as high as fits best."""
    away = np.linalg.norm(evidence.places[:, None] - evidence.places, axis=2)
    extent = max(float(away.max(initial=0.0)), 1e-9)
    size = max(float(np.sqrt(np.mean(evidence.value**2))), 1e-6)
    best = -np.inf
    for length in _LENGTHS:
        alike = np.exp(-((away / (length * extent)) ** 2))
        for height in size * np.array([0.5, 1.0, 2.0]):
            density = _log_density(evidence.value, evidence.covariance + height**2 * alike)
            best = max(best, density)
    return best


def _log_density(value: np.ndarray, covariance: np.ndarray) -> float:
    """Of a normal vector, up to a constant that the dimension alone decides."""
    lifted = covariance + 1e-10 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    _, volume = np.linalg.slogdet(lifted)
    return -0.5 * float(value @ np.linalg.solve(lifted, value)) - 0.5 * float(volume)
