"""What is true: the scene that block and twin share, and the physics in which they may differ."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .camera import Lens
from .trajectory import Trajectory, rotation


@dataclass(frozen=True)
class Scene:
    """The flight, the ground and who sees whom. m images, n points, g ground points.

    images: (m,) text; flights: names; middle: (3,) mean of the true centres, m; base: s, middle
    of the exposures. position: (n, 3) m of tie points; point, image: (o,) of tie observations.
    ground: (g, 3) m, ground_name, control (g,) bool; mark, mark_image: (k,) of marks.
    heat: (m,) degrees of the optics, thermometer: (m,) what the thermometer writes.
    stated: calibration by Fraser's parameters. along: (3,) direction of the corridor; length: m.
    arm: (flights, 3) true lever arms of the twin, m, camera frame. size: width, height px.
    """

    trajectory: Trajectory
    lens: Lens
    images: np.ndarray
    flights: list[str]
    middle: np.ndarray
    base: float
    position: np.ndarray
    point: np.ndarray
    image: np.ndarray
    ground: np.ndarray
    ground_name: np.ndarray
    control: np.ndarray
    mark: np.ndarray
    mark_image: np.ndarray
    heat: np.ndarray
    thermometer: np.ndarray
    stated: dict
    along: np.ndarray
    length: float
    arm: np.ndarray
    row_direction: str = "down"

    @property
    def size(self):
        return np.array([self.lens.width, self.lens.height])

    @property
    def time(self):
        """True times (m,) of the middle rows, s, since the middle of the exposures."""
        return self.trajectory.exposure - self.base

    @property
    def half(self):
        """Half of the picture's long side, px."""
        return (self.size.max() - 1) / 2

    @property
    def edge(self):
        """The tangent of the ray at the end of the long side."""
        return self.half / self.lens.f


@dataclass
class World:
    """The physics of one block; an effect changes one thing in it.

    readout: s from the first row to the last; carried, turning: whether the camera's centre and
    attitude go on meanwhile. shake(image, tau): rotation (n, 3) rad of the camera tau s after the
    middle row. focal, shift: what f (m,) and the principal point (m, 2) gain, px. rays: laws
    (u, v) -> gain at unit focal length. plane: laws (x, y, image) -> gain, px, where the rays would
    have fallen. air: strength of the refraction. ground_moves(position, image) -> m.
    arm: (flights, 3) m. late: (m,) true minus stated time, s. antenna: laws (time, position,
    flight) -> (n, 3) m, measured minus true. survey: (g, 3) m, given minus true. surveys (g,):
    names of the surveys the points are of, None where they are of one.
    """

    readout: float = 0.0
    carried: bool = True
    turning: bool = True
    shake: Callable | None = None
    focal: np.ndarray | float = 0.0
    shift: np.ndarray | float = 0.0
    rays: list[Callable] = field(default_factory=list)
    plane: list[Callable] = field(default_factory=list)
    air: float = 0.0
    ground_moves: Callable | None = None
    arm: np.ndarray | float = 0.0
    late: np.ndarray | float = 0.0
    antenna: list[Callable] = field(default_factory=list)
    survey: np.ndarray | float = 0.0
    surveys: np.ndarray | None = None


def photograph(scene, world, position, image):
    """Pixels (n, 2) of points (n, 3) m in images (n,).

    Each point is seen at the moment at which the shutter reads the row it falls on: the moment
    moves the row, the row the moment, until they agree.
    """
    if world.ground_moves:
        position = position + world.ground_moves(position, image)
    time = scene.trajectory.exposure
    centre = scene.trajectory.centre(time)[image]
    to_camera = scene.trajectory.rotation(time)[image]
    pixel = _fall(scene, world, position, image, centre, to_camera)
    if not world.readout:
        return pixel
    for _ in range(30):
        tau = world.readout * row_fraction(scene, pixel)
        now = time[image] + tau
        if world.carried:
            centre = scene.trajectory.centre(now)
        if world.turning:
            to_camera = scene.trajectory.rotation(now)
        pose = to_camera if world.shake is None else rotation(world.shake(image, tau)) @ to_camera
        before, pixel = pixel, _fall(scene, world, position, image, centre, pose)
        if np.abs(pixel - before).max() < 1e-10:
            return pixel
    raise RuntimeError("the rows and their moments do not agree: the camera moves too fast")


def row_fraction(scene, pixel):
    """-1/2 (n,) in the row that is read first, 1/2 in the last."""
    axis = 1 if scene.row_direction in ("down", "up") else 0
    fraction = pixel[:, axis] / (scene.size[axis] - 1) - 0.5
    return fraction if scene.row_direction in ("down", "right") else -fraction


def _fall(scene, world, position, image, centre, to_camera):
    """Pixels (n, 2) where rays fall that reach given cameras."""
    ray = position - centre
    if world.air:
        ray = bent_by_air(ray, position[:, 2], centre[:, 2], world.air)
    x, y, z = np.einsum("nij,nj->in", to_camera, ray)
    if (z <= 0).any():
        raise RuntimeError("a point lies behind its camera")
    u, v = x / z, y / z
    a, b = scene.lens.bend(u, v)
    for law in world.rays:
        more = law(u, v)
        a, b = a + more[0], b + more[1]
    f = scene.lens.f + np.broadcast_to(world.focal, len(scene.images))[image]
    pixel = np.array(scene.lens.point) + f[:, None] * np.stack([a, b], axis=1)
    pixel = pixel + np.broadcast_to(world.shift, (len(scene.images), 2))[image]
    x, y = pixel.T
    gain = np.stack(scene.lens.wave(x, y), axis=1)
    for law in world.plane:
        gain = gain + np.stack(law(x, y, image), axis=1)
    return pixel + gain


def bent_by_air(ray, low, high, strength):
    """Rays (n, 3) as they seem to come, further from the nadir than the point is.

    low, high: heights (n,), m, of point and camera. With flat layers n sin(angle) stays constant,
    so that the tangent gains the mean of (n - 1) along the path minus its value at the camera;
    n - 1 = 2.8e-4 exp(-z / 10 km).
    """
    scale = 10_000.0
    path = np.maximum(high - low, 1.0)
    mean = 2.8e-4 * scale / path * (np.exp(-low / scale) - np.exp(-high / scale))
    lean = strength * (mean - 2.8e-4 * np.exp(-high / scale))
    # d(angle) = lean tan(angle), so that the horizontal part grows by lean / cos^2.
    tangent2 = (ray[:, :2] ** 2).sum(axis=1) / ray[:, 2] ** 2
    bent = ray.copy()
    bent[:, :2] *= (1 + lean * (1 + tangent2))[:, None]
    return bent


def antenna(scene, world, time, flight):
    """Measured antenna (n, 3), m, at times (n,) s of flights (n,), noise apart."""
    to_world = scene.trajectory.rotation(time).transpose(0, 2, 1)
    arm = (scene.arm + world.arm)[flight]
    position = scene.trajectory.centre(time) + np.einsum("nij,nj->ni", to_world, arm)
    return position + sum(law(time - scene.base, position, flight) for law in world.antenna)
