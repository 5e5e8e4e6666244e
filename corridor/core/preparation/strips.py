"""The strips of a block, as images.csv names them or as it was flown."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from corridor.core.block import Block

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


def track_runs(
    block: Block, time: np.ndarray, position: np.ndarray, notes: list[str]
) -> Iterator[np.ndarray]:
    """Rows of images.csv in order of time, one array a strip, camera and flight.

    time: (images,) s; position: (images, 3) m, looked at where no strips are named. notes:
    receives what was wrong with the time stamps.
    """
    images = block.images
    strip = images["strip"] if "strip" in images else pd.Series([None] * len(images))
    named = strip.notna().all()
    keys = [block.image_flight, pd.factorize(images["camera"])[0]]
    keys.append(pd.factorize(strip)[0] if named else np.zeros(len(images), int))
    _, group = np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)
    group = group.ravel()
    for flight in np.unique(group):
        rows = np.flatnonzero(group == flight)
        order = np.argsort(time[rows], kind="stable")
        if (np.diff(order) < 0).any():
            notes.append(
                f"Images of flight {block.flight_names[block.image_flight[rows[0]]]} do not stand "
                "in the order of their time stamps: they are put in that order."
            )
        rows = rows[order]
        if named or len(rows) < 3:
            yield rows
        else:
            yield from np.split(rows, _turns(time[rows], position[rows]))
    if not named:
        notes.append("images.csv has no strips: flights are cut where they turn or pause.")
    spans = {f: (time[block.image_flight == f].min(), time[block.image_flight == f].max())
             for f in np.unique(block.image_flight)}  # fmt: skip
    ordered = sorted(spans.values())
    if any(a[1] > b[0] for a, b in zip(ordered[:-1], ordered[1:], strict=True)):
        notes.append("Time stamps of several flights interleave: each flight stands for itself.")


def _turns(time, position):
    """Where a flight is cut: the direction turns by more than 45 degrees, or it pauses."""
    step, dt = np.diff(position, axis=0), np.diff(time)
    usual = np.median(np.linalg.norm(step, axis=1))
    direction = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    bend = np.concatenate([[1.0], np.sum(direction[1:] * direction[:-1], axis=1)])
    long = (dt > 4 * max(np.median(dt), 1.0)) | (np.linalg.norm(step, axis=1) > 4 * usual)
    # The way from strip to strip bends at both its ends: it is one cut, not two.
    cuts: list[int] = []
    for step_number in np.flatnonzero(long | (bend < np.cos(np.pi / 4))).tolist():
        if not cuts or step_number > cuts[-1] + 1:
            cuts.append(step_number)
    return np.array(cuts, dtype=int) + 1
