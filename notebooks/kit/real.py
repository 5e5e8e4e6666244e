"""The real flights that chapters look at. Their data are not part of the project."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
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


def slow_ones(block: Block, speed: float) -> np.ndarray:
    """(images,) whether an image was taken more slowly than so many m/s."""
    return np.linalg.norm(block.images[["vx", "vy", "vz"]].to_numpy(float), axis=1) < speed


def without_images(block: Block, left_out: np.ndarray) -> Block:
    """The block without some images (images,), nor points that fewer than two others see."""
    block = block.copy()
    block.images = block.images[~left_out].reset_index(drop=True)
    kept = set(block.images["image"].astype(str))
    for table in ("tie_points", "marks", "gnss"):
        rows = getattr(block, table)
        setattr(block, table, rows[rows["image"].astype(str).isin(kept)].reset_index(drop=True))
    rays = block.tie_points.groupby("point", observed=True)["image"].transform("size")
    block.tie_points = block.tie_points[rays >= 2].reset_index(drop=True)
    return block
