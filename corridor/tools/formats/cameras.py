"""Cameras of other programs whose formula is not ours: the camera that stands for them.

Ours (corridor.camera) goes from the ray to the image, with b1 and b2 on the undistorted ray. Where
another formula says something else, the parameters are fitted over the picture and the largest
difference is told, never passed over.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval

from corridor.core.camera import (
    INTERIOR,
    MODELS,
    Camera,
    fitted,
    project_rays,
    undistort,
    without_distortion,
)
from corridor.core.errors import InputError

# Between axes x right, y up, z back and ours: the turn is its own inverse.
FLIP = np.diag([1.0, -1.0, -1.0])
_PICTURE = 41  # nodes a side over the picture
TOLD_PX, _ENOUGH_PX, REFUSED_PX = 1e-6, 0.05, 0.5


class NoModel(InputError):
    """A camera for which corridor has no model."""


@dataclass(frozen=True)
class Held:
    """Interior parameters that a format holds.

    names: always. pinhole: those that it multiplies with the distorted ray and we with the
    undistorted one, exact where nothing bends the ray. centred: its principal point lies in the
    middle of the picture. fisheye: those that it holds of a fisheye; none without such a lens.
    """

    names: tuple[str, ...]
    pinhole: tuple[str, ...] = ()
    centred: bool = False
    fisheye: tuple[str, ...] = ()

    def unheld(self, camera: Camera) -> dict[str, float]:
        """Parameters that the format cannot hold, and what they are to it."""
        bent = any(camera[name] for name in INTERIOR[3:] if name not in self.pinhole)
        held = self.names if bent else self.names + self.pinhole
        held = self.fisheye if camera.fisheye else held
        values = dict.fromkeys(INTERIOR, 0.0)
        if self.centred:
            values["cx"], values["cy"] = in_the_middle(camera.width, camera.height)
        return {
            name: value
            for name, value in values.items()
            if name not in held and camera[name] != value
        }

    def nearest(self, camera: Camera) -> Camera:
        """The nearest camera that the format holds."""
        return camera.with_values(**self.unheld(camera))

    def __str__(self) -> str:
        more = [f"{', '.join(self.pinhole)} without distortion"] if self.pinhole else []
        more += ["the principal point in the middle of the picture"] if self.centred else []
        more += [f"of a fisheye {', '.join(self.fisheye)}"] if self.fisheye else []
        return ", ".join(self.names) + (f" ({'; '.join(more)})" if more else "")


ALL = ("f", "cx", "cy", "k1", "k2", "k3", "k4", "k5", "p1", "p2", "b1", "b2")


def in_the_middle(width: int, height: int) -> tuple[float, float]:
    """Image centre in our pixels: ((w - 1) / 2, (h - 1) / 2)."""
    return (width - 1) / 2, (height - 1) / 2


def camera_from(
    name: str, width: float, height: float, f: float, cx: float, cy: float, **more: float
) -> Camera:
    """A camera, checked. Raises InputError naming it where it cannot be one."""
    for side in (width, height):
        if not 2 <= side < 1_000_000 or side != int(side):
            raise InputError(
                f"camera {name}: {side!r} is not a picture size in pixels; export the project again"
            )
    table = {"width": width, "height": height, "f": f, "cx": cx, "cy": cy, **more}
    return Camera.from_table(name, {key: float(value) for key, value in table.items()})


def where_known(names: Iterable[str], make: Callable[[str], Camera]) -> dict[str, Camera | NoModel]:
    """Cameras by name; where there is no model for one, the NoModel that says so."""
    cameras: dict[str, Camera | NoModel] = {}
    for name in dict.fromkeys(names):
        try:
            cameras[name] = make(name)
        except NoModel as error:
            cameras[name] = error
    return cameras


def shared(
    interiors: Sequence[tuple[float, ...]], name: Callable[[int], str], make: Callable[..., Camera]
) -> tuple[dict[str, Camera], list[str]]:
    """The different cameras of images by name, and that of each image.

    interiors: what tells the cameras of images apart; name: of the n-th different one; make: its
    camera of name and interior.
    """
    names: dict[tuple[float, ...], str] = {}
    used = [names.setdefault(inner, name(len(names))) for inner in interiors]
    return {each: make(each, *inner) for inner, each in names.items()}, used


def opencv_camera(
    name: str,
    size: Sequence[float],
    focal: Sequence[float],
    middle: Sequence[float],
    radial: Sequence[float],
    p1: float,
    p2: float,
    notes: list[str],
    model: str = MODELS[0],
) -> Camera:
    """Our camera of OpenCV's formula: fx, fy of `focal` multiply the distorted ray, as b1 of a
    fisheye does.

    middle: cx, cy in our pixels. radial: k1, k2, k3 and perhaps k4, k5, k6: of the divisor, and of
    a fisheye the next three. p1, p2: OpenCV's, our p2, p1. Raises InputError where a focal length
    is not positive.
    """
    fx, fy = focal
    if not (fx > 0 and fy > 0):
        raise InputError(
            f"camera {name}: the focal length {min(focal):g} is not positive; export the project "
            "again"
        )
    k = (*radial, *6 * (0.0,))[:6]
    fisheye = model != MODELS[0]
    own = k if fisheye else k[:3]
    camera = camera_from(
        name, *size, fy, *middle, p1=p2, p2=p1, b1=(fx - fy) / fy,
        **{f"k{n + 1}": value for n, value in enumerate(own)},
    ).with_model(model)  # fmt: skip

    def project(rays: np.ndarray) -> np.ndarray:
        u, v = rays.T
        r2 = u * u + v * v
        radial = polyval(r2, [1.0, *own]) / polyval(r2, [1.0, *k[len(own) :]])
        x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
        y = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v)
        return middle + np.column_stack([fx * x, fy * y])

    if any(k[len(own) :]) or (fx != fy and not fisheye and any((*own, p1, p2))):
        return standing_for(camera, project, notes)
    return camera


def _rays_over_picture(camera: Camera, project: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Rays (n, 2) that `project` takes into the picture, from a little beyond its edges."""
    half, middle = np.array([camera.width, camera.height]) / 2, camera.interior[1:3]
    reach = 1.3 * (half + np.abs(middle - half))
    x, y = np.meshgrid(*(np.linspace(-r, r, _PICTURE) for r in reach))
    rays = without_distortion(middle + np.column_stack([x.ravel(), y.ravel()]), camera.interior)
    rays = rays[np.isfinite(rays[:, 0])]
    pixels = project(rays)
    inside = (pixels > -0.5).all(1) & (pixels < [camera.width - 0.5, camera.height - 0.5]).all(1)
    return rays[inside]


