"""COLMAP's camera models and ours.

Pixel (0.5, 0.5) is the centre of COLMAP's top-left pixel: cx, cy and every observation lose half a
pixel on the way in. Its p1, p2 are OpenCV's: our p2, p1. fx, fy multiply the distorted ray; our b1
multiplies the undistorted one, so that fx != fy is exact without distortion only.

Source: COLMAP, src/colmap/sensor/models.h.
"""

from collections.abc import Sequence

import numpy as np

from corridor.camera import INTERIOR, Camera
from corridor.errors import InputError
from corridor.interchange.cameras import NoModel, standing_for
from corridor.interchange.project import camera_from

HALF = 0.5
# Number in the binary files, parameters.
MODELS = {
    "SIMPLE_PINHOLE": (0, 3),
    "PINHOLE": (1, 4),
    "SIMPLE_RADIAL": (2, 4),
    "RADIAL": (3, 5),
    "OPENCV": (4, 8),
    "OPENCV_FISHEYE": (5, 8),
    "FULL_OPENCV": (6, 12),
    "FOV": (7, 5),
    "SIMPLE_RADIAL_FISHEYE": (8, 4),
    "RADIAL_FISHEYE": (9, 5),
    "THIN_PRISM_FISHEYE": (10, 12),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16),
    "SIMPLE_DIVISION": (12, 4),
    "DIVISION": (13, 5),
    "SIMPLE_FISHEYE": (14, 3),
    "FISHEYE": (15, 4),
    "EUCM": (16, 6),
    "EQUIRECTANGULAR": (17, 2),
}
BY_NUMBER = {number: name for name, (number, _) in MODELS.items()}
# fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6: where each model keeps them.
_PLACES = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2),
    "PINHOLE": (0, 1, 2, 3),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3),
    "RADIAL": (0, 0, 1, 2, 3, 4),
    "OPENCV": tuple(range(8)),
    "FULL_OPENCV": tuple(range(12)),
}


def camera_of(
    name: str, model: str, width: int, height: int, params: Sequence[float], notes: list[str]
) -> Camera:
    """Our camera of one of COLMAP's. Raises NoModel where we have no such one."""
    if model not in _PLACES:
        raise NoModel(f"camera {name} is a {model}, for which corridor has no model")
    full = np.zeros(12)
    full[: len(_PLACES[model])] = [params[at] for at in _PLACES[model]]
    fx, fy, cx, cy, k1, k2, p1, p2, k3, *divisor = full
    camera = camera_from(
        name, width, height, fy, cx - HALF, cy - HALF,
        k1=k1, k2=k2, k3=k3, p1=p2, p2=p1, b1=(fx - fy) / fy if fy else 0.0,
    )  # fmt: skip
    if fx <= 0:
        raise InputError(f"camera {name}: fx = {fx:g} is not positive; export the project again")

    def project(rays: np.ndarray) -> np.ndarray:
        u, v = rays.T
        r2 = u * u + v * v
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (
            1 + r2 * (divisor[0] + r2 * (divisor[1] + r2 * divisor[2]))
        )
        return np.column_stack(
            [
                cx - HALF + fx * (u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)),
                cy - HALF + fy * (v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v)),
            ]
        )

    if (fx == fy or not full[4:].any()) and not any(divisor):
        return camera
    return standing_for(camera, project, notes)


# What a FULL_OPENCV camera holds of ours; b1 only where nothing else bends the ray.
_HELD = ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2")


def not_held(camera: Camera) -> list[str]:
    """Interior parameters, not zero, that no model of COLMAP holds."""
    bent = any(camera[name] for name in INTERIOR if name not in ("f", "cx", "cy", "b1"))
    held = (*_HELD, "b1") if not bent else _HELD
    return [name for name in INTERIOR if name not in held and camera[name] != 0.0]


def holdable(camera: Camera) -> Camera:
    """The nearest camera that COLMAP holds: what it cannot hold set to zero."""
    return camera.with_values(**{name: 0.0 for name in not_held(camera)})


def params_of(camera: Camera) -> tuple[str, list[float]]:
    """Model and parameters: the simplest model that holds the camera exactly."""
    k1, k2, k3, p1, p2, b1 = (camera[name] for name in ("k1", "k2", "k3", "p1", "p2", "b1"))
    f, cx, cy = camera["f"], camera["cx"] + HALF, camera["cy"] + HALF
    if b1:
        return "PINHOLE", [f * (1 + b1), f, cx, cy]
    if k3:
        return "FULL_OPENCV", [f, f, cx, cy, k1, k2, p2, p1, k3, 0.0, 0.0, 0.0]
    if p1 or p2:
        return "OPENCV", [f, f, cx, cy, k1, k2, p2, p1]
    if k2:
        return "RADIAL", [f, cx, cy, k1, k2]
    if k1:
        return "SIMPLE_RADIAL", [f, cx, cy, k1]
    return "SIMPLE_PINHOLE", [f, cx, cy]
