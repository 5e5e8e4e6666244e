"""A readout beside velocities that are derived from positions: neither drawn to zero nor too sure.

The blocks are made here, row by row, with their own projection.
"""

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import corridor
from corridor.core.adjustment import make_problem
from corridor.core.block import VELOCITY, read
from corridor.core.effects import VELOCITY_SIGMA

READOUT, WIDTH, HEIGHT, F = 0.033, 2000, 1500, 1500.0
NADIR = {"A": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], "B": [[0, 1, 0], [1, 0, 0], [0, 0, -1]]}


def seen(centre, rotation, velocity, points):
    """Pixels of points whose rows are read one after the other."""
    row = np.zeros(len(points))
    for _ in range(8):
        at = centre + READOUT * row[:, None] * velocity
        x, y, depth = ((points - at) @ rotation.T).T
        x, y = (WIDTH - 1) / 2 + F * x / depth, (HEIGHT - 1) / 2 + F * y / depth
        row = y / (HEIGHT - 1) - 0.5
    inside = (x > 0) & (x < WIDTH - 1) & (y > 0) & (y < HEIGHT - 1)
    return np.stack([x, y], axis=1), inside


def flown(folder, seed, speeds=(5.0, 5.0), shaken=0.3, derived=True):
    """Two strips there and back, positions to 2 cm every 2.1 s; velocities given, or not."""
    rng = np.random.default_rng(seed)
    rows, centres, velocities, rotations = [], [], [], []
    for flight, speed in zip("AB", speeds, strict=True):
        time = 2.1 * np.arange(10)
        way = np.stack([speed * time, 0 * time, 60 + 0 * time], axis=1)
        way += shaken * rng.standard_normal(way.shape)
        way = way * [1, 1, 1] + [0, -10, 0] if flight == "A" else way * [-1, 1, 1] + [95, 10, 0]
        centres.append(way)
        velocities.append(np.gradient(way, time, axis=0))
        for n, t in enumerate(time):
            rows.append((f"{flight}{n}.jpg", "C", flight, t + (0 if flight == "A" else 40.3)))
            tilt = Rotation.from_rotvec(0.01 * rng.standard_normal(3)).as_matrix()
            rotations.append(tilt @ np.array(NADIR[flight], float))
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
        pixel, inside = seen(centres[n], rotations[n], velocities[n], ground)
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


def readout(block):
    found = corridor.adjust(block, camera="f,cx,cy,k1", effects=["rolling_shutter"])
    row = found.effects.iloc[0]
    return row["value"], row["sigma"], found


@pytest.mark.parametrize("speeds", [(5.0, 5.0), (3.0, 6.0)])
def test_errors_are_as_large_as_their_sigmas(tmp_path, speeds):
    """Sixteen blocks: the mean error within three of its own sigmas, their size within 40 %."""
    pulls = []
    for seed in range(16):
        value, sigma, _ = readout(flown(tmp_path, seed, speeds))
        pulls.append((value - READOUT) / sigma)
    assert abs(np.mean(pulls)) < 3 / np.sqrt(16)
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_uncertain_velocities_tell_less_than_exact_ones(tmp_path):
    exact, uncertain = (readout(flown(tmp_path, 1, derived=one))[1] for one in (False, True))
    assert uncertain > 1.1 * exact


def test_a_stated_sigma_counts(tmp_path):
    """The same velocities, believed to the centimetre a second and to a metre a second."""
    block = flown(tmp_path, 2, derived=False)
    sigmas = []
    for stated in (0.01, 1.0):
        block.put("images", VELOCITY_SIGMA, np.full((len(block.images), 3), stated))
        problem = make_problem(block, effects=["rolling_shutter"])
        assert problem.per_image_prior[1].min() == pytest.approx((0.03 * stated) ** -2)
        sigmas.append(readout(block)[1])
    assert sigmas[1] > sigmas[0]


def test_errors_of_velocities_stand_in_no_table(tmp_path):
    found = readout(flown(tmp_path, 3))[2]
    assert set(found.effects["slug"]) == {"rolling_shutter"}
    assert len(found.problem.beside) == 2
