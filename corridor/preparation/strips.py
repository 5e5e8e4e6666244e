"""The strips of a block, for leaving them out one at a time."""

from __future__ import annotations

import numpy as np

from corridor.block import Block
from corridor.preparation.velocity import track_runs

MOST_STRIPS, LEAST_IN_STRIP = 12, 3


def strips_of(block: Block) -> list[tuple[str, np.ndarray]]:
    """Name and rows of images.csv of each strip, for leaving them out one at a time.

    At most twelve, neighbours in time joined; strips that are too few are halved until there are
    four, as long as a part has three images.
    """
    time = block.column("images", "time_s")
    time = np.where(np.isfinite(time), time, np.arange(len(time)))
    place = block.numbers("images", *"xyz")
    runs = sorted(track_runs(block, time, place, []), key=lambda rows: time[rows].min())
    joined: list[np.ndarray] = []
    for rows in runs:
        if joined and min(len(rows), len(joined[-1])) < LEAST_IN_STRIP:
            joined[-1] = np.concatenate([joined[-1], rows])
        else:
            joined.append(rows)
    while len(joined) < 4:
        at = int(np.argmax([len(rows) for rows in joined]))
        if len(joined[at]) < 2 * LEAST_IN_STRIP:
            break
        joined[at : at + 1] = np.array_split(joined[at], 2)
    if len(joined) > MOST_STRIPS:
        parts = np.array_split(np.arange(len(joined)), MOST_STRIPS)
        joined = [np.concatenate([joined[n] for n in part]) for part in parts]
    names = block.images["image"].astype(str).to_numpy()
    return [(f"{names[rows[0]]} to {names[rows[-1]]}", rows) for rows in joined]
