"""Errors over their stated standard deviations: 1 where what is stated is true.

Every draw makes new measurements of something that is known, and compares. An interval follows
from the scatter between draws: what is common to all numbers of a draw counts once.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from benchmarks.draws import ratio
from benchmarks.guarantees import samples
from corridor.core import gnss
from corridor.core.camera import Camera
from corridor.core.simulation import add_noise, perfect_block, read_plan
from corridor.tools import thermal
from corridor.tools.planning import Planner
from corridor.tools.readout import Photograph, measure_led, render
from corridor.tools.thermal import simple_model
from notebooks.kit.wall import Course, simulated_maps

XYZ, SXYZ = ["x", "y", "z"], ["sx", "sy", "sz"]
READOUT_S = 0.02


def run(draws: int, seed: int, say, some: Sequence[str] = ()) -> dict:
    """Every stated sigma: ratio, its interval of 95 %, and the number of draws.

    some: these kinds in place of all.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.toml"
        path.write_text(samples.PLAN, encoding="utf-8")
        plan = read_plan(str(path))
    kinds = {
        "adjust": lambda: _Adjusted(plan), "plan": lambda: _Planned(plan), "gnss": lambda: _antenna,
        "readout": lambda: _led, "thermal": lambda: _fitted, "diagnose": lambda: _diagnosed(plan),
    }  # fmt: skip
    figures = {}
    for name in some or kinds:
        sort = kinds[name]()
        begun, squares = time.process_time(), []
        for k in range(draws):
            z = np.asarray(sort(seed * 100_000 + k), float)
            z = z[np.isfinite(z)]  # a diagnosis may name nothing
            squares += [float(np.mean(z**2))] if len(z) else []
        figures[name] = _judged(np.array(squares)) | {"seconds": time.process_time() - begun}
        say(f"{name}: {figures[name]}")
    return {
        "kinds": figures, "seed": seed, "holds": all(one["holds"] for one in figures.values())
    }  # fmt: skip


def added(before: dict | None, after: dict) -> dict:
    """The figures of some kinds in the place of theirs in an earlier run."""
    kinds = (before or {}).get("kinds", {}) | after["kinds"]
    return after | {"kinds": kinds, "holds": all(one["holds"] for one in kinds.values())}


def _judged(squares) -> dict:
    """Ratio of RMS error to sigma, its interval, and whether that agrees with 0.95 to 1.05."""
    found = ratio(squares)
    return found | {
        "draws": len(squares), "holds": bool(found["low"] <= 1.05 and found["high"] >= 0.95)
    }  # fmt: skip


class _Adjusted:
    """Camera centres, points and ground points of a small block against the truth."""

    def __init__(self, plan):
        self.plan, self.block = plan, perfect_block(plan, 1)

    def noisy(self, seed):
        noise = self.plan.noise
        return add_noise(self.block, noise.tie_px, noise.mark_px, noise.gnss_m, noise.control_m,
                         seed=seed)  # fmt: skip

    def __call__(self, seed):
        found = corridor.adjust(self.noisy(seed))
        z = []
        points = pd.concat([self.block.points, self.block.ground])
        for table, name, true in (
            (found.poses, "image", self.block.images), (found.block.points, "point", points)
        ):  # fmt: skip
            known = true.set_index(name).loc[table[name], XYZ].to_numpy(float)
            z.append((table[XYZ].to_numpy(float) - known) / table[SXYZ].to_numpy(float))
        return np.concatenate(z).ravel()


class _Planned(_Adjusted):
    """Errors of check points against those that were expected before the flight."""

    def __init__(self, plan):
        super().__init__(plan)
        planner = Planner(plan)
        self.block, self.expected = planner.block, planner.expect(3)

    def __call__(self, seed):
        found = corridor.adjust(self.noisy(seed), control=list(self.expected.control))
        table = found.check_points.set_index("point")[["dx", "dy", "dz"]]
        error = table.loc[self.expected.check_points["point"]].to_numpy(float)
        xy = np.sum(error[:, :2] ** 2, axis=1).mean() / self.expected.xy**2
        z = np.mean(error[:, 2] ** 2) / self.expected.z**2
        return np.sqrt([xy, z])


