"""The accuracy of a flight from covariances alone, before it is flown.

`Planner(plan).expect(control)` answers for one flight set; `sweep` for many, with `advice` in
sentences, `as_text`, `picture` and `save` for its table.
"""

from corridor.planning.advice import advice
from corridor.planning.expected import Accuracy, Expected
from corridor.planning.network import Carried
from corridor.planning.noise import GnssNoise
from corridor.planning.planner import Planner, subset
from corridor.planning.report import as_text, picture, save
from corridor.planning.surveyed import Surveyed
from corridor.planning.sweep import flight_sets, sweep

__all__ = [
    "Accuracy",
    "Carried",
    "Expected",
    "GnssNoise",
    "Planner",
    "Surveyed",
    "advice",
    "as_text",
    "flight_sets",
    "picture",
    "save",
    "subset",
    "sweep",
]
