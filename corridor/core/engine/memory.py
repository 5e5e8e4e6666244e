"""Memory that is free, given back to the system."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Give back what C's library keeps for later; elsewhere than on Linux, nothing.

    It keeps every gap that lies below something in use: in a block of 1,000 images, 0.4 GB.
    """
    if sys.platform == "linux":
        # Only glibc has it.
        getattr(ctypes.CDLL(None), "malloc_trim", bool)(0)
