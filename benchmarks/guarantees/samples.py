"""Good inputs, small ones, of which everything that is true is known: what the cases damage."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

import corridor
from corridor.core.camera import Camera
from corridor.core.simulation import read_plan
from corridor.tools import thermal
from corridor.tools.readout import render
from corridor.tools.thermal import simple_model
from notebooks.kit.wall import Course, Shots, Wall, simulated_maps

PROJECTS = ("bundler", "colmap", "colmap-text", "metashape", "micmac", "opensfm")
READOUT_MS = {"star": 30.0, "led": 30.0, "wheel": 40.0}
TURNS = {"star": 3.0, "wheel": 1.5}
LED_HZ = 800.0

PLAN = """\
name = "small"
axis_m = [[0, 0], [30, 12]]

[terrain]
relief_m = 3
level_m = 212

[tie_points]
per_image = 30

[ground]
control = 4
check = 2

[noise]
tie_px = 0.4
mark_px = 0.4
gnss_m = [0.02, 0.02, 0.04]
control_m = 0.005

[start]
centre_m = 0.3
rotation_deg = 0.3
points_m = 0.5

[[flight]]
name = "F1"
height_m = 50
strips = 2
offsets_m = [-12, 0]
images = 8
forward = 0.8

[[flight]]
name = "F2"
height_m = 50
strips = 1
offsets_m = [12]
images = 4
forward = 0.8
"""


def make(folder: Path, short: bool = False) -> None:
    """All of them below a folder, one a subject: what `subjects.SUBJECTS` names.

    short: without photographs of a star and a wheel.
    """
    (folder / "plan").mkdir(parents=True)
    (folder / "plan" / "plan.toml").write_text(PLAN, encoding="utf-8")
    block = corridor.simulate(read_plan(str(folder / "plan" / "plan.toml")), seed=7)
    block.licence = "none"
    block.write(folder / "block")
    _flight(block, folder / "track")
    _photographs(folder / "photographs", short)
    _series(folder / "series")
    _heat(folder / "heat")
    adjusted = corridor.adjust(block).block
    for form in PROJECTS:
        # Bundler holds no decentring: the measurements are moved to what it holds.
        kept = {"corrected": True} if form == "bundler" else {"lossy": True}
        corridor.interchange.export_project(adjusted, form, folder / form, **kept)


def _flight(block, folder):
    """A track of the antenna and the times of the images, for `corridor gnss`."""
    folder.mkdir()
    names = block.images["image"].astype(str)
    centre = np.array([block.truth["centre"][name] for name in names])
    at = block.images["time_s"].to_numpy(float)
    time = np.arange(np.ceil(at[0] - 2), at[-1] + 2, 0.5)
    time = time[np.abs(time[:, None] - at).min(axis=1) < 4.0]
    sigma, rng = np.array([0.008, 0.008, 0.015]), np.random.default_rng(7)
    xyz = np.column_stack([np.interp(time, at, column) for column in centre.T])
    xyz += sigma * rng.standard_normal(xyz.shape)
    track = pd.DataFrame({"time_s": time, "quality": 1})
    track[["x", "y", "z"]], track[["sx", "sy", "sz"]] = xyz.round(4), sigma
    track.to_csv(folder / "track.csv", index=False)
    block.images.to_csv(folder / "images.csv", index=False)
    shutil.copy(folder.parent / "block" / "block.toml", folder)


def _photographs(folder, short):
    """Of a star, a wheel and a blinking LED."""
    folder.mkdir()
    camera = Camera.from_table("small", {"width": 480, "height": 360, "f": 480.0})
    view = render.View(camera, 1.0)
    drawn = {
        "star": (render.star, {"sectors": 16, "radius": 0.3}),
        "wheel": (render.wheel, {"radius": 0.3, "spokes": 24, "crosses": 2, "spoke_width": 0.006}),
    }
    for name, (draw, more) in () if short else drawn.items():
        shutter = render.Shutter(READOUT_MS[name] / 1e3, 0.0003)
        for seed, (word, turns) in enumerate((("still", 0.0), ("turning", TURNS[name]))):
            light = draw(view, shutter, turns, phase_deg=10.0 + 7 * seed, **more)
            grey = render.develop(light, noise=0.005, blur_px=0.5, seed=seed)
            cv2.imwrite(str(folder / f"{name}_{word}.png"), grey)
    light = render.led(camera, render.Shutter(READOUT_MS["led"] / 1e3, 0.0003), LED_HZ)
    cv2.imwrite(str(folder / "led.jpg"), render.develop(light, noise=0.01, seed=2))


def _series(folder):
    """Six pictures of a wall by a camera that warms and cools."""
    model = simple_model(176, 176, 24.0, (24.0, 48.0), scale=(8e-5,), shift=((-0.02, 0.03),))
    course = Course(np.linspace(0, 1500, 6), off_s=750)
    Shots(Wall(176, 176, seed=3), course, model).write(folder)


def _heat(folder):
    """Maps, the model that was fitted to them, and points to be shifted."""
    folder.mkdir()
    model = simple_model(176, 176, 24.0, (24.0, 48.0), scale=(8e-5,), shift=((-0.02, 0.03),))
    course = Course(np.linspace(0, 1800, 14), off_s=900)
    maps = simulated_maps(course, model, 0.003, seed=1)
    maps.write(folder / "maps.npz")
    thermal.fit(maps).model.write(folder / "model.json")
    x, y = np.meshgrid(np.linspace(5, 150, 5), np.linspace(5, 110, 4))
    points = pd.DataFrame({"x": x.ravel(), "y": y.ravel(), "temperature_c": 40.0})
    points.to_csv(folder / "points.csv", index=False)