def _away(camera: Camera, pixels: np.ndarray, rays: np.ndarray) -> float:
    """Largest distance, px, between pixels of another formula and ours of the same rays (n, 2)."""
    away = np.linalg.norm(pixels - project_rays(rays, camera.interior), axis=1)
    return float(away.max()) if len(rays) else np.inf


def _fitted(camera, pixels, rays, names, formula):
    """Our camera for pixels of rays, and how far it is off. Raises InputError beyond half a px."""
    camera = fitted(camera, pixels, rays, names)
    far = _away(camera, pixels, rays)
    if not far <= REFUSED_PX:
        raise InputError(
            f"camera {camera.name}: no camera of corridor comes nearer to its {formula} than "
            f"{far:.2g} px; undistort its images, or leave them out"
        )
    return camera, far


def standing_for(
    camera: Camera, project: Callable[[np.ndarray], np.ndarray], notes: list[str]
) -> Camera:
    """Our camera, or fisheye, for another formula: as it is where that is good enough, else fitted.

    camera: our parameters read directly. project: rays (n, 2) to pixels by the other formula.
    Raises InputError where no camera of ours comes within half a pixel.
    """
    with np.errstate(all="ignore"):
        rays = _rays_over_picture(camera, project)
        pixels = project(rays)
        far = _away(camera, pixels, rays)
        if far <= TOLD_PX:
            return camera
        if not far <= _ENOUGH_PX:
            camera, far = _fitted(camera, pixels, rays, ALL, "formula")
    notes.append(
        f"camera {camera.name}: its formula is not ours; the parameters stand for it to {far:.2g} "
        "px over the picture"
    )
    return camera


def from_image_formula(
    camera: Camera, ray_of: Callable[[np.ndarray], np.ndarray]
) -> tuple[Camera, float]:
    """The camera for a formula from the image to the ray, and how far it is off over the picture.

    Our polynomial goes the other way.

    camera: width, height, f, cx, cy as read, the rest a start. ray_of: pixels (n, 2) to rays.
    Raises InputError where the formula folds inside the picture or no camera comes near.
    """
    x, y = np.meshgrid(np.linspace(0, camera.width - 1, 21), np.linspace(0, camera.height - 1, 21))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    with np.errstate(all="ignore"):
        rays = ray_of(pixels)
        step = 1e-3
        by_x = (ray_of(pixels + [step, 0]) - rays) / step
        by_y = (ray_of(pixels + [0, step]) - rays) / step
        turn = by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0]
    if not (np.isfinite(rays).all() and (turn > 0).all()):
        raise InputError(
            f"camera {camera.name}: its image-to-ray distortion folds inside the picture; check "
            "the direction of the coefficients"
        )
    held = {"cx", "cy", "b1", "b2"}
    names = [name for name in (*ALL, "k6", "k7") if name not in held]
    return _fitted(camera, pixels, rays, names, "image-to-ray formula")


def turned_note(camera: Camera, away: float) -> str:
    """The sentence on a camera that `from_image_formula` made."""
    return f"camera {camera.name}: turned from image-to-ray, true to {away:.1g} px over the picture"


def moved_to(
    pixels: np.ndarray, row: np.ndarray, source: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Pixels (n, 2) of the same rays in other cameras; NaN where no ray belongs to a pixel.

    source, target: interior (m, 16); row (n,) says which.
    """
    return project_rays(undistort(pixels, source, row), target, row)
