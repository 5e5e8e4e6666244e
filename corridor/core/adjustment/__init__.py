"""Least-squares adjustment of a block, with exact covariances.

`adjust(block)` returns an `Adjustment`; `complete` makes start values; `similarity` and
`check_table` compare with ground points. `make_problem`, `Normal`, `Loss`, `solve` and
`Covariance` are its parts, for those who need the equations themselves; a matrix that nothing
determines is `Singular`.
"""

from corridor.core.adjustment.absolute_orientation import AbsoluteOrientation, lay_on_control
from corridor.core.adjustment.adjusting import Run, adjust, complete, refit
from corridor.core.adjustment.along import PrecisionAlong, read_corners
from corridor.core.adjustment.blunders import without_wild_cells
from corridor.core.adjustment.check_statistics import Parts, check_table
from corridor.core.adjustment.covariance import Covariance
from corridor.core.adjustment.datum import QUANTITIES, open_motions
from corridor.core.adjustment.design import Design, Sets
from corridor.core.adjustment.distances import END
from corridor.core.adjustment.false_matches import without_ties
from corridor.core.adjustment.fronts import (
    FrontFactor,
    Fronts,
    inverse_of,
    least_fill,
    solved,
)
from corridor.core.adjustment.left_out import adjustable_part, adjustable_part_as_seen
from corridor.core.adjustment.linear_system import Columns, ImageRows, LinearSystem
from corridor.core.adjustment.matrix import Singular
from corridor.core.adjustment.model import (
    LOSSES,
    REFERENCE_CAMERA,
    SEES_ARM_M,
    Loss,
    Model,
    ParameterId,
    Setting,
    arms_unseen,
    camera_of,
    listed,
)
from corridor.core.adjustment.normal import Normal
from corridor.core.adjustment.point_quality import without_depth
from corridor.core.adjustment.precompiling import precompiled_aside
from corridor.core.adjustment.problem import make_problem
from corridor.core.adjustment.readjusting import gnss_of_metres
from corridor.core.adjustment.regression import PointRegression, point_regression
from corridor.core.adjustment.reliability import ALPHA, critical
from corridor.core.adjustment.result import Adjustment, not_converged
from corridor.core.adjustment.snooping import Blunder, blunders
from corridor.core.adjustment.solving import solve
from corridor.core.adjustment.turns import with_turns_as_seen
from corridor.core.adjustment.uncertain_motion import MotionScale, as_seen
from corridor.core.adjustment.warnings import (
    different_arms,
    grave,
    implausible,
    may_be_zero,
    tested_by,
)
from corridor.core.geometry import Similarity, similarity
