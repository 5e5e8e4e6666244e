"""Small blocks of two strips there and back, made row by row with a projection of their own.

A drone that flies at one speed, at another on the way back, or speeds up and brakes on each strip;
gusts shake it. Velocities are given, as they were at the exposures, or left out: then they follow
from positions. `random` is how gusts are made: `wind`, a process of continuous velocity that lasts
some seconds; `steps`, by which positions are shifted independently and of which the velocities are
the means between neighbours, so that nothing is lost between two photographs.
"""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from corridor.core.block import VELOCITY, read

READOUT, WIDTH, HEIGHT, F = 0.033, 2000, 1500, 1500.0
_NADIR = {"A": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], "B": [[0, 1, 0], [1, 0, 0], [0, 0, -1]]}
_IMAGES, _EVERY_S, _FINE_S = 10, 2.1, 0.05
# Speeds of the two strips, m/s.
KINDS = {"one speed": (5.0, 5.0), "two speeds": (3.0, 6.0), "braking": (5.0, 5.0)}
# Gusts: standard deviation, m/s, and correlation time, s, of the wind; shifts of single steps, m.
_GUST_M_S, _LASTS_S, _SHIFT_M = (0.3, 0.3, 0.15), 2.0, 0.3
# Of the share of its speed at which a drone enters and leaves a strip, and how long that takes, s.
_SLOW, _RAMP_S = 0.3, 5.0


def _way(rng, kind, random, speed, time):
    """Positions and velocities (n, 3) at times on a strip along x."""
    fine = np.arange(-2 * _EVERY_S, time[-1] + 2 * _EVERY_S, _FINE_S)
    along = np.full(len(fine), speed)
    if kind == "braking":
        from_end = np.clip(np.minimum(fine, time[-1] - fine) / _RAMP_S, 0, 1)
        along = speed * (_SLOW + (1 - _SLOW) * from_end)
    velocity = np.stack([along, 0 * fine, 0 * fine], axis=1)
    if random == "wind":
        keep = np.exp(-_FINE_S / _LASTS_S)
        gust = np.zeros((len(fine), 3))
        gust[0] = rng.standard_normal(3)
        for n, blow in enumerate(rng.standard_normal((len(fine) - 1, 3))):
            gust[n + 1] = keep * gust[n] + np.sqrt(1 - keep**2) * blow
        velocity = velocity + gust * _GUST_M_S
    way = np.cumsum(velocity, axis=0) * _FINE_S
    at = lambda values: np.stack([np.interp(time, fine, v) for v in values.T], axis=1)  # noqa: E731
    way, velocity = at(way), at(velocity)
    way -= way[0]
    if random == "steps":
        way += _SHIFT_M * rng.standard_normal(way.shape)
        velocity = np.gradient(way, time, axis=0)
    return way + [0, 0, 60], velocity


def _seen(centre, rotation, velocity, points):
    """Pixels of points whose rows are read one after the other, and which lie in the picture."""
    row = np.zeros(len(points))
    for _ in range(8):
        at = centre + READOUT * row[:, None] * velocity
        x, y, depth = ((points - at) @ rotation.T).T
        x, y = (WIDTH - 1) / 2 + F * x / depth, (HEIGHT - 1) / 2 + F * y / depth
        row = y / (HEIGHT - 1) - 0.5
    inside = (x > 0) & (x < WIDTH - 1) & (y > 0) & (y < HEIGHT - 1)
    return np.stack([x, y], axis=1), inside


def flown(folder, seed, kind="one speed", random="steps", derived=True):
    """A block in a folder; positions to 2 cm every 2.1 s."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind), random == "wind", derived])
    rows, centres, velocities, rotations = [], [], [], []
    for flight, speed in zip("AB", KINDS[kind], strict=True):
        time = _EVERY_S * np.arange(_IMAGES)
        way, velocity = _way(rng, kind, random, speed, time)
        back = flight == "B"
        centres.append(way * [-1, 1, 1] + [95, 10, 0] if back else way + [0, -10, 0])
        velocities.append(velocity * [-1, 1, 1] if back else velocity)
        for n, t in enumerate(time):
            rows.append((f"{flight}{n}.jpg", "C", flight, t + 40.3 * back))
            tilt = Rotation.from_rotvec(0.01 * rng.standard_normal(3)).as_matrix()
            rotations.append(tilt @ np.array(_NADIR[flight], float))
    centres, velocities = np.concatenate(centres), np.concatenate(velocities)
    images = pd.DataFrame(rows, columns=["image", "camera", "flight", "time_s"])
    images[["x", "y", "z"]] = centres + 0.3 * rng.standard_normal(centres.shape)
    x, y, z, w = Rotation.from_matrix(np.array(rotations)).as_quat().T
    images[["qw", "qx", "qy", "qz"]] = np.stack([w, x, y, z], axis=1)
    if not derived:
        images[list(VELOCITY)] = velocities
    ground = np.stack(
        [rng.uniform(-25, 125, 140), rng.uniform(-45, 45, 140), rng.standard_normal(140)], axis=1
    )
    measured = []
    for n, name in enumerate(images["image"]):
        pixel, inside = _seen(centres[n], rotations[n], velocities[n], ground)
        pixel = pixel + 0.25 * rng.standard_normal(pixel.shape)
        measured += [(f"P{k}", name, *pixel[k]) for k in np.flatnonzero(inside)]
    ties = pd.DataFrame(measured, columns=["point", "image", "x", "y"])
    ties = ties[ties["point"].map(ties["point"].value_counts()) > 1]
    points = pd.DataFrame(ground + 0.3 * rng.standard_normal(ground.shape), columns=["x", "y", "z"])
    points.insert(0, "point", [f"P{k}" for k in range(len(ground))])
    sigma = np.array([0.02, 0.02, 0.04])
    gnss = images[["image"]].copy()
    gnss[["x", "y", "z"]] = centres + sigma * rng.standard_normal(centres.shape)
    gnss[["sx", "sy", "sz"]] = sigma
    points = points[points["point"].isin(ties["point"])]
    tables = {"images": images, "tie_points": ties, "points": points, "gnss": gnss}
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    (folder / "block.toml").write_text(
        f'name = "made"\n[sigma]\ntie_px = 0.25\n'
        f"[camera.C]\nwidth = {WIDTH}\nheight = {HEIGHT}\nf = {F}\n"
    )
    return read(folder)
