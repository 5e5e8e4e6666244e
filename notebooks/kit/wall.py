"""Pictures of a textured wall as a warming camera takes them.

The wall is made of blobs. A deformation moves the blobs, no picture is resampled: what lies at
(x, y) in the undeformed picture lies at exactly (x + dx, y + dy) in the deformed one.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.core.engine.compiled import compiled
from corridor.core.errors import InputError
from corridor.tools.thermal import Maps, ThermalModel, measure_maps

Deformation = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@compiled()
def _paint(light, x, y, sigma, height):
    rows, columns = light.shape
    line = np.empty(64)
    for n in range(len(x)):
        reach = min(int(4.5 * sigma[n]) + 1, 31)
        cx, cy = int(np.floor(x[n] + 0.5)), int(np.floor(y[n] + 0.5))
        factor = -0.5 / sigma[n] ** 2
        left, right = max(cx - reach, 0), min(cx + reach, columns - 1)
        for c in range(left, right + 1):
            line[c - left] = height[n] * math.exp(factor * (c - x[n]) ** 2)
        for r in range(max(cy - reach, 0), min(cy + reach, rows - 1) + 1):
            down = math.exp(factor * (r - y[n]) ** 2)
            for c in range(left, right + 1):
                light[r, c] += line[c - left] * down


@dataclass(frozen=True)
class Wall:
    """A wall that fills the picture.

    width, height: px. blob_px: smallest and largest sigma of a blob, px. spacing_px: mean distance
    of blobs. contrast: standard deviation of the picture, grey levels; level: its mean.
    """

    width: int
    height: int
    blob_px: tuple[float, float] = (0.8, 1.2)
    spacing_px: float = 3.5
    contrast: float = 28.0
    level: float = 120.0
    seed: int = 0

    def light(self, deformation: Deformation | None = None) -> np.ndarray:
        """Grey values (height, width) float64 without any noise, not rounded."""
        draw = np.random.default_rng([self.seed, 1])
        edge = 40.0  # blobs that a deformation can bring in
        area = (self.width + 2 * edge) * (self.height + 2 * edge)
        count = int(area / self.spacing_px**2)
        x = draw.uniform(-edge, self.width + edge, count)
        y = draw.uniform(-edge, self.height + edge, count)
        sigma = draw.uniform(*self.blob_px, count)
        tall = draw.choice([-1.0, 1.0], count) * draw.uniform(0.5, 1.0, count)
        # Variance of a field of random blobs: density * mean square height * pi sigma^2.
        share = np.sqrt(np.pi * np.mean(tall**2 * sigma**2)) / self.spacing_px
        if deformation is not None:
            dx, dy = deformation(x, y)
            x, y = x + dx, y + dy
        light = np.full((self.height, self.width), self.level)
        _paint(light, x, y, sigma, tall * (self.contrast / share))
        return light


@dataclass(frozen=True)
class Sensor:
    """What a camera makes of light.

    noise: grey levels, new in each picture. fixed_pattern: grey levels, the same in all pictures.
    vignetting: share of light lost in the corners. gain: factor on the light. tilt: change of
    light from the left edge to the right, as a share. blur_px: sigma.
    """

    noise: float = 2.0
    fixed_pattern: float = 0.0
    vignetting: float = 0.0
    gain: float = 1.0
    tilt: float = 0.0
    blur_px: float = 0.0
    seed: int = 0

    def take(self, light: np.ndarray, shot: int = 0) -> np.ndarray:
        """The picture (height, width) uint8; shot: number that makes its noise its own."""
        height, width = light.shape
        x = np.linspace(-1, 1, width)
        y = np.linspace(-1, 1, height)[:, None]
        factor = self.gain * (1 + self.tilt * x / 2) * (1 - self.vignetting * (x**2 + y**2) / 2)
        grey = light * factor
        if self.blur_px:
            grey = cv2.GaussianBlur(grey, (0, 0), self.blur_px)
        if self.fixed_pattern:
            own = np.random.default_rng([self.seed, 2])
            grey = grey + self.fixed_pattern * own.standard_normal(grey.shape, dtype=np.float32)
        if self.noise:
            draw = np.random.default_rng([self.seed, 3, shot])
            grey = grey + self.noise * draw.standard_normal(grey.shape, dtype=np.float32)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Course:
    """Temperatures of a camera that is switched on, and off again.

    times_s: (n,) of the pictures. The optics follow the sensor through a first-order lag of lag_s.
    """

    times_s: np.ndarray
    cold_c: float = 24.0
    hot_c: float = 50.0
    constant_s: float = 400.0
    off_s: float = math.inf
    lag_s: float = 0.0
    rounding_c: float = 0.0

    def sensor(self, times_s: np.ndarray | None = None) -> np.ndarray:
        """Temperature of the sensor (n,), C: exponential towards hot, from off_s on to cold."""
        times = np.asarray(self.times_s if times_s is None else times_s, dtype=float)
        span = self.hot_c - self.cold_c
        t = np.maximum(times, 0.0)
        rising = self.cold_c + span * (1 - np.exp(-t / self.constant_s))
        if not math.isfinite(self.off_s):
            return rising
        peak = span * (1 - np.exp(-self.off_s / self.constant_s))
        falling = self.cold_c + peak * np.exp(-(t - self.off_s) / self.constant_s)
        return np.where(t <= self.off_s, rising, falling)

    def thermometer(self) -> np.ndarray:
        """What is written down (n,), C."""
        values = self.sensor()
        return np.round(values / self.rounding_c) * self.rounding_c if self.rounding_c else values

    def optics(self) -> np.ndarray:
        """Temperature of the optics (n,), C, by fine steps of the lag's equation."""
        times = np.asarray(self.times_s, dtype=float)
        if not self.lag_s:
            return self.sensor()
        fine = np.arange(0.0, times.max() + 1.0, min(self.lag_s, 20.0) / 40)
        warm = self.sensor(fine)
        follow = 1 - np.exp(-(fine[1] - fine[0]) / self.lag_s)
        out = np.empty_like(warm)
        out[0] = warm[0]
        for k in range(1, len(fine)):
            out[k] = out[k - 1] + follow * ((warm[k] + warm[k - 1]) / 2 - out[k - 1])
        return np.interp(times, fine, out)


