"""Small plans, solved once."""

import pytest
from small_plans import NADIR, OBLIQUE, plan_of

from corridor.tools.planning import Planner


@pytest.fixture(scope="session")
def small():
    """One nadir and one oblique flight, three strips each."""
    return Planner(plan_of(NADIR, OBLIQUE))


@pytest.fixture(scope="session")
def nadir():
    """The nadir flight alone."""
    return Planner(plan_of(NADIR))
