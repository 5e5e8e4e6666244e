"""Velocities from positions, whose errors are independent of what they say.

The mean velocity between the positions before and after an image is exact but for the noise of
the positions, and what shakes a drone faster than it takes photographs is not in it: a regression
on it is not drawn to zero (Berkson's errors), but it is flatter than the truth where the drone
brakes. The slope of a smooth curve through all positions follows a brake, and makes waves of what
shakes the drone. The mean is taken; what the slope differs from it by is an error of one sigma that
all images have in common, for nobody knows how much of it is true.

Source: Carroll et al. 2006, section 1.4 (Berkson's errors, and why they do not attenuate).
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from corridor.core.block import SIGMAS, Block
from corridor.core.gnss import Antenna, Interpolated, interpolate, of_block
from corridor.core.preparation.strips import track_runs

# No drone and no survey aeroplane flies faster; wrong time stamps easily do.
FASTEST_M_S = 120.0
# Steps of clocks that write whole seconds, halves, tenths.
_STEPS = (1.0, 0.5, 0.1)
# Positions of a flight of minutes, by an ordinary receiver: about each other, not the truth.
_SCATTER_M = 0.3
# Variance of the velocity about its mean over the two intervals beside it, and over one at the
# end of a strip, in squares of the difference D of the mean velocities of two neighbouring
# intervals h: a random acceleration of density q makes E D^2 = 2 q h / 3, and variances q h / 6
# and q h / 3 (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2).
_BETWEEN, _AT_END = 0.25, 0.5
# Of a squared normal deviate of unit variance.
_MEDIAN_OF_SQUARE = 0.455
# Two photographs say nothing of gusts, which change the speed of a drone by some decimetres, m/s.
_ANY_CHANGE = 0.5
# Stamps in whole seconds hide where a drone brakes: by this factor errors of the slope exceed their
# sigmas, in simulated flights with stops (1.4) and a Phantom's (1.2 cruising, 1.5 standing).
_BRAKES = 1.4
# A camera that fires every two seconds has stamps in whole seconds that are not rounded: so many of
# its intervals are the same.
_REGULAR = 0.8
_MOTION = ["vx", "vy", "vz", "svx", "svy", "svz"]


def of_track(block: Block, flown: Antenna | None = None) -> np.ndarray:
    """(images, 9): velocities, their sigmas and common error, m/s, from track.csv."""
    found = motion((flown or of_block(block)).interpolated)
    return np.hstack([found, np.zeros((len(found), 3))])


def of_gnss(block: Block) -> np.ndarray:
    """(images, 9): velocities, their sigmas and common error, m/s, from gnss.csv."""
    rows = block.image_rows("gnss")
    place, sigma = np.full((2, len(block.images), 3), np.nan)
    there = rows >= 0
    place[rows[there]] = block.numbers("gnss", *"xyz")[there]
    sigma[rows[there]] = block.gnss_sigma()[there]
    return _smoothed(block, place, sigma)


def of_poses(block: Block) -> np.ndarray:
    """(images, 9): velocities, their sigmas and common error, m/s, from poses of images.csv."""
    return _smoothed(block, block.numbers("images", *"xyz"), None)


def motion(found: Interpolated) -> np.ndarray:
    """(n, 6): velocities, m/s, and their sigmas."""
    return found.table[_MOTION].to_numpy(dtype=float)


def _smoothed(block: Block, place: np.ndarray, sigma: np.ndarray | None) -> np.ndarray:
    """Velocities, sigmas and common error (images, 9), m/s, of positions at the images' times.

    NaN where a flight has too few positions, or none near. sigma: (images, 3) m; None: unknown.
    """
    time = block.column("images", "time_s")
    cameras = pd.factorize(block.images["camera"])[0]
    path = block.image_flight * (cameras.max() + 1) + cameras
    out = np.full((len(time), 9), np.nan)
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
    out, smooth = motion(found), found.table[["x", "y", "z", *SIGMAS]].to_numpy(dtype=float)
    out = np.hstack([out, np.zeros((len(out), 3))])
    if step and not _regular(time):
        # Between neighbours the rounding makes the speed: the slope of the whole is better.
        out[:, 3:6] *= _BRAKES
        return out
    for rows in track_runs(block, time, smooth[:, :3], []):
        rows = rows[np.isfinite(smooth[rows]).all(axis=1)]
        rows = rows[np.diff(time[rows], prepend=-np.inf) > 0]
        if len(rows) > 1:
            out[rows] = _between(time[rows], smooth[rows, :3], smooth[rows, 3:], out[rows, :3])
    return out


def _between(
    time: np.ndarray, place: np.ndarray, sigma: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Velocities, their deviations, and a common error of one sigma (n, 9) of a strip, m/s.

    slope (n, 3): of the smoothed curve through all positions.
    """
    count = len(time)
    before, after = np.r_[0, : count - 1], np.r_[1:count, count - 1]
    lasted = (time[after] - time[before])[:, None]
    mean = (place[after] - place[before]) / lasted
    noise = (sigma[after] ** 2 + sigma[before] ** 2) / lasted**2
    each = np.diff(place, axis=0) / np.diff(time)[:, None]
    change = np.diff(each, axis=0) ** 2
    if not len(change):
        change = np.full((1, 3), _ANY_CHANGE**2)
    # Where it brakes, it brakes for longer than an interval; gusts blow all along.
    near = np.vstack([change[:1], change, change[-1:]])[: max(count, 2)]
    near = (near[before] + near + near[after]) / 3
    share = np.full((count, 1), _BETWEEN)
    share[[0, -1]] = _AT_END
    usual = np.median(change, axis=0) / _MEDIAN_OF_SQUARE
    own = np.sqrt(noise + share * (near + usual) / 2)
    return np.hstack([mean, own, slope - mean])


def _regular(time: np.ndarray) -> bool:
    """Whether most intervals between images are the same: an intervalometer's, not rounded."""
    lasted = np.diff(np.sort(time[np.isfinite(time)]))
    return bool(np.mean(np.isclose(lasted, np.median(lasted))) > _REGULAR)


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
