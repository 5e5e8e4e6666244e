"""COLMAP's camera models and ours.

Pixel (0.5, 0.5) is the centre of COLMAP's top-left pixel: cx, cy and every observation lose half a
pixel on the way in. Its p1, p2 are OpenCV's: our p2, p1. fx, fy multiply the distorted ray; our b1
multiplies the undistorted one, so that fx != fy is exact without distortion only, but of a fisheye
always: those without thin prisms are ours.

Source: COLMAP, src/colmap/sensor/models.h.
"""

from collections.abc import Sequence

import numpy as np

from corridor.core.camera import FISHEYE, Camera
from corridor.tools.formats.cameras import Held, NoModel, opencv_camera

HOLDS = Held(
    ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2"), pinhole=("b1",), fisheye=(*FISHEYE, "b1")
)
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
# fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6: where each model keeps them; -1: nowhere.
_PLACES = {
    "SIMPLE_PINHOLE": (0, 0, 1, 2),
    "PINHOLE": (0, 1, 2, 3),
    "SIMPLE_RADIAL": (0, 0, 1, 2, 3),
    "RADIAL": (0, 0, 1, 2, 3, 4),
    "OPENCV": tuple(range(8)),
    "FULL_OPENCV": tuple(range(12)),
    "SIMPLE_FISHEYE": (0, 0, 1, 2),
    "FISHEYE": (0, 1, 2, 3),
    "SIMPLE_RADIAL_FISHEYE": (0, 0, 1, 2, 3),
    "RADIAL_FISHEYE": (0, 0, 1, 2, 3, 4),
    "OPENCV_FISHEYE": (0, 1, 2, 3, 4, 5, -1, -1, 6, 7),
}


def camera_of(
    name: str, model: str, width: int, height: int, params: Sequence[float], notes: list[str]
) -> Camera:
    """Our camera of one of COLMAP's. Raises NoModel where we have no such one."""
    if model not in _PLACES:
        raise NoModel(f"camera {name} is a {model}, for which corridor has no model")
    full = np.zeros(12)
    full[: len(_PLACES[model])] = [(*params, 0.0)[at] for at in _PLACES[model]]
    k1, k2, p1, p2, k3, k4, k5, k6 = full[4:]
    radial = (k1, k2, k3, k4, k5, k6)
    size, middle = (width, height), full[2:4] - HALF
    lens = "fisheye" if "FISHEYE" in model else "central"
    return opencv_camera(name, size, full[:2], middle, radial, p1, p2, notes, lens)


def params_of(camera: Camera) -> tuple[str, list[float]]:
    """Model and parameters: the simplest model that holds the camera exactly."""
    k1, k2, k3, p1, p2, b1 = (camera[name] for name in ("k1", "k2", "k3", "p1", "p2", "b1"))
    f, cx, cy = camera["f"], camera["cx"] + HALF, camera["cy"] + HALF
    if camera.fisheye:
        return "OPENCV_FISHEYE", [f * (1 + b1), f, cx, cy, k1, k2, k3, camera["k4"]]
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
