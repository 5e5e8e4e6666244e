"""The real flights that chapters look at. Their data are not part of the project."""

from __future__ import annotations

import os
from pathlib import Path

import pandas as pd

import corridor
from corridor.core.block import Block

# As the chapters are run: in the folder of the notebooks.
DATA = Path(os.environ.get("CORRIDOR_DATA", "../../shared/data"))


def special_plot(data: Path = DATA) -> Block | None:
    """76 photographs of a Phantom 4, velocities from their own headers; None where they are not."""
    folder = data / "special_plot"
    if not (folder / "block").exists():
        return None
    block = corridor.read(folder / "block")
    stated = pd.read_csv(folder / "metadata.csv").set_index("image")
    speed = stated.reindex(block.images["image"].astype(str))
    block.images = block.images.assign(
        vx=speed["speed_east"].to_numpy(),
        vy=speed["speed_north"].to_numpy(),
        vz=-speed["speed_down"].to_numpy(),
    )
    return block
