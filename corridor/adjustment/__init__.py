"""Least-squares adjustment of a block, with exact covariances.

`adjust(block)` returns an `Adjustment`; `complete` makes start values; `similarity` and
`check_table` compare with ground points. `make_problem`, `Normal`, `Loss`, `solve` and
`Covariance` are its parts, for those who need the equations themselves.
"""

from corridor.adjustment.adjust import adjust
from corridor.adjustment.covariance import Covariance
from corridor.adjustment.initial import complete
from corridor.adjustment.normal import Loss, Normal
from corridor.adjustment.problem import make_problem
from corridor.adjustment.report import save
from corridor.adjustment.result import Adjustment
from corridor.adjustment.similarity import Similarity, check_table, similarity
from corridor.adjustment.solve import solve

__all__ = [
    "Adjustment",
    "Covariance",
    "Loss",
    "Normal",
    "Similarity",
    "adjust",
    "check_table",
    "complete",
    "make_problem",
    "save",
    "similarity",
    "solve",
]
