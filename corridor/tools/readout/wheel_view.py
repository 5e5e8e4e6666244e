"""Where a bicycle wheel is in a picture: its rim as an ellipse, its pose, its polar pictures.

The wheel's frame has the axis at the origin and the radius of the rim's edge as its unit; x, y in
the plane of the rim, z along the axis away from the camera. A circle seen as an ellipse has two
tilts that explain it; both are tried.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from corridor.core.geometry import rotation_from_vector
from corridor.tools.readout.fitting import fit, vertex
from corridor.tools.readout.lens import Calibrated, Unknown
from corridor.tools.readout.photograph import CannotMeasure, Photograph
from corridor.tools.readout.star import meeting_points

_SMALL = 1000  # px, long side of the picture in which the wheel is looked for
_COVER = 0.6  # share of the directions in which the rim is seen


@dataclass(frozen=True)
class Pose:
    """How the wheel is seen in ideal pixels: tilt (rotation vector), axis, size in px, focal.

    lens, bend: what takes stored pixels to ideal ones; bend None: as long as nothing is known.
    """

    tilt: tuple[float, float]
    axis: tuple[float, float]
    size: float
    focal: float
    lens: Calibrated | Unknown
    bend: np.ndarray | None = None

    @property
    def bent(self) -> np.ndarray:
        """The numbers of the lens."""
        return np.zeros(len(self.lens.sigmas)) if self.bend is None else self.bend

    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and axes (3, 3) of the wheel in the camera frame; radius 1."""
        depth = self.focal / self.size
        ray = (np.asarray(self.axis) - self.lens.middle(self.bent)) / self.focal
        return depth * np.append(ray, 1.0), rotation_from_vector([*self.tilt, 0.0])

    def pixels(self, x, y, z=0.0) -> np.ndarray:
        """Stored pixels (..., 2) of places in the wheel's frame."""
        places = np.broadcast_arrays(x, y, z)
        origin, axes = self.frame()
        x, y, z = (part.reshape(-1, 1) for part in places)
        seen = origin + x * axes[:, 0] + y * axes[:, 1] + z * axes[:, 2]
        ideal = self.lens.middle(self.bent) + self.focal * seen[:, :2] / seen[:, 2:]
        return self.lens.stored(ideal, self.bent).reshape(*places[0].shape, 2)

    def on_circles(self, radii, phi) -> np.ndarray:
        """Stored pixels (..., 2) of radii and angles that broadcast against each other."""
        return self.pixels(radii * np.cos(phi), radii * np.sin(phi))

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Camera (3,), directions (n, 3) of pixels in the wheel's frame, depths (n,) of its
        plane."""
        origin, axes = self.frame()
        ahead = np.empty((len(pixels), 3))
        ideal = self.lens.ideal(pixels, self.bent)
        ahead[:, :2] = (ideal - self.lens.middle(self.bent)) / self.focal
        ahead[:, 2] = 1.0
        camera = -axes.T @ origin
        direction = ahead @ axes
        return camera, direction, -camera[2] / direction[:, 2]


class NoWheel(CannotMeasure):
    """A photograph shows no wheel at rest."""


def find_rim(photo: Photograph) -> np.ndarray:
    """Points (n, 2) on the rim of a wheel, px. Raises NoWheel where there is none."""
    small, factor = photo.shrunk(_SMALL)
    found = [rim_about(small, centre) for centre in meeting_points(small, 8)]
    best = max((one for one in found if one), key=lambda one: one[0], default=None)
    if best is None or best[1] < _COVER:
        raise NoWheel(
            f"{photo.name} shows no wheel: no rim around a point at which spokes meet was found"
        )
    return (best[2] + 0.5) * factor - 0.5


def rim_about(small, centre, angles=360, seed=0):
    """Score, cover and points of the best ellipse about a centre, or None."""
    height, width = small.shape
    most = 0.75 * max(height, width)
    radii = np.arange(0.06 * min(height, width), most)
    phi = np.arange(angles) * 2 * np.pi / angles
    x = (centre[0] + radii * np.cos(phi)[:, None]).astype(np.float32)
    y = (centre[1] + radii * np.sin(phi)[:, None]).astype(np.float32)
    inside = (x >= 1) & (y >= 1) & (x <= width - 2) & (y <= height - 2)
    polar = cv2.remap(small, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    polar = cv2.GaussianBlur(polar, (0, 0), sigmaX=1.2, sigmaY=1.5)
    slope = np.gradient(polar, axis=1) * inside
    best = None
    random = np.random.default_rng(seed)
    for sign in (1, -1):
        edge = np.maximum(sign * slope, 0)
        peak = (edge >= np.roll(edge, 1, 1)) & (edge >= np.roll(edge, -1, 1)) & (edge > 1.5)
        strength = np.where(peak, np.minimum(edge / 12.0, 1.0), 0)
        if (strength > 0.15).sum() < 100:
            continue
        for shape in _guesses(strength, radii, phi, random):
            found = _settled(strength, radii, phi, shape)
            if found is None or (best is not None and found[0] <= best[0]):
                continue
            score, cover, r, a = found
            points = centre + np.stack([r * np.cos(a), r * np.sin(a)], axis=1)
            best = (score, cover, points)
    return best


def _guesses(strength, radii, phi, random, count=12000, kept=6):
    """Curves r(phi), ellipses whose middle may lie beside the pole, that many edges are near."""
    row, column = np.nonzero(strength > 0.15)
    chance = strength[row, column] / strength[row, column].sum()
    pick = random.choice(len(row), (count, 3), p=chance)
    r, a = radii[column[pick]], phi[row[pick]]
    shift = random.normal(0, 0.05, (count, 2)) * r.mean(axis=1, keepdims=True)
    r = r - shift[:, :1] * np.cos(a) - shift[:, 1:] * np.sin(a)
    # 1 / r2 = p + q cos 2a + s sin 2a: an ellipse about its middle through three points.
    matrix = np.stack([np.ones_like(a), np.cos(2 * a), np.sin(2 * a)], axis=-1)
    good = (np.abs(np.linalg.det(matrix)) > 0.05) & (r.min(axis=1) > 0.6 * r.max(axis=1))
    shape = np.linalg.solve(matrix[good], (1 / r[good] ** 2)[..., None])[..., 0]
    round_ = np.hypot(shape[:, 1], shape[:, 2]) < 0.45 * shape[:, 0]
    shape, shift = shape[round_], shift[good][round_]
    if not len(shape):
        return []
    some = np.arange(0, len(phi), 3)
    spread = cv2.dilate(strength.astype(np.float32), np.ones((1, 7), np.uint8))[some]
    at = phi[some]
    predicted = 1 / np.sqrt(shape @ np.stack([np.ones_like(at), np.cos(2 * at), np.sin(2 * at)]))
    predicted += shift @ np.stack([np.cos(at), np.sin(at)])
    score, _ = _score(spread, radii, predicted)
    best = np.argsort(-score)[:kept]
    return [(one, at) for one in predicted[best]]


def _score(spread, radii, predicted):
    index = np.round(predicted - radii[0]).astype(int)
    ok = (index >= 0) & (index < len(radii))
    value = spread[np.arange(spread.shape[0]), np.clip(index, 0, len(radii) - 1)] * ok
    hit = (value > 0.1).mean(axis=1)
    # Of rims of one strength the larger is the better known.
    return value.mean(axis=1) * hit**2 * np.maximum(predicted.mean(axis=1), 1) ** 0.3, hit


def _waves(phi):
    return np.stack(
        [np.ones_like(phi), np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)]
        + [np.cos(3 * phi), np.sin(3 * phi)],
        axis=1,
    )


def _settled(strength, radii, phi, shape):
    """A curve pulled onto the edges near it: score, cover and its points (r, phi), or None."""
    predicted, at = shape
    terms, *_ = np.linalg.lstsq(_waves(at), predicted, rcond=None)
    curve = _waves(phi)
    for wide in (6, 4, 3):
        expected = curve @ terms
        near = np.abs(radii - expected[:, None]) <= wide
        value = np.where(near, strength, 0)
        top = np.argmax(value, axis=1)
        hit = value[np.arange(len(phi)), top] > 0.1
        if hit.mean() < 0.4:
            return None
        terms, *_ = np.linalg.lstsq(curve[hit], radii[top[hit]], rcond=None)
    rest = np.abs(radii[top] - curve @ terms)
    hit &= rest < 2.5
    expected = curve @ terms
    if expected.min() <= 0 or np.hypot(terms[3], terms[4]) > 0.25 * terms[0]:
        return None
    spread = cv2.dilate(strength.astype(np.float32), np.ones((1, 3), np.uint8))
    score, cover = _score(spread, radii, expected[None])
    return float(score[0]), float(cover[0]), radii[top[hit]], phi[hit]


def poses_of(points: np.ndarray, lens: Calibrated | Unknown) -> list[Pose]:
    """The poses, one or two, in which a circle is seen as the points (n, 2) of its rim."""
    ideal = lens.ideal(points, np.zeros(len(lens.sigmas)))
    middle = ideal.mean(axis=0)
    away = ideal - middle
    (_, (long, short), angle) = cv2.fitEllipse(ideal.astype(np.float32))
    if long < short:
        long, short, angle = short, long, angle + 90
    tilt = math.acos(min(1.0, short / long))
    hinge = math.radians(angle)

    def pose_of(values):
        return Pose(tuple(values[:2]), tuple(values[2:4]), math.exp(values[4]), lens.focal, lens)

    def off_the_rim(values):
        pose = pose_of(values)
        camera, direction, depth = pose.rays(points)
        hit = camera[:2] + depth[:, None] * direction[:, :2]
        return (np.hypot(*hit.T) - 1) * pose.size

    found = []
    for sign in (1, -1):
        leaning = sign * tilt * math.cos(hinge), sign * tilt * math.sin(hinge)
        start = np.array([*leaning, *middle, math.log(np.hypot(*away.T).max())])
        steps = np.array([1e-4, 1e-4, 0.1, 0.1, 1e-4])
        found.append(pose_of(fit(off_the_rim, start, steps).values))
    return found


def directions(count: int) -> np.ndarray:
    """Angles (count,) all around, radians."""
    return np.arange(count) * 2 * np.pi / count


def polar(light, pose, radii, count, row):
    """Light (circles, count) on circles of the wheel and the stored rows it was read at."""
    at = pose.on_circles(radii[:, None], directions(count))
    return sample(light, at), at[..., row]


def sample(light, at):
    """Values of a picture at pixels (m, n, 2); NaN outside."""
    return cv2.remap(
        light, at.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )  # fmt: skip


def rim_edge(light, pose, sign, reach=0.03, angles=180) -> np.ndarray:
    """Points (n, 2) px at which the rim's edge is seen near a pose, to a fraction of a pixel.

    sign: +1 where light grows outwards across the edge. Directions in which a spoke or something
    else hides the edge are left out as far as they stand out.
    """
    phi = directions(angles)
    half = int(math.ceil(2 * reach * pose.size))
    radii = 1 + np.arange(-half - 2, half + 3) / (2.0 * pose.size)  # half pixels
    slope = sign * np.gradient(sample(light, pose.on_circles(radii, phi[:, None])), axis=1)
    slope = np.where(np.isfinite(slope), slope, 0.0)
    slope = cv2.GaussianBlur(slope, (0, 0), sigmaX=1.5, sigmaY=1e-3)
    typical = np.median(slope.max(axis=1))
    inner = slope[:, 2:-2]
    top = np.argmax(inner, axis=1)
    good = (top > 0) & (top < inner.shape[1] - 1)
    top = np.clip(top, 1, inner.shape[1] - 2)
    a, b, c = (inner[np.arange(angles), top + d] for d in (-1, 0, 1))
    good &= (b > 0.4 * typical) & (a - 2 * b + c < 0)
    r = np.interp(top + vertex(a, b, c) + 2, np.arange(len(radii)), radii)[good]
    return pose.on_circles(r, phi[good])


def rim_sign(light, pose) -> int:
    """+1 where the light grows outwards across the rim's edge, -1 where it falls."""
    step = 1.5 / pose.size
    values, _ = polar(light, pose, np.array([1 - step, 1 + step]), 360, 1)
    return 1 if np.nanmedian(values[1] - values[0]) > 0 else -1


