"""Whether a patch is ground: all strips of one date show the same, and all of it moves.

Tie points on water, traffic or leaves move while they are photographed. Along a strip that looks
like another height, and the next strip, flown the other way or at another time, shows another one:
the date shows two surfaces there, and their mean is no ground.

Ground that moves takes all of its points with it. What stands on it for a day lifts some of them,
and the mean, while the typical point stays.

Source: Behboodian 1970, "On the modes of a mixture of two normal distributions" (two layers are two
where they lie apart by more than two standard deviations of each).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from corridor.core.preparation import strips_of
from corridor.tools.change.cores import Cores
from corridor.tools.change.epoch import Cloud, Epoch
from corridor.tools.change.m3c2 import LEAST_IN_CYLINDER, members, polynomial
from corridor.tools.change.significance import two_sided

# Level of the test, of a patch at one date.
FALSE_ALARM = 1e-3
APART = 2.0


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
