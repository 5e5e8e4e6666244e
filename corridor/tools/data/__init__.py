"""Blocks at hand: those that are shipped, and real ones from their public sources.

corridor.data.table()
corridor.data.fetch("balbianello", "out/balbianello")
"""

from corridor.core.registry import offered
from corridor.tools.data.fetching import fetch
from corridor.tools.data.registered import DataSet, register, table

__all__ = offered(globals())
