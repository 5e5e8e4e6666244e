"""One variance factor for each kind of observation, in plan and in height, and for each flight.

One factor for a whole block is made by its thousands of image points: antenna positions that miss
by ten sigmas do not show in it. Each group has its own, v'Pv / r with its own redundancy r, and a
test of it; errors that last from one position to the next are told by the likelihood of residuals.

Source: Förstner 1979 and Koch 1986 (v'Pv / r, iterated); Patterson and Thompson 1971 (likelihood of
residuals) and Bayley and Hammersley 1946, "The effective number of independent observations in an
autocorrelated time series", for errors that last.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import chdtr, chdtrc, chdtri

from corridor.core.adjustment.problem import POSE_KINDS
from corridor.core.adjustment.result import Adjustment
from corridor.core.block import Block, values_of
from corridor.core.geometry import CONTRADICTING_FACTOR
from corridor.core.gnss import SlowNoise

_PLAN, _HEIGHT = slice(0, 2), slice(2, 3)
AXES = {"plan": _PLAN, "height": _HEIGHT}
_TURNS = {"roll and pitch": _PLAN, "yaw": _HEIGHT}
# A group contradicts what is stated where chance does so once in a thousand, and by a factor.
RARE_CHANCE = 1e-3
# Redundancy below which a group says nothing of its own size.
_FEWEST = 6.0
# A redundancy near one makes residuals as large as errors: below this RMS, in sigmas, no group
# with less than six tenths of its redundancy can reach the factor. A quick look saves covariances.
_QUICK = 1.25
# Fewer positions of a flight do not tell how long errors last.
_LASTING = 12
# Correlation of one residual with the next in its standard deviations from which on one looks
# closer; of white noise one block in a thousand has more.
_ALIKE = 3.1
# Positions that are looked at together, and redundancy of what tells something.
_WINDOW, _SEEN = 120, 0.05
# (c / w)^2 and tau, s, that are tried: from a tenth of the white noise to ten times as much, and
# from some exposures to what no flight tells from a constant.
_RATIOS = tuple(np.geomspace(0.01, 100.0, 17).tolist())
_CONSTANTS = (8.0, 15.0, 30.0, 60.0, 120.0, 240.0)
# What one knows of tau beforehand: its middle, s, and the standard deviation of its logarithm, as
# the diagnosis has them of receivers.
_USUAL = (60.0, 0.57)


def components(adjustment: Adjustment) -> pd.DataFrame:
    """A row for each group of observations and what its residuals say of its sigmas.

    Columns: kind (tie, mark, gnss, control, attitude), part (plan, height; of attitudes roll and
    pitch, yaw; empty: all), flight (of gnss and attitude), count of numbers, redundancy, sigma0 =
    sqrt(v'Pv / r), and p, the probability of one so far from 1 on either side where all is as
    stated.

    Redundancies are exact, those of tie points what the others leave (priors among them).
    """
    rows, taken = [], 0.0
    reliability = adjustment.reliability
    for kind in ("gnss", "control", "attitude"):
        square, share = reliability.independent(kind)
        of_flights = kind in POSE_KINDS
        flights = np.full(len(share), "", object)
        flights = flights_of(adjustment, kind) if of_flights else flights
        for flight in dict.fromkeys(flights.tolist()):
            mine = flights == flight
            for part, axes in (_TURNS if kind == "attitude" else AXES).items():
                r, q = share[mine, axes].sum(), square[mine, axes].sum()
                rows.append((kind, part, flight, square[mine, axes].size, r, q))
                taken += r
    p = adjustment.problem
    if len(adjustment.residuals["mark"]):
        of_marks = reliability.marks["redundancy"]
        total = _image_square(adjustment, "mark")
        rows.insert(0, ("mark", "", "", len(of_marks), of_marks.sum(), total))
        taken += of_marks.sum()
    if p.tie_count:
        left = adjustment.redundancy - taken
        rows.insert(0, ("tie", "", "", 2 * p.tie_count, left, _image_square(adjustment, "tie")))
    table = pd.DataFrame(rows, columns=["kind", "part", "flight", "count", "redundancy", "q"])
    r, q = table["redundancy"].clip(lower=1e-9), table.pop("q")
    table["sigma0"] = np.sqrt(q / r).where(r > 0.5)
    table["p"] = np.minimum(2.0 * np.minimum(chdtrc(r, q), chdtr(r, q)), 1.0)
    return table


def _image_square(adjustment: Adjustment, kind: str) -> float:
    """v'Pv of image points, gross ones left out."""
    found = adjustment.statistics[kind]
    return 2 * found["count"] * found["sigma0"] ** 2 if found else 0.0


def flights_of(adjustment: Adjustment, kind: str = "gnss") -> np.ndarray:
    """Name of the flight (k,) of each antenna position, or attitude."""
    p = adjustment.problem
    names = np.array(p.images.flight_names, dtype=object)
    return names[p.images.flight[p.measured(kind)]]


def _suspicious(result: Adjustment) -> bool:
    """Whether any group of antenna positions may contradict, at a glance."""
    table = result.residuals["gnss"]
    if len(table) < 3:
        return False
    scaled = values_of(table, "vx", "vy", "vz") / values_of(table, "sx", "sy", "sz")
    flights = flights_of(result)
    return any(
        np.sqrt(np.mean(scaled[flights == flight, axes] ** 2)) > _QUICK
        for flight in set(flights.tolist())
        for axes in AXES.values()
    )


def general(result: Adjustment) -> float:
    """Sigma naught of the tie points without gross errors, or of all; 1 where it is less."""
    ties = result.statistics["tie"]
    return max(ties["sigma0"] if ties else result.sigma0, 1.0)


def contradicting(result: Adjustment) -> dict[tuple[str, str], float]:
    """Groups (part, flight) of antenna positions whose residuals contradict their standard
    deviations, and their sigma naught over the general one."""
    if not result.converged or not _suspicious(result):
        return {}
    table = components(result)
    # What all observations are too large by is sigma naught's matter.
    usual = general(result)
    wrong = (
        (table["kind"] == "gnss")
        & (table["redundancy"] >= _FEWEST)
        & (table["p"] < RARE_CHANCE)
        & (table["sigma0"] > CONTRADICTING_FACTOR * usual)
    )
    return {
        (row.part, row.flight): row.sigma0 / usual for row in table[wrong].itertuples(index=False)
    }


def restate(start: Block, rows: np.ndarray, axes: slice, factor: float | np.ndarray) -> None:
    """Standard deviations of some antenna positions times a factor, in the block itself."""
    sigma = start.gnss_sigma()
    sigma[rows, axes] *= factor
    start.put("gnss", ("sx", "sy", "sz"), sigma)


# --- errors that last ----------------------------------------------------------------------------


class Slow(NamedTuple):
    """Errors of antenna positions of which a part lasts.

    ratio: (c / w)^2 of the standard deviations of that part and of the rest; constant: after which
    it is another one, s; white: w, in the stated standard deviations. factor: on these, by part
    and flight, so that as many independent positions know as much together.
    """

    ratio: float
    constant: float
    white: float
    factor: dict[tuple[str, str], float]


def slow(result: Adjustment) -> Slow | None:
    """How errors of antenna positions last; None where they are as likely independent.

    White noise w and a slow part c exp(-|t| / tau), of one receiver in all flights and axes, are
    those most likely for the residuals R e, R their cofactors. A sum of n positions has the
    variance w^2 (n + (c / w)^2 sum of all correlations): so many times as much as stated each
    counts. What neighbours share beyond that, their images say better.
    """
    gnss, images = result.system.gnss, result.system.images
    if not result.converged or result.system.held is not None:
        return None
    tracks = {}
    for number, name in enumerate(images.flight_names):
        mine = np.flatnonzero(images.flight[gnss.image] == number)
        time = images.time[gnss.image[mine]]
        if len(mine) >= _LASTING and np.isfinite(time).all():
            order = np.argsort(time, kind="stable")
            tracks[str(name)] = mine[order], time[order]
    if not tracks:
        return None
    scaled = [gnss.residual[rows] / gnss.sigma[rows] for rows, _ in tracks.values()]
    alike = sum(float(np.sum(v[1:] * v[:-1])) for v in scaled)
    count = sum(v.size for v in scaled)
    # Of white noise a normal number: the mean of so many products.
    if alike < _ALIKE * np.sqrt(count) * max(sum(float(np.sum(v * v)) for v in scaled) / count, 1):
        return None
    found = _likeliest([part for track in tracks.values() for part in _contrasts(result, *track)])
    if found is None:
        return None
    ratio, constant, white = found
    factor = {}
    for name, (_, time) in tracks.items():
        together = float(SlowNoise(constant).correlation(time).sum()) / len(time)
        for part in AXES:
            factor[part, name] = white * float(np.sqrt(1.0 + ratio * together))
    if max(factor.values()) < CONTRADICTING_FACTOR:
        return None
    return Slow(ratio, constant, white, factor)


class _Contrasts(NamedTuple):
    """Sums u (m,) of residuals of some positions at times (n,) that are independent, of size 1
    each, where errors are; by (n, m): they are by' e."""

    time: np.ndarray
    by: np.ndarray
    u: np.ndarray


def _contrasts(result: Adjustment, rows: np.ndarray, time: np.ndarray) -> Iterator[_Contrasts]:
    """Of each axis of a flight; of a long one three windows."""
    gnss = result.system.gnss
    for first in np.unique(np.linspace(0, max(len(rows) - _WINDOW, 0), 3).astype(int)):
        at = rows[first : first + _WINDOW]
        for axis in range(3):
            design = gnss.jacobian[3 * at + axis].toarray() / gnss.sigma[at, axis, None]
            share = np.eye(len(at)) - design @ result.covariance.solve(design.T)
            size, vector = np.linalg.eigh(0.5 * (share + share.T))
            kept = size > _SEEN
            root = np.sqrt(size[kept])
            v = gnss.residual[at, axis] / gnss.sigma[at, axis]
            yield _Contrasts(
                time[first : first + _WINDOW], vector[:, kept] * root, vector[:, kept].T @ v / root
            )


def _likeliest(parts: list[_Contrasts]) -> tuple[float, float, float] | None:
    """Ratio, time constant and w of `Slow`; None where white noise alone is as likely."""
    free = sum(len(one.u) for one in parts)
    best, plain = (np.inf, 0.0, 0.0, 1.0), np.inf
    for constant in _CONSTANTS:
        sizes, squares = [], []
        for one in parts:
            alike = one.by.T @ SlowNoise(constant).correlation(one.time) @ one.by
            size, vector = np.linalg.eigh(alike)
            sizes.append(size)
            squares.append((vector.T @ one.u) ** 2)
        size, square = np.concatenate(sizes), np.concatenate(squares)
        known = (np.log(constant / _USUAL[0]) / _USUAL[1]) ** 2
        plain = free * np.log(np.sum(square) / free)
        for ratio in _RATIOS:
            spread = 1.0 + ratio * size
            variance = float(np.sum(square / spread)) / free
            value = free * np.log(variance) + np.sum(np.log(spread)) + known
            best = min(best, (value, ratio, constant, np.sqrt(variance)))
    return best[1:] if plain - best[0] > chdtri(2, RARE_CHANCE) else None
