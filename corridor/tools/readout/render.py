"""Photographs a rolling shutter would take of a turning star or wheel, or of a blinking LED.

Every row is exposed at its own time, `t(row) = readout (row / (L - 1) - 1/2)`,
the middle of its exposure; the exposure is integrated in closed form (star, LED) or piecewise
over fractions of a degree (wheel), and so is the width of a pixel across an edge. No picture is
rotated or resampled.

Angles grow clockwise in the picture (y points down), so `turns_per_second` is positive for a
clockwise target. A target has its axis at the origin; lengths on it are metres. Light is linear,
0 to 1, until `develop` turns it into the 8-bit values of a photograph.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from corridor.core.camera import ROW_DIRECTIONS, Camera, undistort
from corridor.core.engine.compiled import compiled
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector

_FINEST = math.radians(0.25)  # turn of the wheel within which a spoke moves on a straight line


@dataclass(frozen=True)
class Shutter:
    """A rolling shutter: seconds from the first row to the last, and their sense.

    exposure_s: time for which each row is exposed. row_direction: down, up, right or left,
    the way rows follow each other in the stored picture.
    Raises InputError where one of them makes no sense.
    """

    readout_s: float
    exposure_s: float = 0.0
    row_direction: str = "down"

    def __post_init__(self):
        if self.row_direction not in ROW_DIRECTIONS:
            raise InputError(f"row_direction = {self.row_direction!r}: use {ROW_DIRECTIONS}")
        if not (self.readout_s >= 0 and self.exposure_s >= 0):
            raise InputError("readout_s and exposure_s are seconds and not negative")

    def times(self, width: int, height: int) -> tuple[np.ndarray, bool]:
        """Seconds of the rows (or columns) from the middle one, and whether they are columns."""
        across = self.row_direction in ("left", "right")
        count = width if across else height
        times = self.readout_s * (np.arange(count) / max(count - 1, 1) - 0.5)
        return (times if self.row_direction in ("down", "right") else -times), across


@dataclass(frozen=True)
class View:
    """How a camera sees the target.

    axis: pixel at which the axis meets the plane of the target; default the principal point.
    distance: metres from the camera to that point, along the optical axis.
    tilt_deg: angle between the axis of the target and the optical axis; tilt_towards_deg: the
    direction in the picture (clockwise from x) in which the target falls away from the camera.
    """

    camera: Camera
    distance: float = 2.0
    tilt_deg: float = 0.0
    tilt_towards_deg: float = 0.0
    axis: tuple[float, float] | None = None

    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) of the target and its x, y, z (columns of (3, 3)) in the camera frame."""
        interior = self.camera.interior
        pixel = interior[1:3] if self.axis is None else np.asarray(self.axis, dtype=float)
        ray = undistort(pixel[None], interior)[0]
        if not np.all(np.isfinite(ray)):
            raise InputError(f"axis = {tuple(pixel)}: no ray of this camera goes there")
        towards = math.radians(self.tilt_towards_deg)
        hinge = np.array([math.sin(towards), -math.cos(towards), 0.0])
        axes = rotation_from_vector(math.radians(self.tilt_deg) * hinge)
        return self.distance * np.append(ray, 1.0), axes


@dataclass(frozen=True)
class Star:
    """A Siemens star of black and white sectors, together `sectors` of them.

    radius, hub: metres; inside the hub it is black. white, black: light.
    Raises InputError where `sectors` is odd or below 2.
    """

    sectors: int = 16
    radius: float = 0.5
    hub: float = 0.02
    white: float = 0.8
    black: float = 0.05

    def __post_init__(self):
        if self.sectors < 2 or self.sectors % 2:
            raise InputError(f"sectors = {self.sectors}: a star has an even number, 2 or more")

    def light(self, view: View, across: bool, turned: np.ndarray, turn: float) -> np.ndarray:
        """Light and cover (rows, columns, 2), see `Wheel.light`."""
        smear, period = max(abs(turn), 1e-6), 4 * math.pi / self.sectors
        x, y = _on_the_plane(view, across)
        middle, half = 0.5 * (self.white + self.black), 0.5 * (self.white - self.black)
        return _star(x, y, turned, smear, period, (self.hub, self.radius), middle, half)


