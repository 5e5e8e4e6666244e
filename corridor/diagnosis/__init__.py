"""The missing effect: where simulation and measurement disagree.

`counterparts(adjustment)` simulates the measured block again and again from the believed model;
`compare` holds the measured one beside them, `Closing` the comparison before and after an effect
is added. `counterpart` gives one of them as a block.
"""

from corridor.diagnosis.comparison import Closing, Compared, Comparison, compare
from corridor.diagnosis.counterpart import Counterparts, counterpart, counterparts, measure
from corridor.diagnosis.estimated_noise import EstimatedNoise
from corridor.diagnosis.statistics import Statistic

__all__ = [
    "Closing",
    "Compared",
    "Comparison",
    "Counterparts",
    "EstimatedNoise",
    "Statistic",
    "compare",
    "counterpart",
    "counterparts",
    "measure",
]
