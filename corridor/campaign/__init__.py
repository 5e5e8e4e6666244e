"""Many blocks with one question: adjusted or diagnosed on all cores or a cluster, one table.

`corridor.batch("adjust", blocks, output)` returns a `Campaign`, a `Row` a block.
"""

from corridor.campaign.batch import batch
from corridor.campaign.campaign import MARK, Campaign
from corridor.campaign.row import Row

__all__ = ["MARK", "Campaign", "Row", "batch"]