@dataclass(frozen=True)
class Wheel:
    """A bicycle wheel; lengths in metres.

    radius: of the rim; `tyre` stands out beyond it, a rim of the same width inside.
    spokes, crosses, hub_radius, flange: lacing, see `lacing`. valve: a stub on the rim.
    spoke_light, dark: light of spokes and rim, and of the tyre.
    """

    spokes: int = 36
    crosses: int = 3
    radius: float = 0.3
    hub_radius: float = 0.022
    flange: float = 0.03
    spoke_width: float = 0.002
    tyre: float = 0.035
    valve: bool = True
    spoke_light: float = 0.7
    dark: float = 0.03

    def lacing(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle of each spoke at the hub and at the rim (radians), height of its flange (m).

        Neighbours at the rim belong to opposite flanges; on a flange every other spoke leans the
        other way, by `crosses` spokes of its flange. Heights are along the axis, away from the
        camera.
        """
        number = np.arange(self.spokes)
        rim = 2 * np.pi * number / self.spokes
        lean = np.where((number // 2) % 2 == 0, 1.0, -1.0)
        hub = rim + lean * self.crosses * 2 * np.pi / max(self.spokes / 2, 1)
        return hub, rim, np.where(number % 2 == 0, 1.0, -1.0) * self.flange

    def parts(self) -> tuple[np.ndarray, np.ndarray]:
        """What the wheel is made of: bars (spokes, valve) and circles.

        Returns a row (7,) for each bar: radius (m), angle (radians) and height (m) of its inner
        end, the same of its outer end, width (m); and the radii (4,), m, of hub, rim inside, rim
        outside and tyre.
        """
        hub_angle, rim_angle, height = self.lacing()
        inner = self.radius - 0.6 * self.tyre
        ends = np.zeros((self.spokes + int(self.valve), 7))
        own = ends[: self.spokes]
        own[:, 0], own[:, 1], own[:, 2] = self.hub_radius, hub_angle, height
        own[:, 3], own[:, 4], own[:, 6] = inner, rim_angle, self.spoke_width
        if self.valve:
            half = rim_angle[:2].mean() if self.spokes > 1 else 0.5
            ends[-1] = [inner - 0.04, half, 0.0, inner, half, 0.0, 0.008]
        rims = [self.hub_radius * 1.15, inner, self.radius, self.radius + self.tyre]
        return ends, np.array(rims)

    def light(self, view: View, across: bool, turned: np.ndarray, turn: float) -> np.ndarray:
        """Light and cover (rows, columns, 2) of the target as the sensor's rows see it.

        across: rows of the sensor are columns of the picture. turned: (rows,) radians by which it
        has turned in the middle of a row's exposure; turn: radians during one exposure.
        """
        rays = _rays(_key(view.camera))
        u, v = (np.ascontiguousarray(a.T) if across else a for a in rays)
        origin, axes = view.pose()
        pieces = max(1, math.ceil(abs(turn) / _FINEST))
        seen = (*_on_the_plane(view, across), u, v)
        camera = origin, np.ascontiguousarray(axes), view.camera["f"]
        ends, circles = self.parts()
        shades = (self.spoke_light, self.dark)
        return _wheel(seen, camera, turned, turn, pieces, ends, circles, shades)


def star(
    view: View, shutter: Shutter, turns_per_second: float = 0.0,
    *, phase_deg: float = 0.0, background: np.ndarray | float = 0.3, **drawn,
) -> np.ndarray:  # fmt: skip
    """Linear light (height, width) of a turning Siemens star; drawn: fields of `Star`.

    phase_deg: angle of the first edge, clockwise, at the middle row.
    background: light beside the star, one number or a picture.
    """
    return _turning(Star(**drawn), view, shutter, turns_per_second, phase_deg, background)


def wheel(
    view: View, shutter: Shutter, turns_per_second: float = 0.0,
    *, phase_deg: float = 0.0, background: np.ndarray | float = 0.2, **drawn,
) -> np.ndarray:  # fmt: skip
    """Linear light (height, width) of a turning bicycle wheel; drawn: fields of `Wheel`.

    phase_deg: angle of the first spoke at the rim, clockwise, at the middle row.
    background: light behind the wheel, one number or a picture.
    """
    return _turning(Wheel(**drawn), view, shutter, turns_per_second, phase_deg, background)


def _turning(target, view, shutter, turns_per_second, phase_deg, background):
    """A target over what is behind it."""
    times, across = shutter.times(view.camera.width, view.camera.height)
    omega = 2 * math.pi * turns_per_second
    turned = math.radians(phase_deg) + omega * times
    light = target.light(view, across, turned, omega * shutter.exposure_s)
    if across:
        light = np.ascontiguousarray(light.transpose(1, 0, 2))
    return light[..., 0] + (1 - light[..., 1]) * background


def led(
    camera: Camera,
    shutter: Shutter,
    frequency_hz: float,
    *,
    duty: float = 0.5,
    phase: float = 0.0,
    light: np.ndarray | float = 0.8,
    ambient: np.ndarray | float = 0.02,
) -> np.ndarray:
    """Linear light (height, width) of a surface lit by a LED that blinks `frequency_hz` times a
    second and is on for the share `duty` of each period.

    light, ambient: what the LED and what all else gives where it shines all the time; numbers or
    pictures. Values above 1 are for `develop` to clip. phase: in periods, at the middle row.
    """
    times, across = shutter.times(camera.width, camera.height)
    on = np.array([_on_share(t, shutter.exposure_s, frequency_hz, duty, phase) for t in times])
    field = np.zeros((camera.height, camera.width))
    field += on[None, :] if across else on[:, None]
    return field * light + ambient


def develop(
    light: np.ndarray,
    *,
    noise: float = 0.0,
    blur_px: float = 0.0,
    vignette: float = 0.0,
    seed: int | None = None,
) -> np.ndarray:
    """The photograph, 8 bit sRGB (height, width), of linear light.

    blur_px: standard deviation of the lens's blur. vignette: loss of light in the corners, share.
    noise: standard deviation at full light, falling with its root to a tenth in the dark.
    Source of the curve: IEC 61966-2-1.
    """
    light = np.asarray(light, dtype=np.float32)
    if blur_px > 0:
        light = cv2.GaussianBlur(light, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
    if vignette > 0:
        height, width = light.shape
        y = np.linspace(-1, 1, height, dtype=np.float32)[:, None]
        x = np.linspace(-1, 1, width, dtype=np.float32)
        light = light * (1 - vignette * (x * x + y * y) / 2)
    if noise > 0:
        random = np.random.default_rng(seed).standard_normal(light.shape, dtype=np.float32)
        light = light + noise * np.sqrt(np.clip(light, 0.01, 1)) * random
    return _SRGB[np.clip(light * (_SRGB.size - 1) + 0.5, 0, _SRGB.size - 1).astype(np.uint16)]


_LINEAR = np.linspace(0, 1, 1 << 14)
_CODED = np.where(_LINEAR <= 0.0031308, 12.92 * _LINEAR, 1.055 * _LINEAR ** (1 / 2.4) - 0.055)
_SRGB = np.round(255 * _CODED).astype(np.uint8)


def _key(camera):
    return camera.width, camera.height, camera.interior.tobytes()


@lru_cache(maxsize=2)
def _rays(key):
    """Rays u, v, each (height, width), of all pixels."""
    width, height, interior = key[0], key[1], np.frombuffer(key[2])
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    rays = undistort(pixels, interior)
    if not np.all(np.isfinite(rays)):
        raise InputError("the distortion of the camera folds inside the picture")
    return tuple(np.ascontiguousarray(part.reshape(height, width)) for part in rays.T)


def _on_the_plane(view, across):
    """Metres X, Y on the target's plane of all pixels, rows of the sensor first."""
    x, y = _plane(_key(view.camera), *(tuple(a.ravel()) for a in view.pose()))
    return (np.ascontiguousarray(x.T), np.ascontiguousarray(y.T)) if across else (x, y)


@lru_cache(maxsize=2)
def _plane(key, origin, axes):
    axes = np.reshape(axes, (3, 3))
    u, v = _rays(key)
    to_plane = np.linalg.inv(np.column_stack([axes[:, 0], axes[:, 1], origin]))
    x, y, depth = (row[0] * u + row[1] * v + row[2] for row in to_plane)
    depth = np.where(depth > 1e-9, depth, np.nan)
    return x / depth, y / depth


@compiled(error_model="numpy")
def _second_integral(angle, period):
    """Second antiderivative, periodic, of the square wave +1, -1."""
    a = angle - period * math.floor(angle / period)
    half = 0.5 * period
    if a < half:
        return 0.5 * a * (a - half)
    a -= half
    return -0.5 * a * (a - half)


@compiled(error_model="numpy")
def _star(x, y, turned, smear, period, circles, middle, half):
    """Light and cover of a star: the square wave under two boxes, exposure and pixel."""
    rows, columns = x.shape
    hub, radius = circles
    out = np.zeros((rows, columns, 2))
    for i in range(rows):
        for j in range(columns):
            px, py = x[i, j], y[i, j]
            r = math.sqrt(px * px + py * py)
            k = j + 1 if j + 1 < columns else j - 1
            pixel = math.hypot(x[i, k] - px, y[i, k] - py)
            cover = (radius - r) / pixel + 0.5
            if not cover > 0.0:
                continue
            cover = min(cover, 1.0)
            wave = -1.0
            if r > hub:
                wide = min(pixel / r, 2.0)
                a = math.atan2(py, px) - turned[i]
                high, low = 0.5 * (smear + wide), 0.5 * (smear - wide)
                wave = (
                    _second_integral(a + high, period)
                    - _second_integral(a + low, period)
                    - _second_integral(a - low, period)
                    + _second_integral(a - high, period)
                ) / (smear * wide)
            out[i, j, 0] = cover * (middle + half * wave)
            out[i, j, 1] = cover
    return out


@compiled(error_model="numpy")
def _clamped(x, half):
    """Integral from 0 to x of the clamp to -half .. half."""
    size = abs(x)
    return 0.5 * x * x if size < half else half * size - 0.5 * half * half


@compiled(error_model="numpy")
def _covered(d0, d1, half):
    """Mean share of a pixel under a band of half width `half` that moves from d0 to d1 (px)."""
    if abs(d1 - d0) < 1e-4:
        d = 0.5 * (d0 + d1)
        low, high = max(d - 0.5, -half), min(d + 0.5, half)
        return max(high - low, 0.0)
    return (
        _clamped(d1 + 0.5, half)
        - _clamped(d1 - 0.5, half)
        - _clamped(d0 + 0.5, half)
        + _clamped(d0 - 0.5, half)
    ) / (d1 - d0)


@compiled(error_model="numpy")
def _share(r, edge, pixel):
    """Share of a pixel at distance r from the axis that lies inside the circle `edge`."""
    return min(max((edge - r) / pixel + 0.5, 0.0), 1.0)


@compiled(error_model="numpy")
def _wheel(seen, camera, turned, turn, pieces, ends, circles, shades):
    """Light and cover of a wheel.

    seen: of the pixels as the sensor's rows see them x, y, metres on the target's plane, and rays
    u, v, each (rows, columns). camera: origin (3,) and axes (3, 3) of the target in the camera
    frame, focal length in px. circles: hub, rim inside, rim outside, tyre.
    """
    x, y, u, v = seen
    origin, axes, focal = camera
    bright, dark = shades
    rows, columns = x.shape
    count = ends.shape[0]
    out = np.zeros((rows, columns, 2))
    line = np.empty((count, pieces + 1, 3))
    along = np.empty((count, 4))
    wide = np.empty(count)
    reach = np.empty(count)
    a, b = np.empty(3), np.empty(3)
    for i in range(rows):
        for s in range(count):
            far = 0.0
            for k in range(pieces + 1):
                theta = turned[i] + turn * (k / pieces - 0.5)
                for n in range(3):
                    a[n] = origin[n] + axes[n, 2] * ends[s, 2]
                    a[n] += axes[n, 0] * ends[s, 0] * math.cos(ends[s, 1] + theta)
                    a[n] += axes[n, 1] * ends[s, 0] * math.sin(ends[s, 1] + theta)
                    b[n] = origin[n] + axes[n, 2] * ends[s, 5]
                    b[n] += axes[n, 0] * ends[s, 3] * math.cos(ends[s, 4] + theta)
                    b[n] += axes[n, 1] * ends[s, 3] * math.sin(ends[s, 4] + theta)
                n0 = a[1] * b[2] - a[2] * b[1]
                n1 = a[2] * b[0] - a[0] * b[2]
                n2 = a[0] * b[1] - a[1] * b[0]
                scale = focal / math.hypot(n0, n1)
                line[s, k, 0], line[s, k, 1], line[s, k, 2] = n0 * scale, n1 * scale, n2 * scale
                if k == pieces // 2:
                    au, av, bu, bv = a[0] / a[2], a[1] / a[2], b[0] / b[2], b[1] / b[2]
                    size = (bu - au) ** 2 + (bv - av) ** 2
                    along[s, 0], along[s, 1] = (bu - au) / size, (bv - av) / size
                    along[s, 2] = -(au * along[s, 0] + av * along[s, 1])
                    along[s, 3] = math.sqrt(size) * focal
                    wide[s] = 0.5 * ends[s, 6] * focal * 2 / (a[2] + b[2])
                    far = math.sqrt(size) * focal
            reach[s] = wide[s] + 2.0 + abs(turn) * 1.3 * far
        for j in range(columns):
            px, py = x[i, j], y[i, j]
            r = math.sqrt(px * px + py * py)
            k = j + 1 if j + 1 < columns else j - 1
            pixel = math.hypot(x[i, k] - px, y[i, k] - py)
            if not r < circles[3] + pixel:
                continue
            clear = 1.0
            if r < circles[1] + pixel:
                for s in range(count):
                    d = line[s, 0, 0] * u[i, j] + line[s, 0, 1] * v[i, j] + line[s, 0, 2]
                    if abs(d) > reach[s]:
                        continue
                    at = along[s, 0] * u[i, j] + along[s, 1] * v[i, j] + along[s, 2]
                    inside = min(at, 1.0 - at) * along[s, 3] + 0.5
                    if inside <= 0.0:
                        continue
                    part = 0.0
                    for k in range(1, pieces + 1):
                        e = line[s, k, 0] * u[i, j] + line[s, k, 1] * v[i, j] + line[s, k, 2]
                        part += _covered(d, e, wide[s])
                        d = e
                    clear *= 1.0 - min(inside, 1.0) * part / pieces
            light, cover = bright * (1.0 - clear), 1.0 - clear
            disc = _share(r, circles[0], pixel)
            light, cover = light * (1 - disc) + 2.5 * dark * disc, cover * (1 - disc) + disc
            rim = 1.0 - _share(r, circles[1], pixel)
            light, cover = light * (1 - rim) + bright * rim, cover * (1 - rim) + rim
            rubber = 1.0 - _share(r, circles[2], pixel)
            light = light * (1 - rubber) + dark * rubber
            outer = _share(r, circles[3], pixel)
            out[i, j, 0], out[i, j, 1] = light * outer, cover * outer
    return out


def _on_share(time, exposure, frequency, duty, phase):
    """Share of the exposure during which the LED is on."""

    def lit(periods):  # periods of light up to this time
        whole = math.floor(periods)
        return whole * duty + min(periods - whole, duty)

    at = time * frequency + phase
    length = exposure * frequency
    if length < 1e-9:
        return 1.0 if at - math.floor(at) < duty else 0.0
    return (lit(at + length / 2) - lit(at - length / 2)) / length
