"""The real flights that chapters look at. Their data are not part of the project."""

from __future__ import annotations

import os
from pathlib import Path

from benchmarks.diagnosis import real_noise
from corridor.core.block import Block

# As the chapters are run: in the folder of the notebooks.
DATA = Path(os.environ.get("CORRIDOR_DATA", "../../shared/data"))


def special_plot() -> Block | None:
    """76 photographs of a Phantom 4, velocities from their own headers; None where they are not."""
    there = (DATA / "special_plot" / "block").exists()
    return real_noise.special_plot(DATA) if there else None
