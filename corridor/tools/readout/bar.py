"""Readout time from two photographs of a turning bar, each smeared to a fan by its exposure.

There is no picture at rest, but a fan has two edges: the bar when a row began to be exposed and
when it ended. Along either, and along both wings of the bar,

    angle about the axis = edge + rate y      (mod 180 degrees)

so that readout = rate (L - 1) / angular velocity, and the length of the exposure falls out. The
difference of the two photographs shows nothing but the two fans. The answer depends on the axis
(ten pixels are a tenth of the readout), which is therefore found with the rest.

Source of the measurement: Wallace, camfi (doi 10.5281/zenodo.4971144), who clicked the edges.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from corridor.core.engine.threads import one_thread
from corridor.core.geometry import robust_scale
from corridor.tools.readout.fitting import Fitted, fit
from corridor.tools.readout.lens import Unknown
from corridor.tools.readout.photograph import CannotMeasure
from corridor.tools.readout.result import Readout
from corridor.tools.readout.turning import Known, Turning, bent

_SMALL = 1000  # px
_CIRCLES = 60
_LENS = 0.3  # of the usual doubt about a lens: more is not told apart from the axis
# Edges of one fan that are not straight lines give readout times that differ by this share
# (four edges in the source: 8.3 to 9.5 x 10^4 rows/s, 2.9 % of their mean).
_SYSTEMATIC = 0.03
_REACH = 0.45, 0.93  # of the bar's length: its middle is often overexposed
_METHOD = (
    "edges of the fans to which the bar is smeared, from the difference of two photographs; axis "
    "and rotation per row by robust least squares"
)


def find_bar(first, second):
    """Axis (2,) px and length in px of a bar in two smeared photographs, or None."""
    (one, factor), (two, _) = (photo.shrunk(_SMALL) for photo in (first, second))
    size = one.shape[::-1]
    change = cv2.GaussianBlur(one, (0, 0), 2.0) - cv2.GaussianBlur(two, (0, 0), 2.0)
    change = np.clip(change, -25, 25)
    noise = robust_scale(change, centred=True) + 0.1
    change[np.abs(change) < 2 * noise] = 0
    # Both wings of either fan: the picture is its own image under half a turn about the axis.
    shape = [cv2.getOptimalDFTSize(2 * n) for n in change.shape]
    spectrum = np.fft.rfft2(change, shape)
    own = np.fft.irfft2(spectrum * spectrum, shape)[: 2 * size[1] - 1, : 2 * size[0] - 1]
    row, column = np.unravel_index(np.argmax(own), own.shape)
    axis = np.array([column, row]) / 2
    if own[row, column] < 0.25 * np.sum(change**2):
        return None
    radii = np.arange(8.0, 0.6 * max(size))
    angles = np.arange(360) * np.pi / 180
    x = (axis[0] + radii[:, None] * np.cos(angles)).astype(np.float32)
    y = (axis[1] + radii[:, None] * np.sin(angles)).astype(np.float32)
    around = cv2.remap(change, x, y, cv2.INTER_LINEAR, borderValue=0)
    # A fan is there where the light changes both ways on a good part of the circle.
    seen = np.minimum((around > 0).mean(axis=1), (around < 0).mean(axis=1)) > 0.08
    inside = np.flatnonzero(seen)
    if len(inside) < 30:
        return None
    ends = np.flatnonzero(~seen[inside[0] :])
    reach = radii[inside[0] + (ends[0] if len(ends) else len(seen) - inside[0]) - 1]
    if reach < 0.06 * min(size):
        return None
    return (axis + 0.5) * factor - 0.5, float(reach) * factor


@one_thread()
def measure_bar(first, second, known: Known, found=None) -> Readout:
    """Readout time from two photographs of one bar turning, taken from one place.

    found: what `find_bar` returned, None: looked for. Errors as `measure_star`.
    """
    found = found or find_bar(first, second)
    if found is None:
        raise CannotMeasure(f"{first.name} and {second.name} show no turning bar")
    axis, reach = found
    change = cv2.subtract(first.grey, second.grey, dtype=cv2.CV_32F) / 255
    change = cv2.GaussianBlur(change, (0, 0), max(1.0, reach / 150))
    bars = []
    for row in (1, 0):
        if known.row_direction is None or row == (known.row_direction in ("down", "up")):
            bar = _Bar.measured(change, axis, reach, row, Unknown.of(first))
            bars += [bar] if bar is not None else []
    names = f"{first.name} and {second.name}"
    if not bars:
        raise CannotMeasure(f"{names} show no fans whose edges can be measured")
    bar = max(bars, key=lambda one: one.sharp)
    kept = float(bar.fitted.used.mean())
    if robust_scale(bar.fitted.residuals) > 0.04 * reach or kept < 0.6:
        raise CannotMeasure(f"the edges of the fans in {names} do not follow one turning bar")
    sigma = math.hypot(bar.fitted.sigma(2, bar.cluster), _SYSTEMATIC * bar.rate)
    if abs(bar.rate) < 8 * sigma:
        raise CannotMeasure(
            f"{names} show no wheel at rest, and the turn of a bar smeared in both cannot be "
            "measured to an eighth"
        )
    points = bar.points
    turning = Turning(
        "wheel", (first, second), bar.row, bar.rate, sigma, points.pixels, bar.fitted.residuals,
        bar.fitted.used, points.edge // 2, np.ones(len(points.edge), bool), bar.centre,
        bar.curves(reach),
    )  # fmt: skip
    exposure = 1e3 * bar.width / (2 * math.pi * known.turns_per_second)
    return turning.readout(
        known,
        _METHOD,
        {"exposure_ms": exposure, "axis_px": [float(a) for a in bar.centre]},
        (
            "both photographs are smeared: the edges of the smear took the place of a photograph "
            "at rest",
        ),
    )


def _unwound(change, centre, reach, row, turns=720):
    """Light on circles about an axis, the angle of each sample and its row from the axis."""
    radii = np.linspace(*_REACH, 24)[:, None] * reach
    phi = np.broadcast_to(np.arange(turns) * 2 * np.pi / turns, (24, turns))
    x, y = centre[0] + radii * np.cos(phi), centre[1] + radii * np.sin(phi)
    values = cv2.remap(
        change, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderValue=0
    )
    # Cables and lamps that moved between the photographs count no more than the bar.
    limit = 2 * np.median(np.abs(values)) + 1e-3
    return np.clip(values, -limit, limit), phi, (y if row else x) - centre[row]


def _profile(values, phi, ahead, rate, bins=240):
    """Mean light against the angle of the bar, both wings together, with the rotation undone."""
    angle = (phi - rate * ahead) % np.pi
    index = np.minimum((angle * (bins / np.pi)).astype(int), bins - 1).ravel()
    count = np.bincount(index, minlength=bins) + 1e-9
    return np.bincount(index, weights=values.ravel(), minlength=bins) / count


def _start(change, axis, reach, row):
    """Axis, rate and edges at which the fans, put on top of each other, are sharpest, or None."""
    best = (-1.0, axis, 0.0)
    for size, span, count in ((0.05, 1.2, 25), (0.02, 0.2, 9), (0.008, 0.08, 9)):
        about = best
        for dx in np.arange(-2, 3) * size * reach:
            for dy in np.arange(-2, 3) * size * reach:
                centre = about[1] + np.array([dx, dy])
                values, phi, ahead = _unwound(change, centre, reach, row, 360)
                for rate in about[2] + np.linspace(-span, span, count) / reach:
                    sharp = float(np.sum(_profile(values, phi, ahead, rate) ** 2))
                    if sharp > best[0]:
                        best = (sharp, centre, rate)
    sharp, centre, rate = best
    values, phi, ahead = _unwound(change, centre, reach, row)
    profile = _profile(values, phi, ahead, rate)
    edges = _fans(profile)
    if edges is None:
        return None
    return centre, rate, edges, sharp


def _fans(profile):
    """Edges (4,) in radians of two fans of one width, one bright and one dark, or None."""
    bins = len(profile)
    flat = np.sign(profile) * np.sqrt(np.abs(profile))  # their height varies, their edges not
    twice = np.concatenate([[0.0], np.cumsum(np.concatenate([flat, flat]))])
    best = None
    for width in range(int(0.03 * bins), int(0.7 * bins)):
        sums = twice[width : width + bins] - twice[:bins]
        first, second = int(np.argmax(sums)), int(np.argmin(sums))
        score = (sums[first] - sums[second]) / math.sqrt(width)
        if best is None or score > best[0]:
            best = (score, first, second, width)
    score, first, second, width = best
    if score <= 0:
        return None
    return np.array([first, first + width, second, second + width]) * np.pi / bins


@dataclass(frozen=True)
class _Points:
    """Points on the edges of both fans: pixels (n, 2), edge (n,) 0 to 3, wing (n,) 0 or 1."""

    pixels: np.ndarray
    edge: np.ndarray
    wing: np.ndarray


def _around(centre, radii):
    """Pixels of directions about an axis at radii that broadcast against them."""

    def place(angle):
        return centre + radii[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    return place


def _edges(change, centre, rate, edges, reach, row, wide):
    """Points on the edges of both fans, as centroids of their slopes within `wide` radians."""
    found = []
    window = np.linspace(-wide, wide, 61)
    radii = np.linspace(*_REACH, _CIRCLES)[:, None] * reach
    for k, edge in enumerate(edges):
        # The light rises into the first fan and falls into the second.
        sign = (1 if k < 2 else -1) * (1 if k % 2 == 0 else -1)
        for side in (0, 1):
            rest = edge + side * np.pi + window + np.zeros_like(radii)
            at, turned = bent(_around(centre, radii), rest, rate, row, centre[row])
            at = at.astype(np.float32)
            light = cv2.remap(change, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=0)
            slope = np.maximum(sign * np.gradient(light, axis=1), 0)
            slope[:, [0, -1]] = 0
            top = np.argmax(slope, axis=1)
            weight = slope**2 * (np.abs(np.arange(61) - top[:, None]) <= 9)
            total = weight.sum(axis=1)
            steep = slope.max(axis=1)
            circles = np.flatnonzero((steep > 0.3 * np.median(steep)) & (total > 0))
            place = (weight * np.arange(61)).sum(axis=1)[circles] / total[circles]
            low = np.clip(place.astype(int), 0, 59)
            share, phi = place - low, rest + turned
            angle = phi[circles, low] * (1 - share) + phi[circles, low + 1] * share
            pixels = _around(centre, radii[circles, 0])(angle)
            found.append((pixels, np.full(len(circles), k), np.full(len(circles), side)))
    return _Points(*(np.concatenate(part) for part in zip(*found, strict=True)))


@dataclass(frozen=True)
class _Bar:
    """A turning bar: axis (2,) px, radians a row, the four edges as on the row of the axis, the
    width of the fans (radians), and how sharply both fans lie on top of each other."""

    row: int
    sharp: float
    centre: np.ndarray
    rate: float
    edges: np.ndarray
    width: float
    points: _Points
    fitted: Fitted

    @classmethod
    def measured(cls, change, axis, reach, row, lens):
        """The bar that the fans of a difference of two photographs show, or None."""
        start = _start(change, axis, reach, row)
        if start is None:
            return None
        centre, rate, edges, sharp = start
        for wide in (0.14, 0.1, 0.07, 0.05):
            points = _edges(change, centre, rate, edges, reach, row, wide)
            if len(points.pixels) < 80:
                return None
            bar = cls._fitted(points, (centre, rate, edges, sharp), reach, row, lens)
            centre, rate, edges = bar.centre, bar.rate, bar.edges
        return bar

    @classmethod
    def _fitted(cls, points, start, reach, row, lens):
        """Parameters: axis, rate, distance of the line on the bar from it, edges, lens."""
        centre, rate, edges, sharp = start
        at, edge = points.pixels, points.edge
        side = np.where(points.wing == 0, 1.0, -1.0)

        def model(v):
            away = lens.ideal(at, v[8:]) - lens.ideal(v[None, :2], v[8:])
            far = np.hypot(*away.T)
            turned = np.arctan2(away[:, 1], away[:, 0]) - v[4 + edge]
            turned -= v[2] * (at[:, row] - centre[row]) + side * v[3] / far
            return ((turned + math.pi / 2) % math.pi - math.pi / 2) * far

        def prior(v):
            # The line on the bar was meant to pass the axis.
            distance, moved = v[3:4] / (0.01 * reach), (v[:2] - centre) / (0.1 * reach)
            return np.concatenate([distance, v[8:] / (_LENS * lens.sigmas), moved])

        values = np.concatenate([centre, [rate, 0.0], edges, np.zeros(len(lens.sigmas))])
        steps = np.concatenate([[0.1, 0.1, 1e-7, 1e-2], np.full(4, 1e-5), np.full(4, 1e-4)])
        fitted = fit(model, values, steps, prior, floor=0.1)
        values = fitted.values
        # The rate was against the row of the axis as it was; the edges are told against the new.
        edges = values[4:8] + values[2] * (values[row] - centre[row])
        width = np.mean([(edges[1] - edges[0]) % math.pi, (edges[3] - edges[2]) % math.pi])
        return cls(row, sharp, values[:2], float(values[2]), edges, float(width), points, fitted)

    @property
    def cluster(self):
        """What errs together: points (n,) of one edge and wing."""
        return 2 * self.points.edge + self.points.wing

    def curves(self, reach):
        """Lines of pixels along the edges of either fan, for the drawing."""
        radii = np.linspace(0.05, 1.0, 40) * reach
        both = self.edges[:, None, None] + np.array([0, math.pi])[:, None] + np.zeros(40)
        place = _around(self.centre, radii)
        lines = bent(place, both, self.rate, self.row, self.centre[self.row], 20)[0]
        return [list(lines[k : k + 2].reshape(4, 40, 2)) for k in (0, 2)]
