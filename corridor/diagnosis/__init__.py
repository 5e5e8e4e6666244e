"""The missing effect: where simulation and measurement disagree.

`diagnose(block)` returns a `Diagnosis`: what is missing from the model one believes in, how sure
that is, what it does to data that the fit has not used, and what could not be tested. Its
`course.last` holds the reduced system of the last round: `evidence` (`Evidence`), `equations`,
`noise` of the GNSS.

`counterparts(adjustment)` simulates the measured block again and again from the believed model;
`compare` holds the measured one beside them, `Closing` the comparison before and after an effect
is added. `counterpart` gives one of them as a block.
"""

from corridor.diagnosis.diagnose import Diagnosis, diagnose
from corridor.diagnosis.evidence.confusability import confusability
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.replicates.comparison import Closing, Compared, Comparison, compare
from corridor.diagnosis.replicates.counterparts import Counterparts, counterparts, measure
from corridor.diagnosis.replicates.replicate_block import counterpart
from corridor.diagnosis.replicates.replicator import EstimatedNoise
from corridor.diagnosis.replicates.statistics import Statistic
from corridor.diagnosis.report import check_output
from corridor.diagnosis.report.corrected import corrected
from corridor.diagnosis.rounds import Course, Round
from corridor.effects import candidates

__all__ = [
    "ReferenceModel",
    "Closing",
    "Compared",
    "Comparison",
    "Counterparts",
    "Course",
    "Diagnosis",
    "EstimatedNoise",
    "Evidence",
    "Round",
    "Statistic",
    "candidates",
    "check_output",
    "compare",
    "confusability",
    "corrected",
    "counterpart",
    "counterparts",
    "diagnose",
    "measure",
]
