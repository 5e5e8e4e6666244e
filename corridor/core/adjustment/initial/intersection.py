"""Which points get a place from the rays that see them, and what those get that have none."""

import numpy as np

from corridor.core.adjustment.initial.network import LEAST_INLIER_SHARE, Network
from corridor.core.engine.compiled import compiled
from corridor.core.geometry import intersect

# Rays that meet at less than this fix no distance to chain from, or none at all.
CHAIN_ANGLE, _NO_ANGLE = np.radians(0.5), np.radians(0.05)


def intersect_new(network: Network, again: bool = False, within: np.ndarray | None = None) -> None:
    """Place points that two oriented images or more see well enough to chain from.

    again: those placed before as well. within: only these points.
    """
    wanted = ~network.point_given & ~network.spare
    if not again:
        wanted &= ~network.known
    points = np.flatnonzero(wanted) if within is None else within[wanted[within]]
    place, angle, good, rays, ahead = _meet(network, points)
    fine = ahead & (angle > CHAIN_ANGLE) & (good >= 2) & (good >= LEAST_INLIER_SHARE * rays)
    network.place[points[fine]] = place[fine]
    network.known[points] = fine


def intersect_all(network: Network) -> None:
    """Place every point that is not given, those too that the rays hardly fix."""
    points = np.flatnonzero(~network.point_given)
    place, angle, _, rays, ahead = _meet(network, points)
    fine = ahead & (angle > _NO_ANGLE) & (rays >= 2)
    network.place[points[fine]] = place[fine]
    network.known[points[fine]] = True
    if fine.all():
        return
    # What the rays do not tell, the points around tell: their depth in each image.
    depth = _depths(
        network.image, network.point, network.place, network.known, network.rotation,
        network.centre, network.posed,
    )  # fmt: skip
    overall = np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
    rest = points[~fine]
    place, *_ = _meet(network, rest, np.where(np.isfinite(depth), depth, overall))
    network.place[rest] = place
    network.known[rest] = np.isfinite(place).all(1)


def _meet(network: Network, points: np.ndarray, depth: np.ndarray | None = None):
    centre = np.where(network.posed[:, None], network.centre, np.nan)
    rays = network.rays._replace(centre=centre)
    return intersect(rays, network.point_start, network.by_point, points, network.gate, depth)


@compiled()
def _depths(image, point, place, known, rotation, centre, posed):
    """Median depth of the known points in each image, NaN where there is none."""
    out = np.full(len(posed), np.nan)
    depth = np.empty(len(image))
    n = 0
    while n < len(image):
        i = image[n]
        count = 0
        while n < len(image) and image[n] == i:
            p = point[n]
            if posed[i] and known[p]:
                z = 0.0
                for k in range(3):
                    z += rotation[i, 2, k] * (place[p, k] - centre[i, k])
                if z > 0.0:
                    depth[count] = z
                    count += 1
            n += 1
        if count:
            out[i] = np.median(depth[:count])
    return out
