"""What straightens the lines of a picture: a calibrated camera, or a few numbers to be found.

Either takes stored pixels to "ideal" ones, in which straight things are straight; they keep the
scale of the picture at the principal point. Rows are read out as stored, so whoever needs the
time of a point takes its stored row.
"""

import os
from pathlib import Path

import numpy as np

from corridor.core.camera import Camera, project_rays, undistort
from corridor.core.errors import InputError
from corridor.core.textfile import read_toml
from corridor.tools.readout.photograph import Photograph

Calibration = Camera | str | os.PathLike | None


class Calibrated:
    """Ideal pixels by a calibration (`corridor.camera`): nothing to be found."""

    sigmas = np.zeros(0)

    def __init__(self, camera):
        self.camera = camera
        self.focal = float(camera["f"])
        self.focal_sigma = 0.0
        self.principal = np.array(camera.interior[1:3], dtype=float)

    def middle(self, bend: np.ndarray) -> np.ndarray:
        """The principal point (2,), px."""
        return self.principal

    def ideal(self, pixels: np.ndarray, bend: np.ndarray) -> np.ndarray:
        """Ideal pixels (n, 2) of stored ones (n, 2)."""
        return self.principal + self.focal * undistort(pixels, self.camera.interior)

    def stored(self, pixels: np.ndarray, bend: np.ndarray) -> np.ndarray:
        """Stored pixels (n, 2) of ideal ones (n, 2)."""
        return project_rays((pixels - self.principal) / self.focal, self.camera.interior)


class Unknown:
    """Ideal pixels by a radial distortion, its middle near that of the picture.

    ideal = stored + away (b0 s2 + b1 s2^2), s2 = away . away, away = (stored - middle) / h - (b2,
    b3), h the half diagonal; there is the principal point as well. The four numbers are estimated
    with the rest; `sigmas`, an ordinary lens, hold those that a picture does not tell.
    """

    sigmas = np.array([0.1, 0.03, 0.015, 0.015])

    def __init__(self, width: int, height: int, focal_px: float | None = None):
        self.size = width, height
        self.principal = np.array([(width - 1) / 2, (height - 1) / 2])
        self.scale = np.hypot(width, height) / 2
        self.focal = focal_px or 0.85 * max(width, height)
        self.focal_sigma = 0.08 if focal_px else 0.35  # of its logarithm

    @classmethod
    def of(cls, photo) -> "Unknown":
        """The lens of a photograph."""
        return cls(photo.width, photo.height, photo.focal_px)

    def middle(self, bend: np.ndarray) -> np.ndarray:
        """The principal point (2,), px: the middle of the distortion."""
        return self.principal + self.scale * bend[2:]

    def ideal(self, pixels: np.ndarray, bend: np.ndarray) -> np.ndarray:
        """Ideal pixels (n, 2) of stored ones (n, 2)."""
        if not np.any(bend[:2]):
            return pixels
        away = (pixels - self.principal) / self.scale - bend[2:]
        # Far outside the picture, where nobody looks, the polynomial must not run away.
        square = np.minimum(np.einsum("ij,ij->i", away, away), 2.5)[:, None]
        return pixels + self.scale * away * (square * (bend[0] + bend[1] * square))

    def stored(self, pixels: np.ndarray, bend: np.ndarray) -> np.ndarray:
        """Stored pixels (n, 2) of ideal ones (n, 2): the inverse of `ideal`, by six steps."""
        found = pixels
        for _ in range(6):
            step = pixels - self.ideal(found, bend)
            found = found + step
            if np.max(np.abs(step), initial=0.0) < 1e-4:
                break
        return found


def lens_for(photo: Photograph, camera: Calibration) -> Calibrated | Unknown:
    """The lens of a photograph, calibrated where there is a camera, or a file with one.

    Raises InputError where the camera is of another picture size, and as `read_camera`.
    """
    if camera is None:
        return Unknown.of(photo)
    if not isinstance(camera, Camera):
        camera = read_camera(camera)
    if (camera.width, camera.height) != (photo.width, photo.height):
        raise InputError(
            f"camera {camera.name} has {camera.width} x {camera.height} pixels and {photo.name} "
            f"{photo.width} x {photo.height}: give the calibration of this picture size"
        )
    return Calibrated(camera)


def read_camera(path: str | os.PathLike) -> Camera:
    """The one camera of a TOML file with a `[camera.NAME]` table; a block.toml will do.

    Its readout_s and row_direction are dropped. Raises InputError, naming the file, where there is
    not exactly one camera.
    """
    path = Path(path)
    tables = read_toml(path).get("camera")
    if not isinstance(tables, dict) or not all(isinstance(t, dict) for t in tables.values()):
        raise InputError(f"{path} has no [camera.NAME] table: add one")
    if len(tables) != 1:
        raise InputError(f"{path} has {len(tables)} cameras: keep the one that took the pictures")
    ((name, table),) = tables.items()
    table = {k: v for k, v in table.items() if k not in ("readout_s", "row_direction")}
    try:
        return Camera.from_table(name, table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
