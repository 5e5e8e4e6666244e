"""The missing effect: where simulation and measurement disagree.

`diagnose(block)` returns a `Diagnosis`: what is missing from the model one believes in, how sure
that is, what it does to data that the fit has not used, and what could not be tested. Its
`course.last` holds the reduced system of the last round: `evidence` (`Evidence`), `equations`,
`noise` of the GNSS.

    reference       the model one believes in, adjusted robustly
    system/         its linear system with a column for each candidate, all else eliminated
    noise/          noise of the pictures and of the antenna positions
    evidence/       how likely groups of candidates are, beside the lens, blunders and slow noise
    forward_selection  search, add, adjust, search again
    findings/       what that amounts to: values, places, the verdict
    verification/   what data that no fit has used say of it
    anomalies/      noise that changes, and matches that go wrong together
    report/         sentence, actions, tables, page
    settings        every number that decides, with unit and source

`counterparts(adjustment)` simulates the measured block again and again from the believed model
(bootstrap/); `compare` holds the measured one beside them, `Closing` the comparison before and
after an effect is added. `counterpart` gives one of them as a block.
"""

from corridor.core.effects import candidates
from corridor.diagnosis.bootstrap.comparison import Closing, Compared, Comparison, compare
from corridor.diagnosis.bootstrap.counterparts import Counterparts, counterparts, measure
from corridor.diagnosis.bootstrap.replicate_block import counterpart
from corridor.diagnosis.bootstrap.replicator import EstimatedNoise
from corridor.diagnosis.bootstrap.statistics import Statistic
from corridor.diagnosis.diagnosing import Diagnosis, diagnose
from corridor.diagnosis.evidence.confusability import confusability
from corridor.diagnosis.evidence.evidence import Evidence
from corridor.diagnosis.forward_selection import Course, Round
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.report import check_output
from corridor.diagnosis.report.corrected import corrected
from corridor.diagnosis.settings import Settings

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
    "Settings",
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