@brief
@dataclass(frozen=True)
class Shots:
    """Pictures of a wall while the camera warms, made when they are read.

    model: what the optics do, by their true temperature. references: how many of the first
    pictures are the reference. drift: of the sensor's gain, a share from first picture to last.
    Raises InputError where wall and model have different sizes.
    """

    wall: Wall
    course: Course
    model: ThermalModel
    sensor: Sensor = field(default_factory=Sensor)
    references: int = 1
    drift: float = 0.0

    def __post_init__(self):
        wall, model = self.wall, self.model
        if (model.width, model.height) != (wall.width, wall.height):
            raise InputError(
                f"the wall has {wall.width} x {wall.height} pixels, the model {model.width} x "
                f"{model.height}: give both one size"
            )

    @property
    def picture(self) -> list[str]:
        """Names."""
        return [f"{n:04d}.png" for n in range(len(self.time_s))]

    @property
    def time_s(self) -> np.ndarray:
        """(n,) s."""
        return np.asarray(self.course.times_s, dtype=float)

    @property
    def temperature_c(self) -> np.ndarray:
        """(n,) C, as the thermometer has them."""
        return self.course.thermometer()

    @property
    def reference(self) -> np.ndarray:
        """(n,) bool."""
        return np.arange(len(self.time_s)) < self.references

    def take(self, row: int) -> np.ndarray:
        """A picture (height, width) uint8."""
        warm = self.course.optics()[row]
        gain = self.sensor.gain * (1 + self.drift * row / max(len(self.time_s) - 1, 1))
        light = self.wall.light(lambda x, y: self.model.displacement(x, y, warm))
        return replace(self.sensor, gain=gain).take(light, row)

    def read(self, row: int) -> np.ndarray:
        """A picture (height, width) float32."""
        return self.take(row).astype(np.float32)

    def write(self, folder: str | os.PathLike) -> Path:
        """Write pictures and series.csv; the truth beside FOLDER, to FOLDER.truth.json."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for row, name in enumerate(self.picture):
            cv2.imwrite(str(folder / name), self.take(row))
        table = pd.DataFrame(
            {
                "picture": self.picture, "time_s": np.round(self.time_s, 3),
                "temperature_c": np.round(self.temperature_c, 4),
                "reference": self.reference.astype(int),
            }
        )  # fmt: skip
        table.to_csv(folder / "series.csv", index=False, lineterminator="\n")
        optics = np.round(self.course.optics(), 6).tolist()
        truth = {
            "lag_s": self.course.lag_s,
            "optics_c": dict(zip(self.picture, optics, strict=True)),
            "model": self.model.to_dict(),
        }
        path = folder.parent / f"{folder.name}.truth.json"
        text = json.dumps(truth).replace(', "', ',\n "')
        path.write_text(text + "\n", encoding="utf-8", newline="\n")
        return folder

    def maps(self) -> Maps:
        """Deformation maps, without a file in between."""
        return measure_maps(self)


def simulated_maps(
    course: Course,
    model: ThermalModel,
    noise_px: float = 0.0025,
    shake_px: float = 0.0,
    columns: int = 20,
    seed: int = 0,
) -> Maps:
    """Maps with the errors of matching, but without pictures; the first one is the reference.

    noise_px: of a shift, an axis; half of its variance is the reference's, alike in all maps.
    shake_px: of each picture as a whole.
    """
    draw = np.random.default_rng([seed, 4])
    rows = max(2, round(columns * model.height / model.width))
    x, y = (
        part.ravel()
        for part in np.meshgrid(
            np.linspace(48, model.width - 49, columns), np.linspace(48, model.height - 49, rows)
        )
    )
    warm = course.optics()
    moved = np.stack(model.displacement(x, y, warm[:, None]), axis=-1)
    moved = moved - np.stack(model.displacement(x, y, warm[0]), axis=-1)
    own = noise_px / math.sqrt(2)
    moved += own * (draw.standard_normal(moved.shape) + draw.standard_normal(moved.shape[1:]))
    moved += shake_px * draw.standard_normal((len(warm), 1, 2))
    moved[0] = 0.0
    shape = moved.shape[:2]
    return Maps(
        picture=np.array([f"{n:04d}.png" for n in range(len(warm))]),
        time_s=np.asarray(course.times_s, dtype=float), temperature_c=course.thermometer(),
        reference=np.arange(len(warm)) == 0, width=model.width, height=model.height, x=x, y=y,
        dx=moved[..., 0], dy=moved[..., 1], sigma=np.full(shape, max(noise_px, 1e-4)),
        valid=np.ones(shape, dtype=bool),
    )  # fmt: skip
