"""How far two calibrations of a camera are apart, once one may be turned against the other.

    d = min over R of mean |x2(R ray1(x)) - x|^2 over the picture's x

A rotation of the camera is taken up by the poses; what is left of a difference is not.
Source: Zhou 2019, eq. 6.4 (there an integral; here the mean over a grid of the whole picture).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.camera import Camera, fitted, project_rays, undistort
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.tools.thermal.model import ThermalModel


@brief
@dataclass(frozen=True, eq=False)
class CameraDifference:
    """Where a second camera sees what a first one sees at (x, y).

    width, height: px. x, y: (n,) px of a grid. dx, dy: (n,) px, second minus first, least in the
    square over rotations. rotation: (3,) rad, the one found. squared: eq. 6.4, px^2.
    """

    width: int
    height: int
    x: np.ndarray
    y: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    rotation: np.ndarray
    squared: float

    @property
    def length(self) -> np.ndarray:
        """Distance (n,), px."""
        return np.hypot(self.dx, self.dy)

    @property
    def mean(self) -> float:
        """Mean distance over the picture, px."""
        return float(self.length.mean())

    @property
    def side(self) -> float:
        """Mean distance in the middles of the left and the right edge, px."""
        middle = np.abs(self.y - (self.height - 1) / 2)
        edge = np.minimum(self.x, self.width - 1 - self.x)
        place = (middle <= middle.min() + 1e-6) & (edge <= edge.min() + 1e-6)
        return float(self.length[place].mean())

    @property
    def largest(self) -> float:
        """Largest distance, px."""
        return float(self.length.max())

    def __str__(self) -> str:
        return (
            f"mean {self.mean:.4f} px, middle of the sides {self.side:.4f} px, largest "
            f"{self.largest:.4f} px; eq. 6.4: {self.squared:.3g} px^2"
        )


def compare_cameras(first: Camera, second: Camera, columns: int = 65) -> CameraDifference:
    """The difference of two cameras over the picture (eq. 6.4).

    columns: of the grid, odd; rows follow the picture's shape.
    Raises InputError where the pictures have different sizes or a distortion folds in them.
    """
    if (first.width, first.height) != (second.width, second.height):
        raise InputError(
            f"camera {first.name} has pictures of {first.width} x {first.height} px, {second.name} "
            f"of {second.width} x {second.height}: only cameras of one size can be compared"
        )
    pixels = _grid(first, columns)
    rays = undistort(pixels, first.interior)
    if not np.isfinite(rays).all():
        raise InputError(f"the distortion of camera {first.name} folds inside the picture")
    rays = np.column_stack([rays, np.ones(len(rays))])

    def seen(vector):
        turned = rays @ rotation_from_vector(vector).T
        return project_rays(turned[:, :2] / turned[:, 2:], second.interior) - pixels

    # Radians times f are pixels: the problem is then of one scale.
    f = second["f"]
    found = least_squares(
        lambda v: seen(v / f).ravel(), np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    off = seen(found.x / f)
    return CameraDifference(
        first.width, first.height, *pixels.T, *off.T, found.x / f,
        float(np.mean(np.sum(off**2, axis=1))),
    )  # fmt: skip


def camera_at(
    camera: Camera, model: ThermalModel, temperature_c: float, parameters: tuple[str, ...] = ()
) -> Camera:
    """The camera, calibrated at the model's t0, as it is at another temperature.

    parameters: interior parameters that change; default all of Fraser's ten. The interior vector
    is the one nearest to the warm camera over the picture.
    """
    names = parameters or ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2", "b1", "b2")
    pixels = _grid(camera, 41)
    rays = undistort(pixels, camera.interior)
    warm = pixels + np.stack(model.displacement(*pixels.T, temperature_c), axis=1)
    return fitted(camera, warm, rays, names)


def calibrated_at(block: Block, model: ThermalModel, temperature_c: float) -> Block:
    """The block with cameras, known at the model's t0, as a calibration at another temperature
    has them: held, as a surveyor would who does not know of the heat.
    """
    out = block.copy()
    out.cameras = {
        name: replace(camera_at(camera, model, temperature_c), calibrated=True)
        for name, camera in block.cameras.items()
    }
    return out


def _grid(camera, columns):
    rows = max(3, round(columns * camera.height / camera.width) // 2 * 2 + 1)
    x, y = np.meshgrid(
        np.linspace(0, camera.width - 1, columns // 2 * 2 + 1),
        np.linspace(0, camera.height - 1, rows),
    )
    return np.column_stack([x.ravel(), y.ravel()])
