"""Pictures whose temperature is not theirs: a slip of the table, or two that were exchanged.

A wrong temperature bends the whole model. Each picture in turn is left out, and each two exchange
their temperatures; where the maps then fit as one picture alone can not make them, its temperature
is wrong. Errors of a picture's nodes are alike: pictures count, not nodes; and of what is left,
what no smooth shape takes is noise of the nodes, which says nothing of temperatures.

Source: Cook and Weisberg 1982, section 2.2 (the F test of one observation's shift).
"""

from dataclasses import replace
from itertools import combinations

import numpy as np

from corridor.tools.thermal.maps import Maps
from corridor.tools.thermal.sums import Sums

# F with one degree of freedom: six sigmas.
_F = 36.0
# Numbers that a rough model takes of the temperatures: two powers and a lag.
_TAKEN = 3
_FEWEST, _MOST_SHARE = 6, 0.25
# Pictures that are looked at two by two: those that fit worst.
_PAIRED = 24


def without_wrong_stamps(maps: Maps, kind: str) -> tuple[Maps, list[str]]:
    """The maps without temperatures that are not those of their pictures, and sentences on them."""
    notes: list[str] = []
    gone = 0
    while True:
        sums = Sums(maps, kind)
        count = len(sums.rows)
        if count < _FEWEST or gone >= _MOST_SHARE * (count + gone):
            return maps, notes
        found = _worst(sums, kind)
        if found is None:
            return maps, notes
        rows, text = found
        notes.append(text)
        gone += len(rows)
        warm = np.array(maps.temperature_c, dtype=float)
        warm[rows] = np.nan
        maps = replace(maps, temperature_c=warm)


def _worst(sums: Sums, kind: str) -> tuple[list[int], str] | None:
    """Rows of the maps whose temperatures are to be left out, and why; None: none."""
    warm, count = sums.warm, len(sums.rows)
    names, noise = sums.maps.picture, _noise(sums)
    powers = sums.most_powers(2)
    lags = np.concatenate([[0.0], np.geomspace(1.0, max(sums.longest_lag, 2.0), 12)])
    if not sums.shows_lag and len(sums.rows) < _FEWEST + 2:
        lags = lags[:1]

    def cost(course: np.ndarray, tried, use=None) -> tuple[float, float]:
        sums.warm = course
        left = np.maximum(sums.left_of_pictures(kind, powers, tried, use) - noise, 0.0)
        return min(zip(left.sum(axis=1, where=True if use is None else use), tried, strict=True))

    base, lag = cost(warm, lags)
    # Wrong temperatures move the lag as well.
    near = np.unique([0.0, lag / 2, lag, 2 * lag, *lags[3::4]])
    free = max(count - 1 - _TAKEN, 1)
    alone = np.full(count, np.inf)
    for n, row in enumerate(sums.rows):
        alone[n] = cost(_without(sums, warm, row), near, np.arange(count) != n)[0]
    best = int(np.argmin(alone))
    order = np.argsort(alone)[:_PAIRED]
    pairs = {}
    for one, other in combinations(sorted(order.tolist()), 2):
        a, b = sums.rows[[one, other]]
        if abs(warm[a] - warm[b]) > 0:
            course = warm.copy()
            course[[a, b]] = warm[[b, a]]
            pairs[one, other] = cost(course, near)[0]
    # Those that decide, by lags a tenth apart: a lag between two of the few would tell for itself.
    fine = np.unique([0.0, *np.geomspace(max(lags[-1], 2.0) / 100, max(lags[-1], 2.0), 48)])
    fine = fine if len(lags) > 1 else lags
    base = cost(warm, fine)[0]
    rest = np.arange(count) != best
    alone[best] = cost(_without(sums, warm, sums.rows[best]), fine, rest)[0]
    if pairs:
        both = min(pairs, key=lambda pair: pairs[pair])
        course, (a, b) = warm.copy(), sums.rows[list(both)]
        course[[a, b]] = warm[[b, a]]
        pairs[both] = cost(course, fine)[0]
    sums.warm = warm
    if pairs:
        swapped = pairs[both]
        if (base - swapped) * free > _F * swapped and swapped < alone[best] / 2:
            return [int(a), int(b)], (
                f"the temperatures of {names[a]} ({warm[a]:.1f} C) and {names[b]} ({warm[b]:.1f} "
                "C) seem to be exchanged: both pictures are left out; correct temperature_c in "
                "series.csv"
            )
    if (base - alone[best]) * free > _F * alone[best]:
        row = int(sums.rows[best])
        return [row], (
            f"the temperature of {names[row]} ({warm[row]:.1f} C) does not go with its picture as "
            "those of all others do: the picture is left out; correct temperature_c in series.csv"
        )
    return None


def _noise(sums: Sums) -> np.ndarray:
    """Weighted squares of each picture (used,) that its own fullest polynomial leaves."""
    taken = np.einsum("nax,nab,nbx->n", sums.b, np.linalg.pinv(sums.A, hermitian=True), sums.b)
    return np.maximum(sums.squares - taken, 0.0)


def _without(sums: Sums, warm: np.ndarray, row: int) -> np.ndarray:
    """The course with one temperature from those before and after it."""
    time = sums.maps.time_s
    known = np.isfinite(warm) & (np.arange(len(warm)) != row)
    order = np.argsort(time[known], kind="stable")
    out = warm.copy()
    out[row] = np.interp(time[row], time[known][order], warm[known][order])
    return out
