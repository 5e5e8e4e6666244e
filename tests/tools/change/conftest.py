"""Two adjustments of one dike, made once."""

import pytest
from made import adjusted, joint

from corridor.tools.change import make_cores, point_changes, surface_change


@pytest.fixture(scope="session")
def pair():
    return joint(adjusted(10), adjusted(11))


@pytest.fixture(scope="session")
def cores(pair):
    return make_cores(pair.before.xyz, pair.after.xyz, spacing=12.0)


@pytest.fixture(scope="session")
def surface(pair, cores):
    return surface_change(pair, cores, sampled=False)


@pytest.fixture(scope="session")
def points(pair):
    return point_changes(pair, 0.01, "stated", "rigid")
