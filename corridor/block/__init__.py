"""The block: one flight, or several, as plain tables. Read, check, select, write, summarise."""

from corridor.block.block import Block, read
from corridor.block.record import forget_correction, record_correction, taken_out
from corridor.block.summary import Summary

__all__ = [
    "Block",
    "Summary",
    "forget_correction",
    "read",
    "record_correction",
    "taken_out",
]
