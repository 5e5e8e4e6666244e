"""The accuracy of a flight from covariances alone, before it is flown.

`plan(PLAN)` (`corridor.plan`) answers in sentences, with tables and pictures; `Planner(plan)` asks
one flight set for `expect(control)`, `sweep` many.
"""

from corridor.tools.planning.advising import advice
from corridor.tools.planning.expected import Expected
from corridor.tools.planning.network import Carried
from corridor.tools.planning.noise import GnssNoise
from corridor.tools.planning.planned import Planned, plan
from corridor.tools.planning.planner import Planner, subset
from corridor.tools.planning.surveyed import Surveyed
from corridor.tools.planning.sweeping import flight_sets, sweep
