"""Velocities from positions, whose errors are independent of what they say.

The mean velocity between the positions before and after an image is exact but for the noise of
the positions, and what shakes a drone faster than it takes photographs is not in it: a regression
on it is not drawn to zero (Berkson's errors), but it is flatter than the truth where the drone
brakes. The slope of a smooth curve through all positions follows a brake, and makes waves of what
shakes the drone. The mean is taken; what the slope differs from it by is an error of one sigma that
all images have in common, for nobody knows how much of it is true.

Where time stamps are rounded, the positions say whether the times are as regular as the stamps
allow (`_off_the_clock`).

Source: Carroll et al. 2006, section 1.4 (Berkson's errors, and why they do not attenuate).
"""

import numpy as np
import pandas as pd
from scipy.sparse import block_array, diags_array, eye_array

from corridor.core.block import SIGMAS, Block
from corridor.core.geometry import robust_scale, robust_scale_of_lengths
from corridor.core.gnss import Antenna, Interpolated, interpolate, of_block
from corridor.core.preparation.strips import track_runs

# No drone and no survey aeroplane flies faster; wrong time stamps easily do.
FASTEST_M_S = 120.0
# Steps of clocks that write whole seconds, halves, tenths.
_STEPS = (1.0, 0.5, 0.1)
# In a tenth of a second a drone flies some decimetres, as much as gusts take it along: its stamps
# say enough for the stated deviations of its positions to count. Coarser ones do not.
_FINE_S = 0.1
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
# An interval so many times the usual one is a pause, which is no part of any rhythm.
_PAUSE = 3.0
# What it costs to leave a stamp, beside what it costs to change the interval: settles ties only.
_STAY = 0.01
# Of positions that are written to a centimetre.
_LEAST_SCATTER_M = 0.01
# One scatter is smaller than another where chance does not make it so: medians of some twenty
# differ by a third.
_CLEARLY = 0.6
# Images whose stamps are made regular together.
_TOGETHER = 400
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
    time = block.column("images", "time_s").copy()
    cameras = pd.factorize(block.images["camera"])[0]
    path = block.image_flight * (cameras.max() + 1) + cameras
    out = np.full((len(time), 9), np.nan)
    step = rounding(time)
    if step:
        stated, sigma = sigma, np.full(place.shape, np.nan)
        late = np.zeros(len(time), bool)
        for one in np.unique(path):
            rows = np.flatnonzero((path == one) & np.isfinite(place).all(axis=1))
            rows = rows[np.argsort(time[rows], kind="stable")]
            if len(rows) > 2:
                known = stated[rows] if stated is not None and step <= _FINE_S else None
                time[rows], sigma[rows], late[rows] = _off_the_clock(
                    time[rows], place[rows], known, step
                )
        # At times that hold, positions say themselves how they scatter, but for fine stamps.
        sigma = sigma if late.any() or (stated is not None and step <= _FINE_S) else None
    columns = {"time_s": time, **dict(zip("xyz", place.T, strict=True))}
    if sigma is not None:
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
    for rows in track_runs(block, time, smooth[:, :3], []):
        if step and late[rows].any():
            # Photographs that were taken some time after their positions: the slope of the whole.
            out[rows, 3:6] *= _BRAKES
            continue
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
    # What noise of the positions makes of it.
    step = np.diff(time)[:, None]
    both = (sigma[1:] ** 2 + sigma[:-1] ** 2) / step**2
    blur = both[1:] + both[:-1] + 2 * sigma[1:-1] ** 2 / (step[1:] * step[:-1])
    if not len(change):
        change, blur = np.full((1, 3), _ANY_CHANGE**2), np.zeros((1, 3))
    # Where it brakes, it brakes for longer than an interval; gusts blow all along.
    near = change - blur
    near = np.vstack([near[:1], near, near[-1:]])[: max(count, 2)]
    near = np.maximum((near[before] + near + near[after]) / 3, 0.0)
    share = np.full((count, 1), _BETWEEN)
    share[[0, -1]] = _AT_END
    usual = np.median(change, axis=0) / _MEDIAN_OF_SQUARE - np.median(blur, axis=0)
    own = np.sqrt(noise + share * (near + np.maximum(usual, 0.0)) / 2)
    return np.hstack([mean, own, slope - mean])


