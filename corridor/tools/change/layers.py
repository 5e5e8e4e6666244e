"""Whether a patch is ground: all strips of one date show the same, it is not level as water is,
and all of it moves.

Tie points on water, traffic or leaves move while they are photographed. Along a strip that looks
like another height, and the next strip, flown the other way or at another time, shows another one:
the date shows two surfaces there, and their mean is no ground.

Still water is level: its points share one height, whatever they were found on, at both dates or at
the one that shows it. No
slope, no crest with a camber and no rough ground does, as far as the points are good enough to show
it; what they cannot show is not taken for water.

Ground that moves takes all of its points with it. What stands on it for a day lifts some of them,
and the mean, while the typical point stays.

Source: Behboodian 1970, "On the modes of a mixture of two normal distributions" (two layers are two
where they lie apart by more than two standard deviations of each).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, hstack
from scipy.stats import chi2, f

from corridor.core.preparation import strips_of
from corridor.tools.change.cores import Cores
from corridor.tools.change.epoch import Cloud, Epoch, coordinates
from corridor.tools.change.joint import Joint
from corridor.tools.change.m3c2 import LEAST_IN_CYLINDER, members, polynomial, roughness
from corridor.tools.change.registration import EFFICIENCY
from corridor.tools.change.significance import two_sided

# Level of the test, of a patch at one date.
FALSE_ALARM = 1e-3
APART = 2.0
# How often ground as smooth as the smoothest of the surface, this share of it, may pass for level.
MISSED = 0.05


@dataclass(frozen=True)
class Layers:
    """A strip (its name) whose points lie above those of the others along the normal, by so much,
    m; below where that is negative."""

    strip: str
    above: float


def layers(cloud: Cloud, cores: Cores, degree: int) -> Layers | None:
    """The strip that lies farthest from the others at some core points; None where all agree.

    In each cylinder the mean of its points is compared with that of the others, and with their
    scatter there; a point of several cylinders counts once.
    """
    found = members(cloud, cores, degree)
    names, of = _strips(cloud.epoch)
    strip, shared = of[found.point], len(found.point) / max(len(np.unique(found.point)), 1)
    out = None
    for n, name in enumerate(names):
        mine = (strip == n).astype(int)
        group = 2 * found.core + mine
        count = np.bincount(group, minlength=2 * len(cores)).reshape(-1, 2)
        sums = np.bincount(group, found.height, minlength=2 * len(cores)).reshape(-1, 2)
        mean = sums / np.maximum(count, 1)
        weight = count[:, 0] * count[:, 1] / np.maximum(count.sum(axis=1), 1)
        free = (len(group) - np.count_nonzero(count)) / shared
        if weight.sum() < LEAST_IN_CYLINDER * shared or free < 1:
            continue
        within = np.sum((found.height - mean.ravel()[group]) ** 2) / shared / free
        above = float(weight @ (mean[:, 1] - mean[:, 0]) / weight.sum())
        sigma = np.sqrt(max(within, 1e-12) * shared / weight.sum())
        chance = two_sided(above / sigma, free)
        apart = abs(above) > APART * np.sqrt(within) and chance < FALSE_ALARM / len(names)
        if apart and (out is None or abs(above) > abs(out.above)):
            out = Layers(name, above)
    return out


@dataclass(frozen=True)
class Level:
    """Points that share one height at some dates (their numbers): heights, reach: how far from it
    they may lie, within: RMS about it of the worse date, m."""

    heights: tuple[float, ...]
    reach: tuple[float, ...]
    within: float
    dates: tuple[int, ...]

    def shown(self, clouds: tuple[Cloud, Cloud], cores: Cores, degree: int) -> np.ndarray:
        """Which core points (r,) show some of them at all of these, as a bank between them does."""
        out = np.ones(len(cores), dtype=bool)
        for n, height, reach in zip(self.dates, self.heights, self.reach, strict=True):
            cloud = clouds[n]
            found = members(cloud, cores, degree)
            at = np.abs(cloud.epoch.xyz[found.point, 2] - height) < reach
            out &= np.bincount(found.core, at, len(cores)) > 0
        return out


def smoothest(clouds: tuple[Cloud, Cloud], cores: Cores, rows: np.ndarray, degree: int) -> float:
    """Variance, m^2, of heights beyond their noise on the smoothest ground beside some core points;
    0 where there is none."""
    found = [members(cloud, cores, degree) for cloud in clouds]
    beside = np.delete(roughness(clouds, found, cores)[0], rows)
    return float(np.quantile(beside, MISSED)) if len(beside) else 0.0


def level(joint: Joint, cores: Cores, degree: int, smooth: float) -> Level | None:
    """How the points at some core points are level, None where they are not known to be.

    At both dates, or at one, all points in some cylinders lie within three standard deviations of
    the height that most points share, and scatter about a plane by no more than the noise of each
    alone. smooth: see `smoothest`; where points are too few or too coarse to show that much,
    nothing is known.
    """
    clouds, shown = (joint.before, joint.after), []
    for n, cloud in enumerate(clouds):
        found = members(cloud, cores, degree)
        point = np.unique(found.point)
        sigma = np.sqrt(joint.variance(_heights(joint, n, point)))
        reach, z = 3.0 * float(np.median(sigma)), cloud.epoch.xyz[:, 2]
        height = _most_shared(z[point], reach)
        at = np.abs(z[found.point] - height) < reach
        shown.append((height, reach, found, np.bincount(found.core, at, len(cores))))
    for dates in ((0, 1), (0,), (1,)):
        some = [shown[n] for n in dates]
        whole = np.all([count == found.count for _, _, found, count in some], axis=0)
        scatter = [
            _level_within(clouds[n].epoch, np.unique(f.point[whole[f.core]]), height, smooth)
            for n, (height, _, f, _) in zip(dates, some, strict=True)
        ]
        if None not in scatter:
            heights, reach, *_ = zip(*some, strict=True)
            return Level(heights, reach, max(scatter), dates)
    return None


def _level_within(epoch: Epoch, point: np.ndarray, height: float, smooth: float) -> float | None:
    """What points (k,) scatter about a height, m; None where they are not known to be level."""
    free, z = len(point) - 3, epoch.xyz[point, 2] - height
    if free < 1:
        return None
    own = epoch.sigma0**2 * epoch.own(point)[:, 2, 2]
    away = epoch.xyz[point, :2] - epoch.xyz[point, :2].mean(axis=0)
    # What poses do to the heights of neighbours is a plane.
    root = own[:, None] ** -0.5
    plane = np.column_stack([np.ones(len(z)), away]) * root
    left = z * root[:, 0] - plane @ np.linalg.lstsq(plane, z * root[:, 0])[0]
    limit = chi2.isf(FALSE_ALARM, free)
    missed = chi2.cdf(limit / (1.0 + smooth / np.median(own)), free)
    return float(np.sqrt(np.mean(z**2))) if left @ left < limit and missed < MISSED else None


def _heights(joint: Joint, date: int, point: np.ndarray) -> csr_array:
    """Heights of points (k,) of a date as functions of the points of both."""
    sides = [csr_array((len(point), 3 * len(c.epoch.names))) for c in (joint.before, joint.after)]
    sides[date] = coordinates((joint.before, joint.after)[date].epoch, point)[2::3]
    return hstack(sides, format="csr")


def _most_shared(values: np.ndarray, reach: float) -> float:
    """The median of the numbers (n,) within reach of the one that has most of them there."""
    ordered = np.sort(values)
    first, last = (np.searchsorted(ordered, ordered + r) for r in (-reach, reach))
    most = np.argmax(last - first)
    return float(np.median(ordered[first[most] : last[most]]))


def typical(
    clouds: tuple[Cloud, Cloud], cores: Cores, degree: int, sampled: bool = True
) -> np.ndarray:
    """By how much the typical point at core points moved (k,), m.

    In each cylinder the median of the second date's points over a surface fitted to the first
    date's, less the median of these: what the surface does not fit is the same for both. Where both
    dates have the very same points (not sampled), the median of what each of them did.
    """
    first = members(clouds[0], cores, degree)
    if not sampled:
        moved = first.elsewhere(*clouds, cores).height - first.height
        return np.array([np.median(one) for one in np.split(moved, first.start[1:-1])])
    found, sides = [first, members(clouds[1], cores, degree)], []
    for cloud, one in zip(clouds, found, strict=True):
        away = (cloud.epoch.xyz[one.point] - cores.xyz[one.core])[:, :2] / cores.radius
        sides.append((polynomial(*away.T, degree), one.height, one.start))
    out = []
    for k in range(len(cores)):
        (terms, height), (more, above) = (
            (t[s[k] : s[k + 1]], h[s[k] : s[k + 1]]) for t, h, s in sides
        )
        fit = np.linalg.lstsq(terms, height)[0]
        out.append(np.median(above - more @ fit) - np.median(height - terms @ fit))
    return np.array(out)


def scatter_added(clouds: tuple[Cloud, Cloud], cores: Cores, degree: int, date: int) -> float:
    """Variance, m^2, by which heights at some core points scatter more at one date; 0 where that is
    chance (F tests).

    Of all cylinders, or of the median one, in which edges of the ground, as of a dike, decide
    nothing.
    """
    found = [members(cloud, cores, degree) for cloud in clouds]
    # A point of several cylinders counts once.
    free = np.array([len(np.unique(one.point)) - one.fit for one in found], dtype=float)
    squares, added = np.array([one.spread**2 for one in found]), 0.0
    for middle, worth in ((np.nanmean, 1.0), (np.nanmedian, EFFICIENCY)):
        less, more = middle(squares, axis=1)[[1 - date, date]]
        rest, mine = worth * free[[1 - date, date]]
        if min(rest, mine) >= 1.0 and f.sf(more / max(less, 1e-12), mine, rest) < 0.5 * FALSE_ALARM:
            added = max(added, float(more - less))
    return added


def _strips(epoch: Epoch) -> tuple[list[str], np.ndarray]:
    """Names of the strips, and of each point (n,) the strip that shows it most often."""
    images, rows = epoch.system.images, epoch.system.image_rows
    block = epoch.adjustment.block
    known = strips_of(block)
    number = dict.fromkeys(images.names, 0)
    every = block.images["image"].astype(str).to_numpy()
    for n, (_, mine) in enumerate(known):
        number |= dict.fromkeys(every[mine].tolist(), n)
    strip = np.array([number[name] for name in images.names])
    seen = np.zeros((len(epoch.names), len(known)), dtype=int)
    np.add.at(seen, (rows.point, strip[rows.image]), 1)
    return [name for name, _ in known], np.argmax(seen, axis=1)
