"""How late the positions of photographs are, by the mapped centres.

Positions in order of time are the way that was flown, and the mapped centres are the same way but
for a similarity. Where a position is that of another moment than its picture, the two ways fit when
one is moved along time; on the strips to and fro nothing else does that.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.geometry import jackknife, similarity
from corridor.core.preparation import CONTRADICTS, Witness
from corridor.tools.formats.project import Project

# Delays are looked for up to so many seconds, in these steps, and then between two of them.
_FAR_S, _STEP_S = 5.0, 0.25
# A delay of so many sigmas is told where the ways then fit so much better; one that is shorter is
# that of any receiver.
_SIGMAS, _LEAST_S, _BETTER, _FEWEST = 5.0, 0.3, 0.7, 10
# Errors of a receiver are alike for a minute: the sigma is of so many parts left out in turn.
_PARTS = 5


class Delay(NamedTuple):
    """seconds: by which positions are late, as positions of an earlier moment are. sigma: s."""

    seconds: float
    sigma: float


def with_delay_told(project: Project) -> Project:
    """The project with a warning where its positions are late, or early, with the value."""
    block = project.block
    place = np.full((len(block.images), 3), np.nan)
    rows = block.image_rows("gnss")
    place[rows[rows >= 0]] = block.numbers("gnss", *"xyz")[rows >= 0]
    found = delay_of(block, place)
    if found is None:
        return project
    late, when = ("late", "before") if found.seconds > 0 else ("early", "after")
    told = (
        f"the positions of the photographs are {abs(found.seconds):.1f} +- {found.sigma:.1f} s "
        f"{late}: each lies where the camera was so long {when} its picture; "
        "`corridor adjust BLOCK --effect clock_offset` estimates it with the rest"
    )
    way = Witness("the mapped centres", CONTRADICTS, f"{found.seconds:.1f} s {late}")
    source, sigma = "the photographs' own positions", np.array([found.sigma])
    return project.warned(told).deriving("moments of gnss.csv", source, sigma, told, "s", [way])


def delay_of(block: Block, place: np.ndarray) -> Delay | None:
    """By how much the positions of images are late; None where they are not, or nothing tells.

    place: (images, 3) m, in any frame, NaN where unknown. Centres and times are those of block.
    """
    time, centre = block.column("images", "time_s"), block.numbers("images", *"xyz")
    ways = _ways(time, place, block.image_flight)
    inner = np.isfinite(centre).all(axis=1)
    for shift in (-_FAR_S, _FAR_S):
        inner &= np.isfinite(_at(ways, time + shift)).all(axis=1)
    rows = np.flatnonzero(inner)
    if len(rows) < _FEWEST:
        return None
    rows = rows[np.argsort(time[rows], kind="stable")]
    shifts = np.arange(-_FAR_S, _FAR_S + _STEP_S / 2, _STEP_S)
    moved = [_at(ways, time + shift)[rows] for shift in shifts]
    best = _best(centre[rows], moved, shifts)
    if best is None or abs(best[0]) < _LEAST_S or best[1] > _BETTER:
        return None
    parts = np.array_split(np.arange(len(rows)), min(_PARTS, len(rows) // 4))
    left = []
    for part in parts:
        kept = np.delete(np.arange(len(rows)), part)
        one = _best(centre[rows][kept], [way[kept] for way in moved], shifts)
        left += [] if one is None else [one[0]]
    if len(left) < max(len(parts) - 1, 2):
        return None
    # With parts left out (Shao and Tu 1995, eq. 2.9), not below a step's rounding.
    sigma = float(np.hypot(jackknife(left), _STEP_S / np.sqrt(12)))
    if abs(best[0]) < _SIGMAS * sigma:
        return None
    return Delay(best[0], sigma)


def _ways(time, place, flight) -> list[tuple]:
    """Of each flight: rows, first and last moment, and the way through its positions."""
    ways = []
    for one in np.unique(flight):
        rows = np.flatnonzero((flight == one) & np.isfinite(time) & np.isfinite(place).all(axis=1))
        moments, first = np.unique(time[rows], return_index=True)
        if len(moments) > 3:
            ways.append((flight == one, moments, CubicSpline(moments, place[rows[first]])))
    return ways


def _at(ways, time) -> np.ndarray:
    """Where the ways were at moments (images,), NaN before, after, and in long gaps."""
    out = np.full((len(time), 3), np.nan)
    for mine, moments, way in ways:
        after = np.clip(np.searchsorted(moments, time), 1, len(moments) - 1)
        gap = moments[after] - moments[after - 1]
        known = mine & (time >= moments[0]) & (time <= moments[-1])
        known &= gap <= 3 * np.median(np.diff(moments))
        out[known] = way(time[known])
    return out


def _best(centre, moved, shifts) -> tuple[float, float] | None:
    """The shift where centres and way fit best, and what misses then, as a share of that at 0.

    None where the best lies at the end of what was tried.
    """
    missed = np.array([_missed(centre, place) for place in moved])
    k = int(np.argmin(missed))
    if not np.isfinite(missed[k]) or k in (0, len(shifts) - 1):
        return None
    before, here, after = missed[k - 1 : k + 2] ** 2
    bend = before - 2 * here + after
    between = 0.5 * (before - after) / bend if bend > 0 else 0.0
    share = missed[k] / max(missed[int(np.argmin(np.abs(shifts)))], 1e-12)
    return float(shifts[k] + between * (shifts[1] - shifts[0])), float(share)


def _missed(centre, place) -> float:
    """RMS after a similarity; infinite where there is none."""
    try:
        away = similarity(centre, place).apply(centre) - place
    except InputError:
        return np.inf
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
