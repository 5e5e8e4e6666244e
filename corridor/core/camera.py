"""The camera: ray to image and back, with derivatives.

    u = X/Z, v = Y/Z, r2 = u u + v v, radial = 1 + k1 r2 + k2 r2^2 + ...
    x = cx + f (u radial + p1 (r2 + 2 u u) + 2 p2 u v + b1 u + b2 v)
    y = cy + f (v radial + p2 (r2 + 2 v v) + 2 p1 u v)

Pixels, (0, 0) is the centre of the top-left pixel; camera frame x right, y down, z forward.
Distortion goes from the ray to the image. OpenCV's p1, p2 are our p2, p1; DBAT and some files
of MicMac go from the image to the ray (`image_to_ray`).

A fisheye lens is equidistant: theta = atan(r), r = sqrt(r2), and u theta / r, v theta / r stand for
u, v in all of the above (then r2 is theta^2), but b1 and b2 act on the distorted ones: x' + b1 x' +
b2 y'. With k1..k4 that is the formula of OpenCV and COLMAP, fx and fy being f (1 + b1) and f, with
p1, p2 too that of Metashape. Rays are (u, v, 1): none at 90 degrees or more from the axis.

Sources: Fraser 1997, "Digital camera self-calibration", in normalised units; Kannala and Brandt
2006, "A generic camera model", for lenses whose radius in the picture is a polynomial of theta.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from corridor.core.engine.compiled import SCALAR, compiled, njit
from corridor.core.errors import InputError
from corridor.core.textfile import is_number

# Order of the interior vector. Slots 7.. are the radial polynomial.
INTERIOR = ("f", "cx", "cy", "p1", "p2", "b1", "b2") + tuple(f"k{n}" for n in range(1, 9))
FRASER8 = ("f", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
FRASER10 = (*FRASER8, "b1", "b2")
FISHEYE = ("f", "cx", "cy", "k1", "k2", "k3", "k4")
ROW_DIRECTIONS = ("down", "up", "right", "left")
# How a lens takes directions to the picture. Behind its parameters an interior vector says which,
# by its number here; a vector without that number is a central projection.
MODELS = ("central", "fisheye")
_MODEL = len(INTERIOR)
_FIRST_RADIAL = 7
# Square of the tangent up to which theta / r is a series: its slope would lose digits.
_NEAR_AXIS = 1e-3
_FLATTEST = np.radians(89.0)
# Share of its distance from the middle by which no term of a lens moves the picture's corner, even
# of a polynomial whose terms take each other back.
_MOST_BENT = 1e4
# Tangent of half the angle of the widest lens: beyond it the focal length is at fault (in mm?). A
# focal length below this share of the picture's long side sees more than 147 degrees, and as a
# fisheye more than there are.
_WIDEST, _SHORTEST = 3.0, 0.15
# Readouts of frame sensors end at a quarter of a second; no pixel resolves less than the waves of
# light, half a micrometre long.
SLOWEST_READOUT_S, _SMALLEST_PIXEL_UM = 0.5, 0.5
# No picture has a longer side, px: strips of line scanners have some 1e5 rows.
_LARGEST = 1e6


@dataclass(frozen=True, repr=False)
class Camera:
    """One camera of a block.

    interior: (16,) float64 in the order of `INTERIOR`, f, cx, cy in pixels, the rest without unit;
        last the number of the model in `MODELS` (0, central, where 15 are given).
        `Camera.from_table("P1", {"width": 6000, "height": 4000, "f": 8190})` fills it.
    readout_s: seconds from the first to the last row, None where unknown.
    calibrated: the values are a calibration and stay fixed unless asked otherwise.
    extra: keys of the table in block.toml that the package does not know; passed on.
    """

    name: str
    width: int
    height: int
    interior: np.ndarray
    pixel_um: float | None = None
    readout_s: float | None = None
    row_direction: str = "down"
    calibrated: bool = False
    extra: dict = field(default_factory=dict)

    def __post_init__(self):
        if np.shape(self.interior) == (_MODEL,):
            object.__setattr__(self, "interior", np.append(self.interior, 0.0))
        if np.shape(self.interior) != (_MODEL + 1,):
            raise InputError(
                f"camera {self.name}: interior is {self.interior!r}, not {len(INTERIOR)} numbers "
                f"({', '.join(INTERIOR)}): write Camera.from_table({self.name!r}, "
                f'{{"width": {self.width}, "height": {self.height}, "f": ...}})'
            )

    def __repr__(self) -> str:
        readout = "" if self.readout_s is None else f", read in {1000 * self.readout_s:g} ms"
        calibrated = ", calibrated" if self.calibrated else ""
        fisheye = ", fisheye" if self.fisheye else ""
        return (
            f"Camera {self.name}: {self.width} x {self.height} px, f {self['f']:.6g} px{fisheye}"
            f"{readout}{calibrated}"
        )

    @classmethod
    def from_table(cls, name: str, table: Mapping) -> "Camera":
        """Camera from its `[camera.NAME]` table.

        Raises InputError, without the name of the file, where the table cannot be a camera.
        """
        if not isinstance(table, Mapping):
            raise InputError(
                f"camera.{name} = {table!r} is not a camera: give it a name, as [camera.P1], with "
                "width, height and f below"
            )
        table = dict(table)
        where = f"[camera.{name}]"
        missing = [key for key in ("width", "height", "f") if key not in table]
        if missing:
            raise InputError(f"{where} has no {' and no '.join(missing)}: add it")

        def number(key: str, default: float | None = None) -> float:
            value = table.pop(key, default)
            if value is None:
                return None  # type: ignore[return-value]  # of a key that may be missing
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise InputError(f"{where} {key} = {value!r} is not a number: write a number")
            if not is_number(value):
                raise InputError(f"{where} {key} = {value!r} is not finite: write a number")
            return float(value)

        size = {key: number(key) for key in ("width", "height")}
        for key, value in size.items():
            if not 2 <= value <= _LARGEST or value != int(value):
                raise InputError(f"{where} {key} = {value:g} is not a picture size: give pixels")
        width, height = int(size["width"]), int(size["height"])
        focal = number("f")
        if focal <= 0:
            raise InputError(f"{where} f = {focal:g} is not positive: give f in pixels")
        model = table.pop("model", MODELS[0])
        if model not in MODELS:
            raise InputError(
                f"{where} model = {model!r} is unknown: use one of {', '.join(MODELS)} (how the "
                "lens takes directions to the picture; default central)"
            )
        interior = np.zeros(_MODEL + 1)
        interior[_MODEL] = MODELS.index(model)
        interior[:3] = focal, number("cx", (width - 1) / 2), number("cy", (height - 1) / 2)
        for index in range(3, _MODEL):
            interior[index] = number(INTERIOR[index], 0.0)
        terms = _at_the_corner(interior, width, height)
        if not terms.max() < _MOST_BENT:
            worst = int(terms.argmax())
            raise InputError(
                f"{where} {INTERIOR[worst]} = {interior[worst]:g} moves the corner of the picture "
                f"to {terms[worst]:.3g} times its distance from the middle: correct it"
            )
        pixel, readout = number("pixel_um"), number("readout_s")
        if pixel is not None and pixel <= 0:
            raise InputError(f"{where} pixel_um = {pixel:g} is not positive: give micrometres")
        if readout is not None and readout < 0:
            raise InputError(
                f"{where} readout_s = {readout:g} is negative: give seconds from the "
                "first row to the last, and their sense as row_direction"
            )
        direction = table.pop("row_direction", "down")
        if direction not in ROW_DIRECTIONS:
            raise InputError(
                f"{where} row_direction = {direction!r} is unknown: use one of "
                f"{', '.join(ROW_DIRECTIONS)}"
            )
        calibrated = table.pop("calibrated", False)
        if not isinstance(calibrated, bool):
            raise InputError(f"{where} calibrated = {calibrated!r} is not true or false")
        return cls(name, width, height, interior, pixel, readout, direction, calibrated, table)

    def to_table(self) -> dict:
        """The `[camera.NAME]` table; distortion that is zero is left out."""
        table: dict[str, Any] = {"width": self.width, "height": self.height}
        if self.fisheye:
            table["model"] = self.model
        for name, value in zip(INTERIOR, self.interior.tolist(), strict=False):
            if name in ("f", "cx", "cy") or value != 0.0:
                table[name] = value
        for key in ("pixel_um", "readout_s"):
            if getattr(self, key) is not None:
                table[key] = getattr(self, key)
        if self.row_direction != "down":
            table["row_direction"] = self.row_direction
        if self.calibrated:
            table["calibrated"] = True
        return table | self.extra

    def __getitem__(self, parameter: str) -> float:
        return float(self.interior[INTERIOR.index(parameter)])

    @property
    def model(self) -> str:
        """One of `MODELS`."""
        return MODELS[int(self.interior[_MODEL])]

    @property
    def fisheye(self) -> bool:
        """Whether the lens is a fisheye."""
        return bool(self.interior[_MODEL])

    @property
    def slips(self) -> list[str]:
        """What to say of values that no camera has, but one that counts in another unit."""
        found = [f"f = {self['f']:g} {self.too_short}"] if self.too_short else []
        if (readout := self.readout_s or 0.0) > SLOWEST_READOUT_S:
            found.append(
                f"readout_s = {readout:g} is longer than any shutter: it is in seconds, "
                f"{readout:g} ms are {readout / 1000:g}"
            )
        if (pixel := self.pixel_um or 1.0) < _SMALLEST_PIXEL_UM:
            found.append(
                f"pixel_um = {pixel:g} is smaller than the waves of light: it is in micrometres, "
                f"{pixel:g} mm are {1000 * pixel:g}"
            )
        for name, size in (("cx", self.width), ("cy", self.height)):
            # Lenses are mounted to a few per cent of the picture.
            if abs(self[name]) < 0.1 * size:
                found.append(
                    f"{name} = {self[name]:g} looks counted from the middle of the picture: the "
                    f"centre of its top-left pixel is 0, the middle {(size - 1) / 2:g}"
                )
        return found

    @property
    def too_short(self) -> str:
        """What to say of a focal length that no lens has; empty where one may."""
        if self["f"] >= _SHORTEST * max(self.width, self.height):
            return ""
        told = ": divide millimetres by the size of a pixel, in millimetres"
        if self.pixel_um:
            told = f", {self['f']:g} mm are {1000 * self['f'] / self.pixel_um:.0f}"
        size = f"{self.width} x {self.height} px"
        return f"is too short for a picture of {size}: f is in pixels{told}"

    def with_interior(self, interior: np.ndarray) -> "Camera":
        """The same camera with another interior vector (16,)."""
        return replace(self, interior=np.array(interior, dtype=float))

    def with_model(self, model: str) -> "Camera":
        """The same numbers for a lens of another of `MODELS`."""
        return self.with_interior(np.append(self.interior[:_MODEL], MODELS.index(model)))

    def with_values(self, **values: float) -> "Camera":
        """The same camera with some interior parameters replaced: `with_values(f=5500.0)`."""
        interior = self.interior.copy()
        for name, value in values.items():
            interior[INTERIOR.index(name)] = value
        return self.with_interior(interior)


def _at_the_corner(interior: np.ndarray, width: int, height: int) -> np.ndarray:
    """How far each parameter (15,) moves the corner, in distances from the middle; 0 for f."""
    far = min(np.hypot(width, height) / 2 / interior[0], _WIDEST)
    power = np.array([0, 0, 0, 1, 1, 0, 0, *range(2, 2 * (_MODEL - _FIRST_RADIAL) + 1, 2)])
    terms = np.abs(interior[:_MODEL]) * far**power
    terms[:_FIRST_RADIAL] *= (0, 0, 0, 3, 3, 1, 1)
    return np.nan_to_num(terms, posinf=np.inf)


def parameters_named(text: str) -> tuple[str, ...]:
    """Interior parameters from `fraser8`, `fraser10`, `fisheye`, `fixed` or a list as `f,cx,k1`.

    Raises InputError where a name is unknown.
    """
    ready = {"fixed": (), "fraser8": FRASER8, "fraser10": FRASER10, "fisheye": FISHEYE}
    if text in ready:
        return ready[text]
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in INTERIOR]
    if unknown or not names:
        raise InputError(
            f"camera parameter {', '.join(unknown) or repr(text)} is unknown: use fixed, fraser8, "
            f"fraser10, fisheye or a list of {', '.join(INTERIOR)}"
        )
    return tuple(name for name in INTERIOR if name in names)


# --- scalar kernels, shared by everything that projects -------------------------------------


@njit(**SCALAR)
def equidistant(r2):
    """theta / r of a ray at r = tan(theta), and its derivative by r2."""
    if r2 < _NEAR_AXIS:
        # atan(r) / r = 1 - r2 / 3 + r2^2 / 5 - ...: what is left out is below the last digit.
        scale = 1.0 + r2 * (-1 / 3 + r2 * (1 / 5 + r2 * (-1 / 7 + r2 * (1 / 9 - r2 / 11))))
        slope = -1 / 3 + r2 * (2 / 5 + r2 * (-3 / 7 + r2 * (4 / 9 + r2 * (-5 / 11 + r2 * 6 / 13))))
        return scale, slope
    r = np.sqrt(r2)
    scale = np.arctan(r) / r
    return scale, (1.0 / (1.0 + r2) - scale) / (2.0 * r2)


@njit(**SCALAR)
def through_lens(u, v, scale, slope, bent):
    """`distorted` of (u scale, v scale) with its derivative by u and v: numbers, or panels of them.

    slope: derivative of scale by r2; bent: `distorted` with its derivative by u scale and v scale.
    """
    a, b, au, av, bu, bv = bent
    by_u, by_v = 2.0 * u * slope, 2.0 * v * slope
    uu, uv, vv = scale + u * by_u, u * by_v, scale + v * by_v
    return a, b, au * uu + av * uv, au * uv + av * vv, bu * uu + bv * uv, bu * uv + bv * vv


@njit(**SCALAR)
def affine_after(b1, b2, bent):
    """`distorted` after b1 and b2 of a fisheye; as it is where they are 0."""
    a, b, au, av, bu, bv = bent
    return (
        a + (b1 * a + b2 * b), b, au + (b1 * au + b2 * bu), av + (b1 * av + b2 * bv), bu, bv
    )  # fmt: skip


@njit(**SCALAR)
def is_fisheye(interior, row):
    """Whether the lens of a row is a fisheye."""
    return interior.shape[1] > _MODEL and interior[row, np.uint64(_MODEL)] > 0.0


@njit(**SCALAR)
def lens_scale(u, v, interior, row):
    """By what the lens of `row` multiplies the ray (u, v) before its distortion, and the derivative
    by r2: 1 and 0 of a central projection."""
    if is_fisheye(interior, row):
        return equidistant(u * u + v * v)
    return 1.0, 0.0


@njit(**SCALAR)
def distort_normalised(u, v, interior, row, radials):
    """The ray (u, v, 1) distorted, at unit focal length, and its derivative by u and v.

    interior: (m, 16), of which `row` counts; radials: how many radial coefficients to look at.
    Returns a, b, au, av, bu, bv: the pixel is (cx + f a, cy + f b).
    """
    scale, by_r2 = lens_scale(u, v, interior, row)
    return through_lens(
        u, v, scale, by_r2, _bent(u * scale, v * scale, interior, row, radials)
    )  # fmt: skip


@njit(**SCALAR)
def _bent(u, v, interior, row, radials):
    """As `distort_normalised`, of a place behind the lens, of a fisheye u, v times `lens_scale`."""
    r2 = u * u + v * v
    radial = 0.0
    slope = 0.0  # d radial / d r2
    for n in range(radials - 1, -1, -1):
        slope = slope * r2 + radial
        radial = radial * r2 + interior[row, np.uint64(7 + n)]
    slope = slope * r2 + radial
    radial = radial * r2 + 1.0
    p1, p2 = interior[row, np.uint64(3)], interior[row, np.uint64(4)]
    b1, b2 = interior[row, np.uint64(5)], interior[row, np.uint64(6)]
    if is_fisheye(interior, row):
        return affine_after(b1, b2, distorted(u, v, radial, slope, (p1, p2, 0.0, 0.0)))
    return distorted(u, v, radial, slope, (p1, p2, b1, b2))


@njit(**SCALAR)
def distorted(u, v, radial, slope, flat):
    """As `distort_normalised`: numbers, or panels of them.

    radial: the polynomial, 1 included, slope: its derivative by r2; flat: p1, p2, b1, b2.
    """
    p1, p2, b1, b2 = flat
    r2 = u * u + v * v
    # p1 (r2 + 2 u u) + 2 p2 u v = u (2 p1 u + 2 p2 v) + p1 r2
    along, across = 2.0 * p1 * u, 2.0 * p2 * v
    stretch = radial + (along + across)
    by_u, by_v = 2.0 * (u * slope + p1), 2.0 * (v * slope + p2)
    mixed = u * by_v + 2.0 * p1 * v
    return (
        u * stretch + p1 * r2 + (b1 * u + b2 * v),
        v * stretch + p2 * r2,
        stretch + u * by_u + along + b1,
        mixed + b2,
        mixed,
        stretch + v * by_v + across,
    )


@njit(**SCALAR)
def distort(u, v, interior, row, radials):
    """x, y in pixels of the ray (u, v, 1), and their derivative by u and v.

    Arguments as of `distort_normalised`.

    Returns x, y, xu, xv, yu, yv, with x = cx + f * (...).
    """
    f = interior[row, np.uint64(0)]
    a, b, au, av, bu, bv = distort_normalised(u, v, interior, row, radials)
    cx, cy = interior[row, np.uint64(1)], interior[row, np.uint64(2)]
    return cx + f * a, cy + f * b, f * au, f * av, f * bu, f * bv


@njit(**SCALAR)
def interior_columns(u, v, a, b, f, one, zero):
    """Derivative (x, y) of the pixel of the ray (u, v) by each of f, cx, cy, p1, p2, b1, b2.

    u, v: of a fisheye times its `lens_scale`; a, b: the ray distorted (`distort_normalised`), f:
    the focal length; one, zero: of the same kind, numbers or panels. By the radial coefficient n:
    f r2^n (u, v). Of a fisheye those by p and k go through its affinity, and those by b1 and b2
    have a, b before it in place of u, v.
    """
    r2 = u * u + v * v
    mixed = 2.0 * f * u * v
    return (
        (a, b),
        (one, zero),
        (zero, one),
        (f * (r2 + 2.0 * u * u), mixed),
        (mixed, f * (r2 + 2.0 * v * v)),
        (f * u, zero),
        (f * v, zero),
    )


def radials_in_use(interior: np.ndarray) -> int:
    """How many radial coefficients of the vectors (n, 16) are needed: up to the last non-zero."""
    used = np.flatnonzero(interior[:, _FIRST_RADIAL:_MODEL].any(axis=0))
    return int(used[-1]) + 1 if len(used) else 0


@compiled()
def _project_rays(rays, interior, image, radial):
    out = np.empty((rays.shape[0], 2))
    for n in range(rays.shape[0]):
        row = np.uint64(image[n])
        out[n, 0], out[n, 1], _, _, _, _ = distort(rays[n, 0], rays[n, 1], interior, row, radial)
    return out


@compiled()
def _reached(u, v, interior, row, radials):
    """Whether no fold of the distortion lies between the principal point and the ray."""
    r2 = u * u + v * v
    most = 6.0 * (abs(interior[row, 3]) + abs(interior[row, 4])) * np.sqrt(r2)
    power = 1.0
    for n in range(radials):
        power *= r2
        most += (2 * n + 3) * abs(interior[row, 7 + n]) * power
    if most < 0.9:  # The terms of the derivative cannot add up to a fold.
        return True
    for n in range(1, 33):
        _, _, xu, xv, yu, yv = _bent(u * n / 32, v * n / 32, interior, row, radials)
        if xu * yv - xv * yu <= 0.0:
            return False
    return True


@compiled()
def _undistort(pixels, interior, image, radials):
    out = np.empty((pixels.shape[0], 2))
    for n in range(pixels.shape[0]):
        row = np.uint64(image[n])
        f = interior[row, 0]
        x = u = (pixels[n, 0] - interior[row, 1]) / f
        y = v = (pixels[n, 1] - interior[row, 2]) / f
        done = False
        for _ in range(50):
            a, b, xu, xv, yu, yv = _bent(u, v, interior, row, radials)
            ex, ey = x - a, y - b
            det = xu * yv - xv * yu
            if det <= 0.0:  # beyond the fold of the distortion: no ray belongs to this pixel
                break
            du = (yv * ex - xv * ey) / det
            dv = (xu * ey - yu * ex) / det
            longest = max(abs(du), abs(dv))
            damp = min(1.0, 0.5 / longest) if longest > 0.0 else 1.0
            u += damp * du
            v += damp * dv
            if longest * f < 1e-11 * max(1.0, abs(pixels[n, 0]) + abs(pixels[n, 1])):
                done = _reached(u, v, interior, row, radials)
                break
        out[n, 0] = u if done else np.nan
        out[n, 1] = v if done else np.nan
    return out


def _rows(interior: np.ndarray, row: np.ndarray | None, count: int):
    # One kind of array: kernels would be compiled anew for each other.
    table = np.require(np.atleast_2d(interior), float, ["C", "W"])
    rows = np.zeros(count, dtype=np.int64) if row is None else np.require(row, np.int64, ["C", "W"])
    return table, rows, radials_in_use(table)


def project_rays(
    rays: np.ndarray, interior: np.ndarray, row: np.ndarray | None = None
) -> np.ndarray:
    """Pixels (n, 2) of rays u, v (n, 2).

    interior: (16,) for all rays, or (m, 16) with row (n,) saying which belongs to each ray.
    Sources: top of this file.
    """
    rays = np.ascontiguousarray(rays, dtype=float)
    table, rows, radials = _rows(interior, row, len(rays))
    return _project_rays(rays, table, rows, radials)


def project(
    points: np.ndarray,
    centre: np.ndarray,
    rotation: np.ndarray,
    interior: np.ndarray,
    row: np.ndarray | None = None,
) -> np.ndarray:
    """Pixels (n, 2) of ground points; NaN where a point is not in front of the camera.

    points: (n, 3) metres, world.
    centre, rotation: (3,) and (3, 3) for one image, or (n, 3) and (n, 3, 3), world to camera.
    interior: (16,), or (m, 16) with row (n,).
    """
    points = np.asarray(points, dtype=float)
    seen = np.einsum("...ij,...j->...i", rotation, points - centre)
    ahead = seen[:, 2] > 0
    depth = np.where(ahead, seen[:, 2], np.nan)
    return project_rays(seen[:, :2] / depth[:, None], interior, row)


def undistort(
    pixels: np.ndarray, interior: np.ndarray, row: np.ndarray | None = None
) -> np.ndarray:
    """Rays u, v (n, 2) of pixels (n, 2), to better than 1e-9 px: the inverse of `project_rays`.

    NaN where no ray belongs to the pixel: beyond the fold of a strong distortion, or, of a fisheye,
    at 90 degrees or more from the axis.
    """
    pixels = np.ascontiguousarray(pixels, dtype=float)
    table, rows, radials = _rows(interior, row, len(pixels))
    # What the lens has before its distortion, then the ray.
    found = _undistort(pixels, table, rows, radials)
    return _from_lens(found, table, rows, np.nan)


def without_distortion(
    pixels: np.ndarray, interior: np.ndarray, row: np.ndarray | None = None
) -> np.ndarray:
    """As `undistort`, the distortion left out: near by, and where `undistort` has none as well;
    what a fisheye sees beyond 89 degrees from its axis is put there."""
    table, rows, _ = _rows(interior, row, len(pixels))
    inner = table[rows]
    return _from_lens((pixels - inner[:, 1:3]) / inner[:, :1], table, rows, np.tan(_FLATTEST))


def _from_lens(seen: np.ndarray, table: np.ndarray, rows: np.ndarray, beside: float) -> np.ndarray:
    """The rays (n, 2) that lenses take to these places (n, 2) before their distortion. beside:
    length of those that lie farther than `_FLATTEST` from the axis, or NaN: of 90 degrees on."""
    if table.shape[1] > _MODEL and table[:, _MODEL].any():
        mine = np.flatnonzero(table[rows, _MODEL] > 0)
        theta = np.maximum(np.hypot(*seen[mine].T), 1e-12)
        most = np.pi / 2 if np.isnan(beside) else _FLATTEST
        seen[mine] *= (np.where(theta < most, np.tan(theta), beside) / theta)[:, None]
    return seen


# --- the other direction of distortion -------------------------------------------------------


def image_to_ray(pixels: np.ndarray, interior: np.ndarray) -> np.ndarray:
    """Rays u, v (n, 2) where the polynomial takes the image to the ray (DBAT, some MicMac files).

    um = (x - cx) / f, vm = (y - cy) / f, r2 of these; the same polynomial with the same names,
    without b1, b2, gives the corrected u, v.
    """
    c = np.asarray(interior, dtype=float)
    u, v = ((np.asarray(pixels, dtype=float) - c[1:3]) / c[0]).T
    r2 = u * u + v * v
    radial = 1.0 + r2 * np.polynomial.polynomial.polyval(r2, c[_FIRST_RADIAL:_MODEL])
    return np.stack(
        [
            u * radial + c[3] * (r2 + 2 * u * u) + 2 * c[4] * u * v,
            v * radial + c[4] * (r2 + 2 * v * v) + 2 * c[3] * u * v,
        ],
        axis=1,
    )


def fitted(camera: Camera, pixels: np.ndarray, rays: np.ndarray, names: Iterable[str]) -> Camera:
    """The camera whose parameters `names` take rays (n, 2) best to pixels (n, 2).

    camera: where to start; its other parameters are held.
    """
    index = [INTERIOR.index(name) for name in names]
    interior = camera.interior.copy()
    # Ray to image is linear in everything but f, cx, cy; a few steps settle those too.
    for _ in range(8):
        design = interior_derivatives(rays, interior)[:, :, index].reshape(-1, len(index))
        scale = np.linalg.norm(design, axis=0)
        step, *_ = np.linalg.lstsq(
            design / scale, (pixels - project_rays(rays, interior)).ravel(), rcond=1e-14
        )
        interior = interior.copy()
        interior[index] += step / scale
        if np.abs(step).max() < 1e-12:
            break
    return camera.with_interior(interior)


@compiled()
def _derivatives(rays, interior, row):
    out = np.empty((rays.shape[0], 34))
    for n in range(rays.shape[0]):
        i = np.uint64(row[n])
        u, v, f = rays[n, 0], rays[n, 1], interior[i, 0]
        a, b, au, av, bu, bv = distort_normalised(u, v, interior, i, 8)
        out[n, 30], out[n, 31], out[n, 32], out[n, 33] = f * au, f * av, f * bu, f * bv
        scale, _ = lens_scale(u, v, interior, i)
        u, v = u * scale, v * scale
        columns = interior_columns(u, v, a, b, f, 1.0, 0.0)
        for k in range(7):
            out[n, 2 * k], out[n, 2 * k + 1] = columns[k]
        power = f
        for k in range(7, 15):
            power *= u * u + v * v
            out[n, 2 * k], out[n, 2 * k + 1] = power * u, power * v
        if is_fisheye(interior, i):
            b1, b2 = interior[i, 5], interior[i, 6]
            out[n, 10], out[n, 12] = f * (a - b2 * b) / (1.0 + b1), f * b
            for k in (3, 4, 7, 8, 9, 10, 11, 12, 13, 14):
                out[n, 2 * k] += b1 * out[n, 2 * k] + b2 * out[n, 2 * k + 1]
    return out


def interior_derivatives(rays: np.ndarray, interior: np.ndarray) -> np.ndarray:
    """Derivative (n, 2, 15) of the pixels of rays (n, 2) by `INTERIOR`."""
    rays = np.ascontiguousarray(rays, dtype=float)
    table, rows, _ = _rows(interior, None, len(rays))
    return _derivatives(rays, table, rows)[:, :30].reshape(-1, 15, 2).transpose(0, 2, 1)


def ray_derivatives(
    rays: np.ndarray, interior: np.ndarray, row: np.ndarray | None = None
) -> np.ndarray:
    """Derivative (n, 2, 2) of the pixels of rays (n, 2) by u and v; arguments as `project_rays`."""
    rays = np.ascontiguousarray(rays, dtype=float)
    table, rows, _ = _rows(interior, row, len(rays))
    return _derivatives(rays, table, rows)[:, 30:].reshape(-1, 2, 2)


class ProjectionDerivatives(NamedTuple):
    """Of pixels: by the point (n, 2, 3), by the pose (n, 2, 6), centre in the world and turn about
    the camera's axes, R <- Exp(turn) R, and by `INTERIOR` (n, 2, 15)."""

    by_point: np.ndarray
    by_pose: np.ndarray
    by_interior: np.ndarray


def projection_derivatives(
    points: np.ndarray,
    centre: np.ndarray,
    rotation: np.ndarray,
    interior: np.ndarray,
    row: np.ndarray | None = None,
) -> ProjectionDerivatives:
    """Derivatives of the pixels of ground points ahead of the camera; arguments as `project`."""
    seen = np.einsum("...ij,...j->...i", rotation, np.asarray(points, dtype=float) - centre)
    ray = seen[:, :2] / seen[:, 2:]
    table, rows, _ = _rows(interior, row, len(ray))
    made = _derivatives(np.ascontiguousarray(ray), table, rows)
    by_ray = made[:, 30:].reshape(-1, 2, 2)
    along = -np.einsum("nij,nj->ni", by_ray, ray)
    by_seen = np.concatenate([by_ray, along[:, :, None]], axis=2) / seen[:, 2, None, None]
    by_point = by_seen @ rotation
    # d X / d turn = -[X]x, so that the row g becomes X x g.
    by_pose = np.concatenate([-by_point, np.cross(seen[:, None], by_seen)], axis=2)
    by_interior = made[:, :30].reshape(-1, 15, 2).transpose(0, 2, 1)
    return ProjectionDerivatives(by_point, by_pose, by_interior)
