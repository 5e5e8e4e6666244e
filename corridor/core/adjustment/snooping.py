"""Which measurements are wrong: data snooping of several, with the whole search in its level.

With v the residuals and R their cofactors in units of the stated standard deviations, errors of
the measurements E explain

    T = v_E' R_EE^-1 v_E        of the sum of squares, chi-square with as many degrees of freedom

Two errors can hide each other: of all pairs the best is looked at beside the best single one. The
level is shared out among all that are tried (Bonferroni), so that it is that of the whole search.
Source: Baarda 1968; Kok 1984 (iterated data snooping); Knight, Wang and Rizos 2010, "Generalised
measures of reliability for multiple outliers", for several at once.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

# Probability that a set in which nothing is wrong gets a name.
LEVEL = 0.01
# Another measurement explains as much where the likelihoods are within this ratio: then neither
# is named alone. Jeffreys 1961 calls a hundred decisive.
DECISIVE = 100.0
# An error that is shown to less than this share of its size is shown by nothing.
LEAST_SHOWN_SHARE = 1e-6


@dataclass(frozen=True)
class Blunder:
    """A measurement that is wrong.

    number: among the measurements. error, sigma: in its standard deviations, as all others show
    it. w: error over sigma. rivals: numbers of those that explain the same as well.
    """

    number: int
    error: float
    sigma: float
    w: float
    rivals: tuple[int, ...]


def blunders(
    v: np.ndarray, share: np.ndarray, least: int = 2, most: int | None = None
) -> list[Blunder]:
    """The measurements that are wrong, the most significant first.

    v (n,): residuals, share (n, n): their cofactors, in units of the stated standard deviations.
    most: so many are named at the most, by default a third of the measurements, and always one:
    beyond, nobody knows who is right. least: of fewer none is.
    """
    count = len(v)
    shown = np.diag(share) > LEAST_SHOWN_SHARE if count else np.zeros(0, bool)
    tried = int(shown.sum())
    chosen: list[int] = []
    if tried < least:
        return []
    one = chdtri(1, LEVEL / tried)
    two = chdtri(2, LEVEL / max(tried * (tried - 1) / 2, 1))
    most = max(tried // 3 if most is None else most, 1)
    while len(chosen) < most:
        left, free = _without(v, share, chosen)
        single = _singles(left, free)
        first = int(np.argmax(single))
        if len(chosen) + 2 <= most:
            pair, gain = _best_pair(left, free)
            if gain > two and gain - single[first] > one:
                chosen += pair
                continue
        if single[first] <= one:
            break
        chosen.append(first)
    while chosen:
        # One that was chosen while another hid the true one is of no use beside that.
        alone = [_singles(*_without(v, share, [c for c in chosen if c != k]))[k] for k in chosen]
        weakest = int(np.argmin(alone))
        if alone[weakest] > one:
            break
        chosen.pop(weakest)
    found = [_blunder(v, share, chosen, k) for k in chosen]
    return sorted(found, key=lambda blunder: -abs(blunder.w))


def with_scale(v: np.ndarray, share: np.ndarray, others: float) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and cofactors R for `blunders` where all other measurements scatter `others` times
    as much as is stated: these residuals scatter with R R + others^2 (R - R R), and an error e
    shows in them as R e. Along the axes of R, l its size, both are divided by l + others^2 (1 - l).
    """
    if others == 1.0:
        return v, share
    size, axes = np.linalg.eigh(share)
    size = np.clip(size, 0.0, 1.0)
    scatter = size + others**2 * (1.0 - size)
    return axes @ (axes.T @ v / scatter), (axes * (size / scatter)) @ axes.T


def _without(v: np.ndarray, share: np.ndarray, taken: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and cofactors where the errors of some are estimated."""
    if not taken:
        return v, share
    # Errors that show alike share what they explain.
    part = share[:, taken] @ np.linalg.pinv(share[np.ix_(taken, taken)], hermitian=True)
    return v - part @ v[taken], share - part @ share[taken]


def _singles(v: np.ndarray, share: np.ndarray) -> np.ndarray:
    """What an error of each explains (n,)."""
    size = np.diag(share)
    return np.where(
        size > LEAST_SHOWN_SHARE, v**2 / np.where(size > LEAST_SHOWN_SHARE, size, 1.0), 0.0
    )


def _best_pair(v: np.ndarray, share: np.ndarray) -> tuple[list[int], float]:
    """The two that together explain most, and how much."""
    size = np.where(np.diag(share) > LEAST_SHOWN_SHARE, np.diag(share), np.inf)
    root = np.sqrt(size)
    w = np.where(np.isfinite(root), v / root, 0.0)
    like = share / root[:, None] / root
    # Two that are told apart by less than a tenth of a sigma are one.
    apart = 1.0 - like**2
    gain = (w[:, None] ** 2 - 2.0 * like * w[:, None] * w + w**2) / np.maximum(apart, 1e-9)
    gain[apart < 0.01] = 0.0
    np.fill_diagonal(gain, 0.0)
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    return [int(i), int(j)], float(gain[i, j])


def _blunder(v: np.ndarray, share: np.ndarray, chosen: list[int], k: int) -> Blunder:
    others = [c for c in chosen if c != k]
    left, free = _without(v, share, others)
    explained = _singles(left, free)
    near = explained > explained[k] - 2.0 * np.log(DECISIVE)
    rivals = [int(n) for n in np.flatnonzero(near) if n != k and n not in others]
    rivals.sort(key=lambda n: -explained[n])
    error, sigma = left[k] / free[k, k], free[k, k] ** -0.5
    return Blunder(k, float(error), float(sigma), float(error / sigma), tuple(rivals))
