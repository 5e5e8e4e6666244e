"""What changed between two dates: the ground, or the camera?

`corridor.change(before, after)` compares two blocks and returns a `Change`: displacements of named
points, the change of the surface with the exact standard deviation of every number, volumes, and
what effects of the camera explain of it. `moved_ground` moves the ground of a measured block, by
`Settlement`, `Slide`, `Tilt` or any function of position. The parts stand alone too: `Joint` for
the covariance of whatever is linear in the points of both dates, `make_cores` and
`surface_change`, `point_changes`, `volume`, `Signatures`.
"""

import sys
import types

from corridor.core.registry import offered
from corridor.tools.change.changing import change, detection
from corridor.tools.change.comparison import Comparison, read_line
from corridor.tools.change.cores import Cores, make_cores
from corridor.tools.change.epoch import Cloud, Epoch, clouds
from corridor.tools.change.explanation import Evidence, Explanation, explain, gathered
from corridor.tools.change.joint import Joint, displacements
from corridor.tools.change.motion import Settlement, Slide, Tilt, moved_ground
from corridor.tools.change.points import PointChanges, point_changes
from corridor.tools.change.report import detection_report, detection_table, of_change, save
from corridor.tools.change.result import Change
from corridor.tools.change.sentence import remedies, verdict_sentence
from corridor.tools.change.signature import Signatures
from corridor.tools.change.significance import tested
from corridor.tools.change.surface import SurfaceChange, Volume, surface_change, volume
from corridor.tools.change.together import dates_of

__all__ = offered(globals())


class _Callable(types.ModuleType):
    """The room itself can be called: `corridor.change(before, after)`."""

    def __call__(self, before, after, **options) -> Change:
        """See `corridor.change.change`."""
        return change(before, after, **options)


sys.modules[__name__].__class__ = _Callable


def __dir__():
    return __all__
