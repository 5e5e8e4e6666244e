"""nerfstudio and instant-ngp: transforms.json.

Conventions, where they differ from ours: transform_matrix takes the camera (x right, y up, z
backwards) to the world; cx, cy are counted from the corner of the first pixel; k1, k2, p1, p2 are
OpenCV's. The files hold no image points: poses and cameras only.

Source: nerfstudio documentation, data conventions.
"""

from pathlib import Path

import numpy as np

from corridor.core.camera import MODELS
from corridor.core.errors import InputError
from corridor.tools.formats.cameras import FLIP, NoModel, opencv_camera, shared
from corridor.tools.formats.project import Contents, Project
from corridor.tools.formats.textfile import Json, opening

NAME = "nerfstudio"
TITLE = "nerfstudio transforms.json, without image points"

_KEYS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
_FISHEYE = "OPENCV_FISHEYE"
_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", _FISHEYE)


def recognise(path: Path) -> bool:
    """transforms.json, or a folder with it."""
    file = path if path.is_file() else path / "transforms.json"
    return file.suffix == ".json" and '"transform_matrix"' in opening(file, 200_000)


def read(path: Path, size: tuple[int, int] | None = None) -> Project:
    """The project of a file. Raises InputError naming file and place."""
    file = path if path.is_file() else path / "transforms.json"
    whole = Json.read(file)
    model = whole.get("camera_model") or "OPENCV"
    if model not in _MODELS:
        raise InputError(
            f"{file.name}: camera_model {model!r}, for which corridor has no model; use OPENCV, or "
            "undistort the pictures first"
        )
    frames = whole.rows("frames", "frame")
    if not frames:
        raise InputError(f"{file.name} holds no frame; export it again")
    names = [frame.text("file_path").replace("\\", "/").removeprefix("./") for frame in frames]
    notes: list[str] = []
    cameras, used = shared(
        [_interior(whole, frame, size) for frame in frames],
        lambda k: f"camera_{k}" if k else "camera",
        lambda name, *inner: _camera(name, inner, notes, model == _FISHEYE),
    )
    matrices = np.array([_matrix(frame) for frame in frames])
    notes.append("transforms.json holds no image points: it has poses and cameras only")
    if whole.get("applied_transform") or whole.get("applied_scale"):
        notes.append("the poses are turned and scaled by applied_transform; they have no scale")
    return Contents(
        name=file.parent.resolve().name,
        cameras=cameras,
        images=names,
        used=used,
        centre=matrices[:, :3, 3],
        rotation=FLIP @ matrices[:, :3, :3].transpose(0, 2, 1),
        notes=notes,
    ).project(NAME, file, placed=False)


def _interior(whole: Json, frame: Json, size) -> tuple[float, ...]:
    """Size, focal lengths, principal point, distortion of a frame, else of the file."""

    def value(key, default=None):
        holder = frame if frame.get(key) is not None else whole
        return holder.number(key, default)

    width, height = (value(key, side) for key, side in zip("wh", size or (None,) * 2, strict=True))
    angle = value("camera_angle_x", 0.0)
    default = width / (2 * np.tan(angle / 2)) if angle else None
    fx = value("fl_x", default)
    rest = [value(key, 0.0) for key in _KEYS[6:]]
    return (width, height, fx, value("fl_y", fx), value("cx", width / 2), value("cy", height / 2),
            *rest)  # fmt: skip


def _camera(name, inner, notes, fisheye):
    width, height, fx, fy, cx, cy, k1, k2, k3, k4, p1, p2 = inner
    if k4 and not fisheye:
        raise NoModel(f"camera {name} has k4, the model of a fisheye; undistort its images")
    picture, radial = ((width, height), (fx, fy), (cx - 0.5, cy - 0.5)), (k1, k2, k3, k4)
    p1, p2 = (0.0, 0.0) if fisheye else (p1, p2)
    return opencv_camera(name, *picture, radial, p1, p2, notes, MODELS[fisheye])


def _matrix(frame: Json) -> np.ndarray:
    """(3, 4), camera to world, of its 4 rows, or of 3."""
    rows = frame.get("transform_matrix")
    short = isinstance(rows, list) and len(rows) == 3
    return frame.numbers("transform_matrix", 12 if short else 16).reshape(-1, 4)[:3]
