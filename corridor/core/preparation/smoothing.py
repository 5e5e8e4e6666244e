"""Velocities by the smoother of `corridor.gnss`, whose drone cruises, brakes and turns."""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.block import SIGMAS, Block
from corridor.core.gnss import Interpolated, interpolate, of_block

# No drone and no survey aeroplane flies faster; wrong time stamps easily do.
FASTEST_M_S = 120.0
# Steps of clocks that write whole seconds, halves, tenths.
_STEPS = (1.0, 0.5, 0.1)
# Positions of a flight of minutes, by an ordinary receiver: about each other, not the truth.
_SCATTER_M = 0.3
# One strength of gusts for a whole flight is too small where it brakes and turns, and stamps in
# whole seconds hide where: by this factor errors exceed their sigmas, in simulated flights with
# stops (1.4) and a Phantom's (1.2 while it cruises, 1.5 where it stands).
_BRAKES = 1.4
_MOTION = ["vx", "vy", "vz", "svx", "svy", "svz"]


def of_track(block: Block) -> np.ndarray:
    """(images, 6): velocities, m/s, and their sigmas, from track.csv; NaN where it has none."""
    return motion(of_block(block).interpolated)


def of_gnss(block: Block) -> np.ndarray:
    """(images, 6): velocities, m/s, and their sigmas, from gnss.csv; NaN where it has none."""
    rows = block.image_rows("gnss")
    place, sigma = np.full((2, len(block.images), 3), np.nan)
    there = rows >= 0
    place[rows[there]] = block.numbers("gnss", *"xyz")[there]
    sigma[rows[there]] = block.gnss_sigma()[there]
    return _smoothed(block, place, sigma)


def of_poses(block: Block) -> np.ndarray:
    """(images, 6): velocities, m/s, and their sigmas, from the centres of images.csv."""
    return _smoothed(block, block.numbers("images", *"xyz"), None)


def motion(found: Interpolated) -> np.ndarray:
    """(n, 6): velocities, m/s, and their sigmas."""
    return found.table[_MOTION].to_numpy(dtype=float)


def _smoothed(block: Block, place: np.ndarray, sigma: np.ndarray | None) -> np.ndarray:
    """Velocities and their sigmas (images, 6) of positions (images, 3) at the images' times.

    NaN where a flight has too few positions, or none near. sigma: (images, 3) m; None: unknown.
    """
    time = block.column("images", "time_s")
    cameras = pd.factorize(block.images["camera"])[0]
    path = block.image_flight * (cameras.max() + 1) + cameras
    out = np.full((len(time), 6), np.nan)
    columns = {"time_s": time, **dict(zip("xyz", place.T, strict=True))}
    step = rounding(time)
    if step:
        late = _by_rounding(time, place, path, step)
        columns |= dict(zip(SIGMAS, late.T, strict=True))
    elif sigma is not None:
        columns |= dict(zip(SIGMAS, sigma.T, strict=True))
    table = pd.DataFrame(columns).assign(flight=path.astype(str))
    table = table[np.isfinite(place).all(axis=1)].sort_values(["flight", "time_s"], kind="stable")
    table = table.drop_duplicates(["flight", "time_s"])
    enough = table["flight"].map(table["flight"].value_counts()) > 1
    if not enough.any():
        return out
    found = interpolate(
        table[enough].reset_index(drop=True), time, flight=path.astype(str), max_sigma=np.inf
    )
    out = motion(found)
    if step:
        out[:, 3:] *= _BRAKES
    return out


def _by_rounding(time, place, path, step) -> np.ndarray:
    """Standard deviations (images, 3), m, of positions at times that are rounded to `step`.

    What a drone flies within a rounding error counts as an error of its position, along its way.
    """
    sigma = np.full(place.shape, _SCATTER_M)
    for one in np.unique(path):
        rows = np.flatnonzero((path == one) & np.isfinite(place).all(axis=1))
        rows = rows[np.argsort(time[rows], kind="stable")]
        if len(rows) < 2:
            continue
        before, after = rows[np.r_[0, : len(rows) - 1]], rows[np.r_[1 : len(rows), len(rows) - 1]]
        way = place[after] - place[before]
        lasted = np.maximum(time[after] - time[before], step)
        length = np.linalg.norm(way, axis=1)
        # Between neighbours the rounding makes the speed; the flight as a whole knows better.
        speed = np.minimum(length / lasted, np.median(length / lasted))
        along = np.abs(way) / np.maximum(length, 1e-9)[:, None]
        sigma[rows] = np.hypot(sigma[rows], along * speed[:, None] * step / np.sqrt(12))
    return sigma


def rounding(time: np.ndarray) -> float:
    """Step, s, of which all time stamps are multiples; 0 for finer ones."""
    known = time[np.isfinite(time)]
    if len(known) < 3:
        return 0.0
    return next((q for q in _STEPS if np.allclose(known / q, np.round(known / q), atol=1e-6)), 0.0)
