"""Many blocks with one question: adjusted or diagnosed on all cores or a cluster, one table.

`corridor.batch("adjust", blocks, output)` returns a `BatchResult`, a `Row` a block.
"""

from corridor.tools.batch.result import MARK, BatchResult
from corridor.tools.batch.row import Row
from corridor.tools.batch.running import batch

__all__ = ["MARK", "BatchResult", "Row", "batch"]
