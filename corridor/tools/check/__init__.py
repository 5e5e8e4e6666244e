"""One call from a project to an answer: is it good enough, what is wrong, what to take back.

print(corridor.check.check_project("river.psx", "out/river", required=0.02))
"""

from corridor.core.registry import offered
from corridor.tools.check.checking import Checked, check_project

__all__ = offered(globals())
