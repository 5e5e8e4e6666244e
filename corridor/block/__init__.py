"""The block: one flight, or several, as plain tables. Read, check, select, write, summarise."""

from corridor.block.block import Block, read
from corridor.block.record import forget_correction, record_correction, taken_out
from corridor.block.summary import Summary
from corridor.block.writing import check_folder, whole_folder

__all__ = [
    "Block",
    "Summary",
    "check_folder",
    "forget_correction",
    "read",
    "record_correction",
    "taken_out",
    "whole_folder",
]
