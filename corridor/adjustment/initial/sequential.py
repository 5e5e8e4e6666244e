"""From image to image, as far as known points reach."""

from collections.abc import Callable

import numpy as np

from corridor.adjustment.initial.interim import adjust_interim
from corridor.adjustment.initial.intersection import intersect_new
from corridor.adjustment.initial.network import Network
from corridor.adjustment.initial.resection import FEWEST_MARKS, resect
from corridor.compiled import compiled

# What is oriented is adjusted on the way whenever it has grown by this.
_GROWTH = 1.25


def resect_in_turn(
    network: Network, say: Callable[[str], None], enough: Callable[[], bool] = lambda: False
) -> None:
    """Resect images from known points, the best supported first, until none is left or enough."""
    count = len(network.images)
    seen_known = np.bincount(network.image, weights=network.known[network.point], minlength=count)
    tried = np.full(count, -1.0)
    adjusted = network.posed.sum()
    while not enough():
        support = np.where(network.posed | (seen_known <= 1.2 * tried), -1, seen_known)
        image = int(np.argmax(support))
        if support[image] < FEWEST_MARKS:
            return
        tried[image] = support[image]
        if not resect(network, image):
            continue
        points = network.point[network.rows(image)]
        before = network.known[points].copy()
        intersect_new(network, again=True, within=points)
        fresh = points[network.known[points] & ~before]
        _count(fresh, network.point_start, network.by_point, network.image, seen_known)
        total = int(network.posed.sum())
        if total % 100 == 0:
            say(f"start values: {total} of {count} images oriented")
        if total > _GROWTH * adjusted:
            adjust_interim(network)
            adjusted = total


@compiled()
def _count(points, point_start, by_point, image, counts):
    """Adds the rays of points to the counts of the images they come from."""
    for p in points:
        for n in range(point_start[p], point_start[p + 1]):
            counts[image[by_point[n]]] += 1
