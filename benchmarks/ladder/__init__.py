"""Ladder of sizes: dirty blocks of 12 to 2,500 images in which no effect of the catalogue hides."""

from .blocks import Dirt, Rung, double, made

__all__ = ["Dirt", "Rung", "double", "made"]
