"""The accuracy of a flight from covariances alone, before it is flown.

`plan(PLAN)` (`corridor.plan`) answers in sentences, with tables and pictures; `Planner(plan)` asks
one flight set for `expect(control)`, `sweep` many.
"""

from corridor.planning.advice import advice
from corridor.planning.expected import Accuracy, Expected
from corridor.planning.network import Carried
from corridor.planning.noise import GnssNoise
from corridor.planning.plan import Planned, plan
from corridor.planning.planner import Planner, subset
from corridor.planning.surveyed import Surveyed
from corridor.planning.sweep import flight_sets, sweep

__all__ = [
    "Accuracy",
    "Carried",
    "Expected",
    "GnssNoise",
    "Planned",
    "Planner",
    "Surveyed",
    "advice",
    "flight_sets",
    "plan",
    "subset",
    "sweep",
]
