"""Least-squares adjustment of a block, with exact covariances.

`adjust(block)` returns an `Adjustment`; `complete` makes start values; `similarity` and
`check_table` compare with ground points. `make_problem`, `Normal`, `Loss`, `solve` and
`Covariance` are its parts, for those who need the equations themselves; a matrix that nothing
determines is `Singular`.
"""

from corridor.adjustment.absolute_orientation import AbsoluteOrientation, lay_on_control
from corridor.adjustment.adjust import Run, adjust, complete
from corridor.adjustment.ahead import compiling_ahead
from corridor.adjustment.check_statistics import check_table
from corridor.adjustment.covariance import Covariance
from corridor.adjustment.datum import QUANTITIES
from corridor.adjustment.design import Design, Sets
from corridor.adjustment.gains import PointGains, point_gains
from corridor.adjustment.left_out import sound_part
from corridor.adjustment.linear_system import Columns, ImageRows, LinearSystem
from corridor.adjustment.matrix import Singular
from corridor.adjustment.model import (
    LOSSES,
    REFERENCE_CAMERA,
    Loss,
    Model,
    ParameterId,
    camera_of,
    listed,
)
from corridor.adjustment.normal import Normal
from corridor.adjustment.problem import make_problem
from corridor.adjustment.readjusting import gnss_of_metres
from corridor.adjustment.result import Adjustment, not_converged
from corridor.adjustment.solve import solve
from corridor.adjustment.warnings import grave, implausible
from corridor.geometry import Similarity, similarity

__all__ = [
    "LOSSES",
    "QUANTITIES",
    "REFERENCE_CAMERA",
    "Adjustment",
    "Columns",
    "Covariance",
    "Design",
    "AbsoluteOrientation",
    "ImageRows",
    "LinearSystem",
    "Loss",
    "Model",
    "Normal",
    "ParameterId",
    "PointGains",
    "Run",
    "Sets",
    "Similarity",
    "Singular",
    "adjust",
    "camera_of",
    "check_table",
    "compiling_ahead",
    "complete",
    "gnss_of_metres",
    "grave",
    "implausible",
    "lay_on_control",
    "listed",
    "make_problem",
    "not_converged",
    "point_gains",
    "similarity",
    "solve",
    "sound_part",
]