def _off_the_clock(stamps: np.ndarray, place: np.ndarray, stated: np.ndarray | None, step: float):
    """Times (n,) s of positions (n, 3) whose sorted stamps are rounded to `step` s, standard
    deviations (n, 3) m of positions at these times, and whether photographs have other times.

    stated (n, 3): deviations of the positions, m. What they scatter along their way more than
    across it is what the times are off.

    A timer makes even intervals: where positions scatter less about an even flight at times as
    regular as the stamps allow, these are the times. Where they scatter less at the stamps, they
    are of the stamps, as of a receiver that writes one position a second: each photograph was
    taken within a step of its own, and what a drone flies meanwhile counts as an error of its
    position, along its way.
    """
    parts = np.array_split(stamps, max(1, -(-len(stamps) // _TOGETHER)))
    regular = np.concatenate([unrounded(part, step) for part in parts])
    # Where stamps are equal, something lies between them.
    least = np.arange(len(stamps)) * 1e-3 * step
    stamps, regular = (np.maximum.accumulate(time - least) + least for time in (stamps, regular))
    by_stamps, along, across, way = *_scatter(stamps, place)[:1], *_scatter(regular, place)
    late = by_stamps < _CLEARLY * along
    if late:
        _, across, way = _scatter(stamps, place)
        speed = np.linalg.norm(np.diff(place, axis=0), axis=1) / np.maximum(np.diff(stamps), step)
        along = float(np.median(speed)) * step / np.sqrt(12)
    elif stated is not None:
        along, across = np.sqrt(max(along**2 - across**2, 0.0)), np.nan_to_num(stated)
    return stamps if late else regular, np.hypot(across, np.abs(way) * along), late


def _scatter(time: np.ndarray, place: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Standard deviation, m, of positions along and across their way about an even flight between
    their neighbours, and the direction of the way at each (n, 3), shorter where it was slower."""
    share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    off = place[1:-1] - (1 - share) * place[:-2] - share * place[2:]
    off /= np.sqrt(1 + share**2 + (1 - share) ** 2)
    way = np.zeros_like(place)
    way[1:-1] = (place[2:] - place[:-2]) / (time[2:] - time[:-2])[:, None]
    way[[0, -1]] = way[[1, -2]]
    speed = np.linalg.norm(way, axis=1)[:, None]
    usual = max(float(np.median(speed)), 1e-9)
    unit = way / np.maximum(speed, 1e-9)
    along = np.einsum("ni,ni->n", off, unit[1:-1])
    across = np.linalg.norm(off - along[:, None] * unit[1:-1], axis=1)
    moving = speed[1:-1, 0] > usual / 2
    return (
        float(robust_scale(along[moving])),
        robust_scale_of_lengths(across[moving], _LEAST_SCATTER_M),
        unit * np.minimum(speed / usual, 1.0),
    )


def unrounded(stamps: np.ndarray, step: float) -> np.ndarray:
    """Times (n,) s within half a rounding step of sorted stamps, as regular as they can be.

    A timer, or a steady flight past even distances, makes even intervals: of all times that
    stamps of `step` seconds allow, these change their interval least, by the sum of amounts, but
    for pauses. A constant offset stays: whether a camera rounds or cuts off is unknown. The stamps
    themselves where there are fewer than three.
    """
    stamps = np.asarray(stamps, dtype=float)
    count = len(stamps)
    if count < 3:
        return stamps
    from scipy.optimize import linprog  # at first use: few stamps are rounded

    interval = np.diff(stamps)
    usual = max(float(np.mean(interval[interval <= _PAUSE * np.median(interval) + step])), 0.1)
    pause = interval > _PAUSE * usual + step
    weight = np.where(pause[1:] | pause[:-1], 0.0, 1.0)
    since = stamps - stamps[0]
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    order = diags_array([1.0, -1.0], offsets=[0, 1], shape=(count - 1, count))
    one, other = eye_array(count - 2), eye_array(count)
    # |bend t| and |t - stamp| are below what is to become small; times stand in order.
    rows = block_array(
        [
            [bend, -one, None], [-bend, -one, None],
            [other, None, -other], [-other, None, -other],
            [order, None, None],
        ]
    )  # fmt: skip
    most = np.concatenate(
        [np.zeros(2 * (count - 2)), since, -since, np.full(count - 1, -0.05 * step)]
    )
    cost = np.concatenate([np.zeros(count), weight, np.full(count, _STAY)])
    bounds = [(t - step / 2, t + step / 2) for t in since] + [(0, None)] * (2 * count - 2)
    found = linprog(cost, A_ub=rows.tocsc(), b_ub=most, bounds=bounds, method="highs")
    return found.x[:count] + stamps[0] if found.success else stamps


def rounding(time: np.ndarray) -> float:
    """Step, s, of which all time stamps are multiples; 0 for finer ones."""
    known = time[np.isfinite(time)]
    if len(known) < 3:
        return 0.0
    return next((q for q in _STEPS if np.allclose(known / q, np.round(known / q), atol=1e-6)), 0.0)