def _antenna(seed):
    """Antennas between the epochs of a receiver, the drone on a smooth path.

    A share of the variance is slow, drawn from those that the interpolation takes for equally
    likely: it has to find it in the track, and its sigma is one of the true antenna.
    """
    rng = np.random.default_rng(seed)
    size, period = rng.uniform(2, 20, (3, 3)), rng.uniform(20, 80, (3, 3))
    phase = rng.uniform(0, 2 * np.pi, (3, 3))

    def path(at):
        turn = 2 * np.pi * at[:, None, None] / period + phase
        return np.array([0.0, 0.0, 50.0]) + (size * np.sin(turn)).sum(axis=1)

    epochs, sigma = np.arange(0.0, 120.0, 0.5), np.array([0.008, 0.008, 0.015])
    share = rng.choice(gnss.SLOW_SHARES)
    slow = gnss.SlowNoise(gnss.CORRELATION_S).draw(epochs, rng, 3)
    noise = np.sqrt(share) * slow + np.sqrt(1 - share) * rng.standard_normal((len(epochs), 3))
    track = pd.DataFrame({"time_s": epochs, "quality": 1})
    track[XYZ] = path(epochs) + sigma * noise
    track[SXYZ] = np.broadcast_to(sigma, (len(epochs), 3))
    at = np.sort(rng.uniform(5, 115, 40))
    made = gnss.interpolate(track, at, "smoother", max_sigma=10.0).table
    return ((made[XYZ].to_numpy(float) - path(at)) / made[SXYZ].to_numpy(float)).ravel()


def _led(seed):
    """A blinking LED's readout time, its frequency, brightness and noise at random.

    The light keeps the stated frequency as well as a quartz does: the stated sigma holds that too.
    """
    rng = np.random.default_rng(seed)
    camera = Camera.from_table("c", {"width": 480, "height": 360, "f": 480.0})
    readout, hertz = rng.uniform(0.015, 0.05), rng.uniform(400, 1200)
    shutter, kept = render.Shutter(readout, rng.uniform(1e-4, 4e-4)), rng.normal(1.0, 1e-5)
    light = render.led(camera, shutter, kept * hertz)
    grey = render.develop(light, noise=rng.uniform(0.004, 0.012), seed=seed)
    found = measure_led(Photograph("led", grey), hertz)
    return [(found.readout_ms - 1e3 * readout) / found.sigma_ms]


def _fitted(seed):
    """Shifts by a fitted thermal model against those of the true one."""
    true = simple_model(320, 240, 24.0, (24.0, 48.0), scale=(6e-5,), radial=(1e-3,),
                        shift=((-0.02, 0.03),))  # fmt: skip
    course = Course(np.linspace(0, 1800, 16), off_s=900)
    model = thermal.fit(simulated_maps(course, true, seed=seed)).model
    x, y = np.meshgrid(np.linspace(10, 310, 5), np.linspace(10, 230, 4))
    error = [
        found - (now - then)
        for found, now, then in zip(
            model.displacement(x, y, 42.0), true.displacement(x, y, 42.0),
            true.displacement(x, y, model.t0_c), strict=True,
        )
    ]  # fmt: skip
    return (np.stack(error, -1) / model.sigma(x, y, 42.0)[..., None]).ravel()


def _diagnosed(plan):
    """The value that a diagnosis states of the effect that it names, a rolling shutter of 20 ms."""
    adjusted = _Adjusted(plan)
    adjusted.block = corridor.effects.add(
        adjusted.block, {"rolling_shutter": {"readout": READOUT_S}}
    )

    def draw(seed):
        found = corridor.diagnose(adjusted.noisy(seed), only=["rolling_shutter"])
        return [
            (one["value"] - READOUT_S) / one["sigma"]
            for estimate in found.to_dict()["effects"] for one in estimate["parameters"]
        ] or [np.nan]  # fmt: skip

    return draw
