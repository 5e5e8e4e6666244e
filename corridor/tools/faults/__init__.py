"""A small copy of a block that shows a fault and can be given to strangers.

corridor.faults.report("BLOCK", "adjust --effect gnss_bias", "out/fault")
corridor.faults.anonymous(block)
"""

from corridor.core.registry import offered
from corridor.tools.faults.anonymous import anonymous
from corridor.tools.faults.reduction import Fault, report

__all__ = offered(globals())
