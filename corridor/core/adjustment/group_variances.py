"""One variance factor for each kind of observation, in plan and in height, and for each flight.

One factor for a whole block is made by its thousands of image points: antenna positions that miss
by ten sigmas do not show in it. Each group has its own, v'Pv / r with its own redundancy r, and a
test of it. Where antenna positions of a group contradict what is stated, their standard deviations
are those that they have; one block of false positions is told from the rest and weighted apart.

Source: Förstner 1979 and Koch 1986 (v'Pv / r, iterated); Rousseeuw and Van Driessen 1999, "A fast
algorithm for the minimum covariance determinant estimator" (concentration: what the best part says
of all decides which part is best), for the block; Patterson and Thompson 1971 (likelihood of
residuals) and Bayley and Hammersley 1946, "The effective number of independent observations in an
autocorrelated time series", for errors that last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import chdtr, chdtrc, chdtri

from corridor.core.adjustment.cofactors import of_antennas
from corridor.core.adjustment.model import Model
from corridor.core.adjustment.problem import POSE_KINDS
from corridor.core.adjustment.result import Adjustment
from corridor.core.block import Block
from corridor.core.errors import AdjustmentFailed, InputError, some
from corridor.core.geometry import OUTLIER
from corridor.core.gnss import SlowNoise
from corridor.core.output import counted

Again = Callable[..., Adjustment]
_PLAN, _HEIGHT = slice(0, 2), slice(2, 3)
AXES = {"plan": _PLAN, "height": _HEIGHT}
_TURNS = {"roll and pitch": _PLAN, "yaw": _HEIGHT}
# A group contradicts what is stated where chance does so once in a thousand, and its factor, which
# small faults of any model raise, is beyond two.
RARE_CHANCE, CONTRADICTING_FACTOR = 1e-3, 2.0
# Redundancy below which a group says nothing of its own size.
_LEAST = 6.0
# A redundancy near one makes residuals as large as errors: below this RMS, in sigmas, no group
# with less than six tenths of its redundancy can reach the factor. A quick look saves covariances.
_QUICK = 1.25
_ROUNDS, _SETTLED = 4, 0.1
# The share of positions that a block of false ones leaves; the first half-sample by concentration.
_BEST, _STEPS = 0.6, 6
# Positions that say nothing: their sigmas times this.
_SILENT = 1e3
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
        flights = _flights(adjustment, kind) if of_flights else flights
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


def _flights(adjustment: Adjustment, kind: str = "gnss") -> np.ndarray:
    """Name of the flight (k,) of each antenna position, or attitude."""
    p = adjustment.problem
    names = np.array(p.images.flight_names, dtype=object)
    return names[p.images.flight[p.measured(kind)]]


# --- antenna positions that contradict what is stated --------------------------------------------


def with_gnss_as_it_is(result: Adjustment, again: Again) -> Adjustment:
    """Adjusted with the standard deviations that antenna positions have, where these contradict
    what is stated, and notes on that; the result itself where they do not.

    A block of false positions of a flight is weighted apart from the rest.
    """
    notes: list[str] = []
    doubtful, found = contradicting(result), result
    if doubtful:
        found = false_apart(result, again, sorted({flight for _, flight in doubtful}), notes)
    for _ in range(_ROUNDS):
        doubtful = contradicting(found)
        if not doubtful:
            break
        found = _scaled(found, doubtful, again)
        if not found.converged:
            return result
        if max(abs(np.log(f)) for f in doubtful.values()) < _SETTLED:
            break
    if found is not result:
        notes += _told(result, found)
    lasting = slow(found)
    if lasting is not None:
        later = _scaled(found, lasting.factor, again)
        if later.converged:
            notes.append(_told_slow(lasting, found.start))
            found = later
    if found is result:
        return result
    for note in reversed(notes):
        found.add_note(note)
    return found


def _suspicious(result: Adjustment) -> bool:
    """Whether any group of antenna positions may contradict, at a glance."""
    table = result.residuals["gnss"]
    if len(table) < 3:
        return False
    scaled = table[["vx", "vy", "vz"]].to_numpy() / table[["sx", "sy", "sz"]].to_numpy()
    flights = _flights(result)
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
        & (table["redundancy"] >= _LEAST)
        & (table["p"] < RARE_CHANCE)
        & (table["sigma0"] > CONTRADICTING_FACTOR * usual)
    )
    return {
        (row.part, row.flight): row.sigma0 / usual for row in table[wrong].itertuples(index=False)
    }


def _scaled(found: Adjustment, factors: dict[tuple[str, str], float], again: Again) -> Adjustment:
    """Adjusted with standard deviations of groups (part, flight) of positions times factors."""
    start = found.start.copy()
    flight = start.image_flight[start.image_rows("gnss")]
    for (part, name), factor in factors.items():
        _restate(start, flight == start.flight_names.index(name), AXES[part], factor)
    return from_where_it_ended(found, start, found.problem.model, again)


def _restate(start: Block, rows: np.ndarray, axes: slice, factor: float | np.ndarray) -> None:
    sigma = start.gnss_sigma()
    sigma[rows, axes] *= factor
    start.put("gnss", ("sx", "sy", "sz"), sigma)


def from_where_it_ended(result: Adjustment, start: Block, model: Model, again: Again) -> Adjustment:
    """Adjusted with positions and stated arms of `start`, from the poses that were found."""
    ended = result.start_again
    ended.gnss, ended.lever_arm, ended.extra = start.gnss, start.lever_arm, start.extra
    ended.marks, ended.ground = start.marks, start.ground
    found = again(ended, model)
    found.start = start
    found.keep_notes(result)
    return found


def _told(before: Adjustment, found: Adjustment) -> list[str]:
    """A sentence on each flight whose positions were given other standard deviations as a whole."""
    notes = []
    old, new = before.start.gnss_sigma(), found.start.gnss_sigma()
    flight = found.start.image_flight[found.start.image_rows("gnss")]
    for k, name in enumerate(found.start.flight_names):
        mine = flight == k
        if not mine.any():
            continue
        parts = []
        for part, axes in AXES.items():
            # A block that is weighted apart is less than half.
            factor = float(np.median((new / old)[mine, axes]))
            if factor > 1.0:
                stated, used = (float(np.median(s[mine, axes])) for s in (old, new))
                parts.append(f"{used:.2g} m in {part} where {stated:.2g} m is stated")
        if parts:
            notes.append(
                f"GNSS of flight {name}: residuals contradict the stated standard deviations; the "
                f"positions count with {' and '.join(parts)}. Either these are too small, or the "
                "model lacks something: `corridor diagnose` finds out what."
            )
    return notes


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


def _told_slow(found: Slow, start: Block) -> str:
    stated = np.median(start.gnss_sigma(), axis=0)[[0, 2]]
    lasting = " and ".join(
        f"{found.white * np.sqrt(found.ratio) * sigma:.2g} m in {part}"
        for sigma, part in zip(stated, AXES, strict=True)
    )
    most = max(found.factor.values())
    return (
        f"GNSS: the errors of one position and the next are alike ({lasting} that lasts for some "
        f"{found.constant:.0f} s). Standard deviations count up to {most:.1f} times, so that many "
        "positions together are as sure as they are. RTK and PPK drift like this; where a model "
        "lacks something it looks the same: `corridor diagnose` finds out."
    )


# --- a block of false positions ------------------------------------------------------------------


def false_positions(result: Adjustment, again: Again) -> np.ndarray | None:
    """Which antenna positions (k,) of an adjustment are false, where some flight's contradict what
    is stated and the greater part of them agrees; else None."""
    doubtful = contradicting(result)
    if not doubtful:
        return None
    return _concentrated(result, again, sorted({flight for _, flight in doubtful}))


def false_apart(
    result: Adjustment, again: Again, flights: list[str], notes: list[str]
) -> Adjustment:
    """Adjusted with the false positions among those of some flights weighted by what they miss.

    Found by concentration: the best part of each flight decides, and which part is best follows
    from what it says of all. Nothing is taken for false where the rest does not agree with itself.
    """
    false = _concentrated(result, again, flights)
    if false is None or not false.any():
        return result
    lone = result.residuals["gnss"]["image"].astype(str).to_numpy()
    start = result.start.copy()
    rows = start.gnss["image"].astype(str).isin(set(lone[false])).to_numpy()
    silent = start.copy()
    _restate(silent, rows, slice(0, 3), _SILENT)
    try:
        apart = from_where_it_ended(result, silent, result.problem.model, again)
    except (InputError, AdjustmentFailed):
        return result
    if not apart.converged:
        return result
    table = apart.residuals["gnss"]
    miss = table.loc[false, ["vx", "vy", "vz"]].to_numpy()
    sigma = result.residuals["gnss"].loc[false, ["sx", "sy", "sz"]].to_numpy()
    size = np.sqrt(np.mean((miss / sigma) ** 2))
    _restate(start, rows, slice(0, 3), max(size, 1.0))
    found = from_where_it_ended(apart, start, result.problem.model, again)
    if not found.converged:
        return result
    notes.append(_told_false(lone[false], miss, size))
    return found


def _concentrated(result: Adjustment, again: Again, flights: list[str]) -> np.ndarray | None:
    """Which antenna positions (k,) are false; None where their rest does not agree with itself.

    Begun with the part that fits best; where that ends nowhere, without each part of the flights
    in turn: false positions follow each other, and may have drawn all others after them.
    """
    mine = np.isin(_flights(result), flights)
    sigma = result.residuals["gnss"][["sx", "sy", "sz"]].to_numpy()
    images = result.system.images
    taken = images.time[result.system.gnss.image] if np.isfinite(images.time).all() else None
    rows = np.flatnonzero(mine)
    if taken is not None:
        rows = rows[np.argsort(taken[rows], kind="stable")]
    count = len(rows) - int(np.ceil(_BEST * len(rows)))
    by_fit = np.flatnonzero(mine)[np.argsort(-lengths(result, sigma)[mine], kind="stable")]
    parts = [by_fit[:count], *(rows[k : k + count] for k in _begun(len(rows), count))]
    # With all of them; the rest agrees with itself, or at least far better than all do.
    limit = max(CONTRADICTING_FACTOR, _scale(lengths(result, sigma)[mine]) / CONTRADICTING_FACTOR)
    least, found = limit, None
    for part in parts:
        best = np.ones(len(mine), bool)
        best[part] = False
        false, scale = _concentrated_from(best, mine, sigma, result, again)
        if scale < least:
            least, found = scale, false
        if scale < CONTRADICTING_FACTOR:
            break
    return found


def _scale(length: np.ndarray) -> float:
    """Size of positions in their sigmas by the best six tenths of their lengths, chi of three."""
    return float(np.sqrt(np.quantile(length**2, _BEST) / chdtri(3, 1.0 - _BEST)))


def _begun(rows: int, count: int) -> list[int]:
    """Where parts of `count` of so many rows begin, that overlap by half."""
    return list(range(0, rows - count + 1, max(count // 2, 1)))


def _concentrated_from(
    best: np.ndarray, mine: np.ndarray, sigma: np.ndarray, result: Adjustment, again: Again
) -> tuple[np.ndarray, float]:
    """The same, begun with some (k,) of the positions that are looked at, and all others; and the
    size of the rest, infinite where it is not the greater part."""
    names = result.residuals["gnss"]["image"].astype(str).to_numpy()
    found = result
    for _ in range(_STEPS):
        start = result.start.copy()
        out = start.gnss["image"].astype(str).isin(set(names[~best])).to_numpy()
        _restate(start, out, slice(0, 3), _SILENT)
        try:
            found = from_where_it_ended(found, start, result.problem.model, again)
        except (InputError, AdjustmentFailed):
            return ~best, np.inf
        if not found.converged:
            return ~best, np.inf
        length = lengths(found, sigma)
        scale = _scale(length[mine])
        before, best = best, ~mine | (length < OUTLIER * max(scale, 1.0))
        if (best == before).all():
            break
    return ~best, scale if (~best).sum() <= (1.0 - _BEST) * mine.sum() else np.inf


def lengths(found: Adjustment, sigma: np.ndarray) -> np.ndarray:
    """Residuals (k,) of the antenna positions in their own sigmas, all axes together, where the
    positions are good to sigma (k, 3), m; some may count for nothing in what is found."""
    table = found.residuals["gnss"]
    v, used = table[["vx", "vy", "vz"]].to_numpy(), table[["sx", "sy", "sz"]].to_numpy()
    share, p = of_antennas(found.covariance), found.problem
    back = np.linalg.inv(np.sqrt(p.gnss_weight)[:, :, None] * p.gnss_turn)
    silent = (used > 2.0 * sigma).any(axis=1)
    own = (sigma / used)[:, :, None] * back
    # What counts has part in its own prediction; what does not is predicted by all others.
    across = back.transpose(0, 2, 1)
    left_out = back @ (np.eye(3) - share) @ across + own @ own.transpose(0, 2, 1)
    variance = np.where(silent[:, None, None], left_out, back @ share @ across)
    variance += 1e-6 * np.eye(3) * (sigma**2)[:, :, None]
    return np.sqrt(np.einsum("ni,ni->n", v, np.linalg.solve(variance, v[:, :, None])[:, :, 0]))


def _told_false(names: np.ndarray, miss: np.ndarray, size: float) -> str:
    middle = np.median(miss, axis=0)
    together = np.linalg.norm(miss - middle, axis=1).mean() < 0.5 * np.linalg.norm(middle)
    vector = ", ".join(f"{value:+.2f}" for value in middle)
    by = (
        f"by one vector ({vector} m)"
        if together and len(names) > 2
        else f"by {'up to ' * (len(names) > 1)}{np.linalg.norm(miss, axis=1).max():.2f} m"
    )
    cause = ": a float solution, or a lost fix?" if len(names) > 2 else ": a false fix?"
    one = len(names) == 1
    aside = (
        f"It is set aside, with a standard deviation {size:.0f} times as large; --reject-gnss "
        "takes it out."
        if one
        else f"They are set aside, with standard deviations {size:.0f} times as large; "
        "--reject-gnss takes them out."
    )
    return (
        f"{counted(len(names), 'GNSS position')} disagree{'s' * one} with all others {by}, "
        f"{size:.0f} times the stated standard deviations ({some(list(names), 5)}){cause} {aside}"
    )
