"""What is compared between a measured block and its simulated replicates.

Each statistic is a short curve or map: means or sizes of residuals over one axis on which a
physical effect would draw its signature. Residuals are cut at four usual standard deviations, so
that a statistic tells of what many observations share and not of single wrong matches.

Poses absorb most of a missing effect, yet what they absorbed cannot be told from how the camera
really flew, unless something else saw it fly: their second differences are therefore compared
with those of the antenna.
"""

from corridor.diagnosis.bootstrap.statistics.statistic import Fit, Statistic
from corridor.diagnosis.bootstrap.statistics.summary import SummaryStatistics

__all__ = ["Fit", "Statistic", "SummaryStatistics"]
