"""DBAT's lenses, which go from the measured image point to the ray, as an effect.

With q the measured point from the principal point, mm, x right and y up, r its length, and A an
affine matrix, DBAT adjusts

    lens(q) - f (u, v) = noise,   lens(q) = q (1 + K1 r^2 + K2 r^4 + K3 r^6) + tangential(q)

Models 1 and 2 here have no A, 3 has it before the lens, 4 after it, 5 a scale of x before the
principal point is taken off. Residuals lie in the corrected picture, as in its reports.
Source: Brown 1971; Börlin and Grussenmeyer 2013 (DBAT).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

import corridor
from corridor.core.effects import Effect, Parameter
from corridor.tools.formats import read_project

NAMES = ("px", "py", "K1", "K2", "K3", "P1", "P2", "as")
# Steps of the derivatives: each moves a point by some thousandths of a pixel.
_STEPS = np.array([1e-5, 1e-5, 1e-6, 1e-7, 1e-8, 1e-6, 1e-6, 1e-6])


class ImageToRay(Effect):
    """Zero is a principal point in the middle of the picture and no distortion."""

    slug, title, called, place = "image_to_ray", "Lens from the image to the ray", "a lens", "image"
    group = "camera"
    stands_in_for = ("cx", "cy", "k1", "k2", "k3", "p1", "p2", "b1")

    def __init__(self, model: int, pitch_mm: float):
        super().__init__()
        self.model, self.pitch = model, pitch_mm
        scales = (0.1, 0.1, 1e-2, 1e-3, 1e-4, 1e-3, 1e-3, 1e-2)
        every = [Parameter(n, "mm", scale=s) for n, s in zip(NAMES, scales, strict=True)]
        self.unknowns = every[: 7 if model < 3 else 8]

    def shift(self, context, values):
        """Measured minus lens(measured), and its derivative by central differences."""
        middle = (context.size - 1.0) / 2.0
        whole = np.zeros((len(values), 8))
        whole[:, : values.shape[1]] = values
        derivative = np.empty((len(values), 2, values.shape[1]))
        for k in range(values.shape[1]):
            step = _STEPS[k] * np.eye(8)[k]
            ahead, back = (self._lens(context, middle, whole + s * step) for s in (1.0, -1.0))
            derivative[:, :, k] = (back - ahead) / (2.0 * _STEPS[k])
        return context.measured - middle - self._lens(context, middle, whole), derivative

    def _lens(self, context, middle, values):
        """Where a camera without a lens had shown it (rows, 2), from the middle, px."""
        px, py, k1, k2, k3, p1, p2, aspect = values.T
        x, y = (self.pitch * (context.measured - middle)).T * [[1.0], [-1.0]]
        # DBAT scales from the corner of the picture.
        corner = self.pitch * (middle[:, 0] + 0.5)
        x = (x + corner) * (1.0 + aspect) - corner if self.model == 5 else x
        x, y = x - px, y + py
        x = x * (1.0 + aspect) if self.model == 3 else x
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        a = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y
        b = y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y
        a = a * (1.0 + aspect) if self.model == 4 else a
        return np.stack([a, -b], axis=1) / self.pitch


def calibrated(data: Path, model: int, few: bool = False):
    """DBAT's camera calibration, adjusted with one of its lenses, and the pitch, mm; its control is
    exact. few: five photographs, and the ten points of the export's tables."""
    name = "camcal_5photos" if few else "camcal_model1"
    block = corridor.read(data / "digits" / name)
    measured = read_project(data / "dbat" / "camcal" / "camcal-pmexport.txt").block.tie_points
    at = measured.set_index(["point", "image"])[["x", "y"]]
    for table in ("tie_points", "marks"):
        rows = getattr(block, table)
        keys = [(str(p), str(i)) for p, i in zip(rows["point"], rows["image"], strict=True)]
        rows[["x", "y"]] = at.loc[keys].to_numpy(float)
    block.ground[["sx", "sy", "sz"]] = 0.0
    pitch = next(iter(block.cameras.values())).pixel_um * 1e-3
    lens = ImageToRay(model, pitch)
    return corridor.adjust(block, camera="f", effects=[lens], weights="stated"), pitch


def camera_of(adjusted, pitch: float) -> tuple[dict[str, float], dict[str, float]]:
    """Its camera as DBAT prints it, and the standard deviations; mm."""
    lens = adjusted.values["image_to_ray"]
    names = [one.name for one in lens.parameters]
    value = dict(zip(names, lens.value[0].tolist(), strict=True))
    sigma = dict(zip(names, lens.sigma[0].tolist(), strict=True))
    (camera,) = adjusted.block.cameras.values()
    value["px"] += pitch * camera.width / 2.0
    value["py"] += pitch * camera.height / 2.0
    free = [n for n, one in enumerate(adjusted.problem.unknowns) if one.kind == "camera"]
    value["f"] = pitch * float(adjusted.state.interior[0, 0])
    sigma["f"] = pitch * float(
        adjusted.sigma0 * adjusted.covariance.shared[free[0], free[0]] ** 0.5
    )
    return value, sigma


_NAMED = {"Camera Constant": "f"}


def report(path: Path) -> tuple[dict, dict, dict]:
    """Of a report of DBAT: what it says of everything, of the camera (value, standard deviation),
    and of each photograph, as the table of digits takes it."""
    published: dict[str, str] = {}
    camera: dict[str, list] = {}
    photos: dict[str, dict[str, str]] = {}
    photo, name = "", ""
    for line in path.read_text(encoding="latin-1").splitlines():
        key, _, text = (part.strip() for part in line.partition(":"))
        words = text.split()
        if line.strip().startswith("Sigma0:"):
            published["sigma0"] = words[0]
        elif line.strip().startswith("Redundancy"):
            published["redundancy"] = line.split()[-1]
        elif re.fullmatch(r"Photo \d+", key) and words:
            photo = words[0]
            photos.setdefault(photo, {})
        elif key in ("Value", "Deviation") and words and name:
            mark = "" if key == "Value" else "s"
            if photo and name in ("Omega", "Phi", "Kappa", "Xc", "Yc", "Zc"):
                photos[photo][mark + name] = words[0]
            elif not photo:
                camera.setdefault(name, []).append(words[0])
        elif key and not text:
            name = _NAMED.get(key, key.split(" - ")[0])
    return published, camera, photos