def moved(static, rotating, pose) -> Pose:
    """The pose in the second picture, from the rim, which turning does not change."""
    phi = directions(180)
    reach = np.linspace(0.75, 1.25, int(np.clip(0.5 * pose.size, 60, 500)))
    step = reach[1] - reach[0]
    at = pose.on_circles(reach, phi[:, None])
    first, second = (np.gradient(np.nan_to_num(sample(p, at)), axis=1) for p in (static, rotating))
    middle = slice(int(0.15 / step), int(0.35 / step))  # 0.9 to 1.1
    most = int(0.1 / step)
    scores = []
    for shift in range(-most, most + 1):
        window = slice(middle.start + shift, middle.stop + shift)
        a, b = first[:, middle], second[:, window]
        scores.append(
            (a * b).sum(axis=1) / np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1) + 1e-9)
        )
    scores = np.array(scores)
    # One shift and scale for all directions, by voting on a grid, then least squares.
    limit = np.arange(-most, most + 1) * step
    coarse = np.linspace(-0.08, 0.08, 17)
    grid = np.meshgrid(np.linspace(-0.02, 0.02, 5), coarse, coarse, indexing="ij")
    tried, design = np.stack(grid, axis=-1).reshape(-1, 3), _waves(phi)[:, :3]
    index = np.round((tried @ design.T - limit[0]) / step).astype(int)
    inside = (index >= 0) & (index < len(limit))
    votes = scores[np.clip(index, 0, len(limit) - 1), np.arange(180)] * inside
    values = tried[np.argmax(votes.sum(axis=1))]
    for width in (0.02, 0.01, 0.006):
        want = design @ values
        near = np.abs(limit[:, None] - want) < width
        local = np.where(near, scores, -2)
        top = np.argmax(local, axis=0)
        good = local[top, np.arange(180)] > 0.5
        if good.sum() < 40:
            break
        values, *_ = np.linalg.lstsq(design[good], limit[top[good]], rcond=None)
    _, axes = pose.frame()
    shift = pose.size * (values[1] * axes[:2, 0] + values[2] * axes[:2, 1])
    return replace(
        pose,
        axis=(pose.axis[0] + shift[0], pose.axis[1] + shift[1]),
        size=pose.size * (1 + values[0]),
    )
