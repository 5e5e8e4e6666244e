"""The block: one flight, or several, as plain tables. Read, check, select, write, summarise."""

from corridor.block.block import Block, read
from corridor.block.summary import Summary
from corridor.block.writing import whole_folder

__all__ = ["Block", "Summary", "read", "whole_folder"]
