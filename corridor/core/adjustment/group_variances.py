"""One variance factor for each kind of observation, in plan and in height, and for each flight.

One factor for a whole block is made by its thousands of image points: antenna positions that miss
by ten sigmas do not show in it. Each group has its own, v'Pv / r with its own redundancy r, and a
test of it. Where antenna positions of a group contradict what is stated, their standard deviations
are those that they have; one block of false positions is told from the rest and weighted apart.

Source: Förstner 1979 and Koch 1986 (v'Pv / r, iterated); Rousseeuw and Van Driessen 1999, "A fast
algorithm for the minimum covariance determinant estimator" (concentration: what the best part says
of all decides which part is best), for the block.
"""

from __future__ import annotations

from collections.abc import Callable

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
from corridor.core.output import counted

Again = Callable[..., Adjustment]
_PLAN, _HEIGHT = slice(0, 2), slice(2, 3)
AXES = {"plan": _PLAN, "height": _HEIGHT}
_TURNS = {"roll and pitch": _PLAN, "yaw": _HEIGHT}
# A group contradicts what is stated where chance does so once in a thousand, and its factor, which
# small faults of any model raise, is beyond two.
RARE, FACTOR = 1e-3, 2.0
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
        table = getattr(reliability, kind)
        of_flights = kind in POSE_KINDS
        flights = np.full(len(table) // 3, "", object)
        flights = _flights(adjustment, kind) if of_flights else flights
        share = table["redundancy"].to_numpy().reshape(-1, 3)
        square = (table["w"].fillna(0.0) ** 2 * table["redundancy"]).to_numpy().reshape(-1, 3)
        for flight in dict.fromkeys(flights.tolist()):
            mine = flights == flight
            for part, axes in (_TURNS if kind == "attitude" else AXES).items():
                r, q = share[mine, axes].sum(), square[mine, axes].sum()
                rows.append((kind, part, flight, square[mine, axes].size, r, q))
                taken += r
    p = adjustment.problem
    if len(adjustment.residuals["mark"]):
        share = reliability.marks["redundancy"]
        square = _image_square(adjustment, "mark")
        rows.insert(0, ("mark", "", "", len(share), share.sum(), square))
        taken += share.sum()
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
    doubtful = contradicting(result)
    if not doubtful:
        return result
    notes: list[str] = []
    found = false_apart(result, again, sorted({flight for _, flight in doubtful}), notes)
    for _ in range(_ROUNDS):
        doubtful = contradicting(found)
        if not doubtful:
            break
        start = found.start.copy()
        factors = {}
        for (part, flight), factor in doubtful.items():
            factors[part, flight] = factor
            _scale(start, found, part, flight, factor)
        found = from_where_it_ended(found, start, found.problem.model, again)
        if not found.converged:
            return result
        if max(abs(np.log(f)) for f in factors.values()) < _SETTLED:
            break
    if found is result:
        return result
    notes += _told(result, found)
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


def contradicting(result: Adjustment) -> dict[tuple[str, str], float]:
    """Groups (part, flight) of antenna positions whose residuals contradict their standard
    deviations, and their sigma naught over the general one."""
    if not result.converged or not _suspicious(result):
        return {}
    table = components(result)
    # What all observations are too large by is sigma naught's matter.
    general = max(result.sigma0, 1.0)
    wrong = (
        (table["kind"] == "gnss")
        & (table["redundancy"] >= _LEAST)
        & (table["p"] < RARE)
        & (table["sigma0"] > FACTOR * general)
    )
    return {
        (row.part, row.flight): row.sigma0 / general for row in table[wrong].itertuples(index=False)
    }


def _scale(start: Block, found: Adjustment, part: str, flight: str, factor: float) -> None:
    """Standard deviations of the positions of a flight times a factor, in plan or in height."""
    mine = start.image_flight[start.image_rows("gnss")] == start.flight_names.index(flight)
    _restate(start, mine, AXES[part], factor)


def _restate(start: Block, rows: np.ndarray, axes: slice, factor: float | np.ndarray) -> None:
    sigma = start.gnss_sigma()
    sigma[rows, axes] *= factor
    start.put("gnss", ("sx", "sy", "sz"), sigma)


def from_where_it_ended(result: Adjustment, start: Block, model: Model, again: Again) -> Adjustment:
    """Adjusted with positions and stated arms of `start`, from the poses that were found."""
    ended = result.start_again
    ended.gnss, ended.lever_arm, ended.extra = start.gnss, start.lever_arm, start.extra
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
    """Which antenna positions (k,) are false; None where their rest does not agree with itself."""
    table = result.residuals["gnss"]
    mine = np.isin(_flights(result), flights)
    names = table["image"].astype(str).to_numpy()
    sigma = table[["sx", "sy", "sz"]].to_numpy()
    length = _lengths(result, sigma)
    quantile = float(chdtri(3, 1.0 - _BEST))
    order = np.argsort(length[mine], kind="stable")
    best = ~mine
    best[np.flatnonzero(mine)[order[: int(np.ceil(_BEST * mine.sum()))]]] = True
    found = result
    for _ in range(_STEPS):
        start = result.start.copy()
        out = start.gnss["image"].astype(str).isin(set(names[~best])).to_numpy()
        _restate(start, out, slice(0, 3), _SILENT)
        try:
            found = from_where_it_ended(found, start, result.problem.model, again)
        except (InputError, AdjustmentFailed):
            return None
        if not found.converged:
            return None
        length = _lengths(found, sigma)
        # Of a chi-square of three axes six tenths lie below the quantile.
        scale = np.sqrt(np.quantile(length[mine] ** 2, _BEST) / quantile)
        before, best = best, ~mine | (length < OUTLIER * max(scale, 1.0))
        if (best == before).all():
            break
    # The rest agrees, and is the greater part.
    if scale > FACTOR or (~best).sum() > (1.0 - _BEST) * mine.sum():
        return None
    return ~best


def _lengths(found: Adjustment, sigma: np.ndarray) -> np.ndarray:
    """Residuals (k,) of the antenna positions in their own sigmas, all axes together, where the
    positions are good to sigma (k, 3), m; some may count for nothing in what is found."""
    table = found.residuals["gnss"]
    v, used = table[["vx", "vy", "vz"]].to_numpy(), table[["sx", "sy", "sz"]].to_numpy()
    share = of_antennas(found.covariance)
    outer = used[:, :, None] * used[:, None, :]
    silent = (used > 2.0 * sigma).any(axis=1)
    # What counts has part in its own prediction; what does not is predicted by all others.
    left_out = outer * (np.eye(3) - share) + np.eye(3) * (sigma**2)[:, :, None]
    variance = np.where(silent[:, None, None], left_out, outer * share)
    variance += 1e-6 * np.eye(3) * (sigma**2)[:, :, None]
    return np.sqrt(np.einsum("ni,ni->n", v, np.linalg.solve(variance, v[:, :, None])[:, :, 0]))


def _told_false(names: np.ndarray, miss: np.ndarray, size: float) -> str:
    middle = np.median(miss, axis=0)
    together = np.linalg.norm(miss - middle, axis=1).mean() < 0.5 * np.linalg.norm(middle)
    vector = ", ".join(f"{value:+.2f}" for value in middle)
    by = (
        f"by one vector ({vector} m)"
        if together and len(names) > 2
        else "by up to " + (f"{np.linalg.norm(miss, axis=1).max():.2f} m")
    )
    cause = ": a float solution, or a lost fix?" if len(names) > 2 else ": a false fix?"
    return (
        f"{counted(len(names), 'GNSS position')} disagree{'s' * (len(names) == 1)} with all others "
        f"{by}, {size:.0f} times the stated standard deviations ({some(list(names), 5)}){cause} "
        f"They are set aside, with standard deviations {size:.0f} times as large; --reject-gnss "
        "takes them out."
    )
