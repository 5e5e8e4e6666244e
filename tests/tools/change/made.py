"""One dike flown twice: what the benchmark flies, adjusted once."""

from functools import cache

import corridor
from benchmarks import change as benchmark
from corridor.tools.change import Joint, clouds


@cache
def perfect():
    """The dike of the shipped plan with fewer tie points, without any error."""
    return benchmark.dike()


def flown(draw, motion=None, added=None):
    """One flight over the dike, after its ground has moved, with effects of the camera.

    The control is surveyed anew each time.
    """
    return benchmark.flown(perfect(), draw, motion, added)


@cache
def adjusted(draw):
    """A flight over the dike at rest, adjusted."""
    return corridor.adjust(flown(draw))


def joint(first, second, same_ties=True, **options):
    """Both dates with the covariance of all their points."""
    return Joint(*clouds(first, second, same_ties), **options)


def middle():
    """The middle (2,) of the dike, m."""
    return benchmark.middle(perfect())
