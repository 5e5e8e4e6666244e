"""Antenna positions of a block that has a track alone."""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.errors import InputError
from corridor.gnss import interpolate


def antenna_of_track(block: Block) -> tuple[pd.DataFrame, list[str]]:
    """Table gnss.csv (image, x, y, z, sx, sy, sz; m) of the exposures, and notes.

    Positions are interpolated inside a piece of the track; epochs next to a gap or a kink carry
    the standard deviation they deserve. Raises InputError where the block knows no times.
    """
    times = block.column("images", "time_s")
    known = np.isfinite(times)
    if not known.any():
        raise InputError("images.csv has no time_s, by which a track is interpolated: add it")
    names = block.images["image"].to_numpy(object)
    flights = np.array(block.flight_names, dtype=object)[block.image_flight]
    with_flight = "flight" in block.track and block.track["flight"].notna().all()
    made = interpolate(
        block.track, times[known], flight=flights[known].astype(str) if with_flight else None
    )
    good = (made.table["why"] == "").to_numpy()
    table = pd.DataFrame({"image": names[known][good]})
    columns = ["x", "y", "z", "sx", "sy", "sz"]
    table[columns] = made.table.loc[good, columns].to_numpy()
    note = (
        f"Antenna positions of {int(good.sum())} images are interpolated from the track; "
        f"{int((~good).sum() + (~known).sum())} images have none."
    )
    table["image"] = pd.Categorical(table["image"], categories=list(names))
    return table, [note, *made.notes]
