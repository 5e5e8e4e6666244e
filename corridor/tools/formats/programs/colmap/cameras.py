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
# Number in the binary files, how many parameters, and where among them fx, fy, cx, cy, k1, k2, p1,
# p2, k3, k4, k5, k6 are (-1: nowhere); without places: a model that corridor does not have.
MODELS = {
    "SIMPLE_PINHOLE": (0, 3, (0, 0, 1, 2)),
    "PINHOLE": (1, 4, (0, 1, 2, 3)),
    "SIMPLE_RADIAL": (2, 4, (0, 0, 1, 2, 3)),
    "RADIAL": (3, 5, (0, 0, 1, 2, 3, 4)),
    "OPENCV": (4, 8, tuple(range(8))),
    "OPENCV_FISHEYE": (5, 8, (0, 1, 2, 3, 4, 5, -1, -1, 6, 7)),
    "FULL_OPENCV": (6, 12, tuple(range(12))),
    "FOV": (7, 5, ()),
    "SIMPLE_RADIAL_FISHEYE": (8, 4, (0, 0, 1, 2, 3)),
    "RADIAL_FISHEYE": (9, 5, (0, 0, 1, 2, 3, 4)),
    "THIN_PRISM_FISHEYE": (10, 12, ()),
    "RAD_TAN_THIN_PRISM_FISHEYE": (11, 16, ()),
    "SIMPLE_DIVISION": (12, 4, ()),
    "DIVISION": (13, 5, ()),
    "SIMPLE_FISHEYE": (14, 3, (0, 0, 1, 2)),
    "FISHEYE": (15, 4, (0, 1, 2, 3)),
    "EUCM": (16, 6, ()),
    "EQUIRECTANGULAR": (17, 2, ()),
}
BY_NUMBER = {number: name for name, (number, *_) in MODELS.items()}


def camera_of(
    name: str, model: str, width: int, height: int, params: Sequence[float], notes: list[str]
) -> Camera:
    """Our camera of one of COLMAP's. Raises NoModel where we have no such one."""
    places = MODELS[model][2]
    if not places:
        raise NoModel(f"camera {name} is a {model}, for which corridor has no model")
    full = np.zeros(12)
    full[: len(places)] = [(*params, 0.0)[at] for at in places]
    k1, k2, p1, p2, k3, k4, k5, k6 = full[4:]
    radial = (k1, k2, k3, k4, k5, k6)
    size, middle = (width, height), full[2:4] - HALF
    lens = "fisheye" if "FISHEYE" in model else "central"
    return opencv_camera(name, size, full[:2], middle, radial, p1, p2, notes, lens)


def params_of(camera: Camera) -> tuple[str, list[float]]:
    """Model and parameters: the simplest model that holds the camera exactly."""
    f, k1, k2, k3, p1, p2, b1 = (camera[name] for name in ("f", "k1", "k2", "k3", "p1", "p2", "b1"))
    needed = {
        "OPENCV_FISHEYE": camera.fisheye, "PINHOLE": b1, "FULL_OPENCV": k3, "OPENCV": p1 or p2,
        "RADIAL": k2, "SIMPLE_RADIAL": k1, "SIMPLE_PINHOLE": True,
    }  # fmt: skip
    model = next(name for name, wanted in needed.items() if wanted)
    middle = camera["cx"] + HALF, camera["cy"] + HALF
    # From k4 on FULL_OPENCV has a denominator, which ours has not.
    k4 = camera["k4"] if camera.fisheye else 0.0
    full = (f * (1 + b1), f, *middle, k1, k2, p2, p1, k3, k4)
    _, count, places = MODELS[model]
    params = [0.0] * count
    for at, value in zip(places, full, strict=False):
        if at >= 0:
            params[at] = value
    return model, params
