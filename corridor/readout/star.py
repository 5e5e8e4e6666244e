"""Readout time from a Siemens star, one photograph at rest and one while it turns.

A star's edges meet in one point, so a perspective takes them to lines through one point whose
directions follow from two numbers (p, q): with M = [[1 + p, q], [q, 1 - p]] the edge at the
angle a on the star is seen in the direction M (cos a, sin a). While rows are read one after the
other the star turns, so that on the row y

    angle of M^-1 (x - c) = edge + phase + rate y

with one `rate` for the picture, whatever the distance from the centre: readout = rate (L - 1) /
angular velocity. This is eq. 7.5 of Zhou 2019 for every edge and radius at once; its eq. 7.7 uses
pairs of points on one circle, with the centre given.
(Eq. 7.4 prints A2 where the moved point A2' is meant.)

Source: Zhou 2019, section 7.4.2.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from corridor.geometry import robust_scale
from corridor.readout.fitting import fit, sigma_of, single_threaded
from corridor.readout.lens import lens_for
from corridor.readout.photograph import CannotMeasure, Photograph, same_size
from corridor.readout.result import Readout, of_turning

_SMALL = 900  # px, long side of the picture in which the star is looked for
_CIRCLES = 120  # of which fewer are used where there are many sectors
_EDGES = 3200  # edges a picture, about
_FEWEST = 5  # px of a sector along the innermost circle
_FEWEST_SECTORS = 6  # two lines through one point fit any perspective
_LIKELY = 0.5  # of the best share: what may become the best by moving the centre
_CONTRAST = 0.7  # of an edge's own median, where nothing covers it
_WITHIN = 0.96  # of the radius to the rim
_METHOD = (
    "edges of the star on many circles of both photographs; centre, perspective, phase and "
    "rotation per row by robust least squares"
)


@dataclass
class _Seen:
    """A star in one picture: where, and how it is bent."""

    centre: np.ndarray
    p: float = 0.0
    q: float = 0.0
    phase: float = 0.0
    rate: float = 0.0  # radians per row


@single_threaded
def measure_star(
    static: Photograph,
    rotating: Photograph,
    turns_per_second: float,
    *,
    speed_sigma_percent: float = 0.0,
    sense: str | None = None,
    row_direction: str | None = None,
    sectors: int | None = None,
    camera=None,
) -> Readout:
    """Readout time from a star at rest and the same star turning.

    turns_per_second: speed of the star, its standard error in per cent beside it.
    sense, row_direction: what is known of them in the stored picture. sectors: black and white
    ones together, None: counted. camera: a calibrated `corridor.camera.Camera` or None.
    Raises InputError where the pictures do not fit each other or what is given, CannotMeasure
    where they show no star, or one that does not turn.
    """
    same_size(static, rotating)
    lens = lens_for(static, camera)
    centre, count, reach = _find(static, sectors)
    if count < _FEWEST_SECTORS:
        raise CannotMeasure(
            f"the star in {static.name} has {count} sectors, whose edges do not tell from which "
            f"side it is seen: use one of {_FEWEST_SECTORS} sectors or more"
        )
    lights = static.light(), rotating.light()
    still = _Seen(centre)
    still.phase = _scan(lights[0], lens, still, count, reach, "y", [0.0])[2]
    axis, start = _start(rotating, lights[1], lens, still, count, reach)
    fitted = _fit(lights, lens, [still, start], count, reach, axis)
    rate, sigma = _rate(fitted, (static, rotating), axis, count, lens)
    return of_turning(
        axis,
        static.height if axis == "y" else static.width,
        rate,
        sigma,
        turns_per_second,
        speed_sigma_percent,
        sense,
        row_direction,
        target="star",
        method=_METHOD,
        extra={
            "sectors": count,
            "residual_px": [
                robust_scale(fitted["residuals"][fitted["which"] == k]) for k in range(2)
            ],
        },
        drawing=_drawing(fitted, (static, rotating), axis, count, reach, lens),
    )


# --- finding the star --------------------------------------------------------------------------


def _shrunk(grey):
    factor = min(1.0, _SMALL / max(grey.shape))
    size = (round(grey.shape[1] * factor), round(grey.shape[0] * factor))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return small, grey.shape[1] / size[0]


def meeting_points(small: np.ndarray, most: int = 6, seed: int = 0) -> list[np.ndarray]:
    """Points (2,) at which many edges of a picture would meet, best first.

    Pairs of edge pixels vote for the crossing of their edges.
    """
    smooth = cv2.GaussianBlur(small, (0, 0), 1.2)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3) for d in ((1, 0), (0, 1)))
    strength = np.hypot(gx, gy)
    inner = strength[3:-3, 3:-3]
    limit = max(np.quantile(inner, 0.9), 0.06 * inner.max(), 8.0)
    y, x = np.nonzero(inner >= limit)
    if len(x) < 200:
        return []
    x, y = x + 3, y + 3
    normal = np.stack([gx[y, x], gy[y, x]], axis=1) / strength[y, x, None]
    offset = normal[:, 0] * x + normal[:, 1] * y
    random = np.random.default_rng(seed)
    a, b = random.integers(0, len(x), (2, 400_000))
    cross = normal[a, 0] * normal[b, 1] - normal[a, 1] * normal[b, 0]
    good = np.abs(cross) > 0.3
    a, b, cross = a[good], b[good], cross[good]
    px = (offset[a] * normal[b, 1] - offset[b] * normal[a, 1]) / cross
    py = (offset[b] * normal[a, 0] - offset[a] * normal[b, 0]) / cross
    height, width = small.shape
    votes, _, _ = np.histogram2d(
        py, px, bins=[height // 3, width // 3], range=[[0, height], [0, width]]
    )
    votes = cv2.GaussianBlur(votes.astype(np.float32), (0, 0), 1.5)
    found = []
    for _ in range(most):
        row, column = np.unravel_index(np.argmax(votes), votes.shape)
        if votes[row, column] <= 0:
            break
        point = np.array([(column + 0.5) * 3, (row + 0.5) * 3])
        for width_px in (8.0, 4.0, 2.0):
            away = offset - normal @ point
            far = np.hypot(x - point[0], y - point[1])
            weight = 1 / (1 + (away / width_px) ** 2) ** 2 * (far > 4)
            pull = normal * weight[:, None]
            matrix = pull.T @ normal
            if np.linalg.cond(matrix) < 1e4:
                moved = point + np.linalg.solve(matrix, pull.T @ away)
                point = moved if np.hypot(*(moved - point)) < 15 else point
        found.append(point)
        votes[max(row - 5, 0) : row + 6, max(column - 5, 0) : column + 6] = 0
    return found


def _circle_samples(small, centre, radii, angles):
    x = (centre[0] + radii[:, None] * np.cos(angles)).astype(np.float32)
    y = (centre[1] + radii[:, None] * np.sin(angles)).astype(np.float32)
    values = cv2.remap(small, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = (x >= 0) & (y >= 0) & (x <= small.shape[1] - 1) & (y <= small.shape[0] - 1)
    return values, inside


def _find(photo, sectors):
    """Centre in px, number of sectors, innermost and outermost radius in px of a star at rest."""
    small, factor = _shrunk(photo.grey)
    if np.ptp(small) < 20:
        raise CannotMeasure(f"{photo.name} shows no star: it has no contrast")
    best = None
    angles = np.arange(512) * 2 * np.pi / 512
    for centre in meeting_points(small):
        radii = np.arange(6.0, 0.75 * max(small.shape), 2.0)
        values, inside = _circle_samples(small, centre, radii, angles)
        whole = inside.mean(axis=1) > 0.97
        if whole.sum() < 8:
            continue
        radii, values = radii[whole], values[whole]
        values = values - values.mean(axis=1, keepdims=True)
        waves = np.fft.rfft(values, axis=1)
        power = np.abs(waves) ** 2
        total = power[:, 1:].sum(axis=1) + 1e-6
        share = np.zeros_like(power)
        # A perspective spreads a harmonic to its neighbours of the second order.
        for shift in (-2, -1, 0, 1, 2):
            share += np.roll(power, shift, axis=1)
        share = share / total[:, None]
        strong = np.sqrt(total / 512**2) > 6
        if sectors is None:
            support = np.where(share > 0.55, 1.0, 0.0) * strong[:, None]
            # Sectors keep their phase from circle to circle; what lies beside the star does not.
            same = np.abs((waves * support / np.sqrt(total)[:, None]).sum(axis=0)) ** 2
            held = sum(np.roll(same, shift) for shift in (-2, -1, 0, 1, 2))
            held[:2] = held[120:] = 0
            near = held >= 0.8 * held.max()
            fundamental = int(np.argmax(np.where(near, same, 0)))
        else:
            fundamental = sectors // 2
        flags = (share[:, fundamental] > 0.55) & strong & (radii * np.pi / fundamental > 3)
        run = _longest(flags & _alike(waves[:, fundamental], flags))
        if run is None:
            continue
        low, high = radii[run[0]], radii[run[1]]
        score = (high - low) * share[run[0] : run[1] + 1, fundamental].mean()
        if high / low > 1.6 and high - low > 12 and (best is None or score > best[0]):
            best = (score, centre, fundamental, low, high)
    if best is None:
        wanted = f" of {sectors} sectors" if sectors else ""
        raise CannotMeasure(
            f"{photo.name} shows no star{wanted} at rest: no point around which black and white "
            "sectors alternate evenly was found"
        )
    _, centre, fundamental, low, high = best
    centre = (centre + 0.5) * factor - 0.5
    inner = max(low * factor, _FEWEST * fundamental / math.pi)
    return centre, 2 * fundamental, (inner, 0.97 * high * factor)


def _alike(waves, flags):
    """Circles on which a harmonic has the phase, and some of the size, of most of the flagged."""
    unit = waves / (np.abs(waves) + 1e-9)
    phase = (unit * np.conj((unit * flags).sum())).real / (abs((unit * flags).sum()) + 1e-9) > 0.7
    if not (phase & flags).any():
        return phase
    return phase & (np.abs(waves) > 0.4 * np.median(np.abs(waves[phase & flags])))


def _longest(flags):
    """First and last index of the longest run of True with gaps of at most two, or None."""
    best, start, last = None, None, None
    for index in np.flatnonzero(flags):
        if start is None or index - last > 3:
            start = index
        last = index
        if best is None or last - start > best[1] - best[0]:
            best = (start, last)
    return best


# --- the angle on the star ---------------------------------------------------------------------


def _angle(lens, bend, seen, pixels):
    """Angle on the star, without its rotation, of stored pixels (n, 2); radians."""
    away = lens.ideal(pixels, bend) - lens.ideal(seen.centre[None], bend)
    # M^-1 but for its scale.
    x = (1 - seen.p) * away[:, 0] - seen.q * away[:, 1]
    y = (1 + seen.p) * away[:, 1] - seen.q * away[:, 0]
    return np.arctan2(y, x)


def _scan(light, lens, seen, count, reach, axis, rates, circles=24, turns=512):
    """Best of some rates, and how well it explains the picture.

    The share of the light's variation on circles that follows the star's first harmonic when the
    rotation is undone. Returns the rate, its share and the phase of the first dark-to-bright edge.
    """
    radii = np.linspace(reach[0], reach[1], circles)
    angles = np.arange(turns) * 2 * np.pi / turns
    values, inside = _circle_samples(light, seen.centre, radii, angles)
    flat = np.stack(
        [
            (seen.centre[0] + radii[:, None] * np.cos(angles)).ravel(),
            (seen.centre[1] + radii[:, None] * np.sin(angles)).ravel(),
        ],
        axis=1,
    )
    values = (values - values.mean(axis=1, keepdims=True)) / (values.std(axis=1) + 1e-3)[:, None]
    values = np.where(inside, values, 0).ravel()
    order = count // 2
    carrier = (
        values * np.exp(-1j * order * _angle(lens, np.zeros(len(lens.sigmas)), seen, flat))
    ).astype(np.complex64)
    along = flat[:, 1] - seen.centre[1] if axis == "y" else flat[:, 0] - seen.centre[0]
    along = (1j * order * along).astype(np.complex64)
    across = np.repeat(radii, angles.size) * np.tile(
        np.cos(angles) if axis == "y" else -np.sin(angles), radii.size
    )
    best = (0.0, -1.0, 0.0)
    for rate in rates:
        # Equal steps on the star, not in the picture; folded parts count little.
        stretch = np.clip(1 - rate * across, 0, None)
        total = np.sum(carrier * stretch * np.exp(np.complex64(rate) * along))
        share = abs(total) / values.size
        if share > best[1]:
            best = (rate, share, -np.angle(total) / order - math.pi / (2 * order))
    return best


def _start(photo, light, lens, still, count, reach):
    """Axis of the rows and the bent star of the rotating picture, to a fraction of a sector."""
    limit = 2 * math.pi / min(light.shape)
    step = 0.5 / (count / 2 * reach[1])
    rates = np.arange(-math.ceil(limit / step), math.ceil(limit / step) + 1) * step
    # A hand-held camera moves between two photographs; near its centre a star is hardly bent.
    small, factor = _shrunk(photo.grey)
    centres = [still.centre] + [
        centre
        for centre in ((c + 0.5) * factor - 0.5 for c in meeting_points(small, 3))
        if np.hypot(*(centre - still.centre)) < 0.25 * reach[1]
    ][:1]
    tried = []
    for axis in ("y", "x"):
        for centre in centres:
            rate, share, phase = _scan(light, lens, _Seen(centre), count, reach, axis, rates)
            tried.append((share, axis, _Seen(centre, phase=phase, rate=rate)))
    likely = _LIKELY * max(share for share, _, _ in tried)
    settled = [
        _settled(light, lens, seen, count, reach, axis, step)
        for share, axis, seen in tried
        if share >= likely
    ]
    share, axis, seen = max(settled, key=lambda one: one[0])
    if share < 0.35:
        raise CannotMeasure(
            f"{photo.name} does not show the star of the photograph at rest: its sectors cannot be "
            "followed from row to row"
        )
    # The rate is against the row of the centre here, against the picture's first row elsewhere.
    seen.phase -= seen.rate * (seen.centre[1] if axis == "y" else seen.centre[0])
    return axis, seen


def _settled(light, lens, seen, count, reach, axis, step):
    """The centre moved and the rate changed until the rotation is undone best."""
    size = 0.15 * reach[0] + 0.02 * reach[1]
    moves = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for _ in range(12):
        near = seen.rate + np.array([-0.6, -0.2, 0.0, 0.2, 0.6]) * min(1.0, size / 4) * step
        best = None
        for move in moves * size:
            moved = _Seen(seen.centre + move)
            rate, found, phase = _scan(light, lens, moved, count, reach, axis, near, 12, 256)
            if best is None or found > best[0] + 1e-6:
                best = (found, _Seen(moved.centre, phase=phase, rate=rate), np.any(move))
        if not best[2]:
            size *= 0.5
        share, seen = best[:2]
        if size < 0.3:
            break
    return share, axis, seen


# --- edges, and what they say ------------------------------------------------------------------


def _edges(light, lens, bend, seen, count, radii, axis, smear):
    """Edges on circles, as centroids of their steps.

    smear: half width in radians beyond which a step is over, per circle, or None.
    Returns pixels (n, 2), index of the edge (n,), polarity (n,), and the steps' widths (radians).
    """
    period = 2 * math.pi / count
    points, numbers, polarity, widths, jumps, far = [], [], [], [], [], []
    height, width = light.shape
    row = 1 if axis == "y" else 0
    for circle, r in enumerate(radii):
        phi = np.linspace(0, 2 * np.pi, max(720, int(2.5 * r)), endpoint=True)
        at = seen.centre + r * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        turned = np.unwrap(_angle(lens, bend, seen, at)) - seen.rate * at[:, row] - seen.phase
        slope = np.diff(turned)
        widths.append(np.nan)
        if slope.min() < 0.2 * (phi[1] - phi[0]):
            continue
        half = 0.47 * period if smear is None else min(0.47 * period, smear[circle])
        level = 0.47 * period if smear is None else min(0.47 * period, 1.7 * half + 3 / r)
        steps = max(12, int(math.ceil(2 * level * r)))
        window = (np.arange(2 * steps + 1) - steps) * level / steps
        first = math.ceil((turned[0] + level) / period)
        last = math.floor((turned[-1] - level) / period)
        edges = np.arange(first, first + count)
        wanted = edges[:, None] * period + window
        # The circle closes: what lies beyond its end is at its beginning.
        wanted = np.where(edges[:, None] > last, wanted - 2 * np.pi, wanted)
        wanted = np.where(wanted < turned[0], wanted + 2 * np.pi, wanted)
        angle = np.interp(wanted, turned, phi)
        x = (seen.centre[0] + r * np.cos(angle)).astype(np.float32)
        y = (seen.centre[1] + r * np.sin(angle)).astype(np.float32)
        inside = ((x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)).all(axis=1)
        step = cv2.remap(light, x, y, cv2.INTER_LINEAR)
        sign = np.where(edges % 2 == 0, 1.0, -1.0)
        core = np.abs(window) <= half
        outer = ~core if smear is not None and (~core).sum() >= 6 else np.abs(window) > 0.8 * level
        low = step[:, outer & (window < 0)].mean(axis=1)
        high = step[:, outer & (window > 0)].mean(axis=1)
        jump = (high - low) * sign
        strong = inside & (jump > 0.35 * np.median(jump[inside])) if inside.any() else inside
        if strong.sum() < 3 or np.median(jump[inside]) < 0.01:
            continue
        norm = (step - low[:, None]) / np.where(strong, high - low, 1.0)[:, None]
        pitch = window[1] - window[0]
        inner = int((half if smear is not None else level) / pitch + 0.5)
        reach = inner * pitch
        used = slice(steps - inner, steps + inner + 1)
        # Where the step is, from the area under it: the centroid of its derivative.
        offset = reach - norm[:, used].sum(axis=1) * pitch
        offset += 0.5 * pitch * (norm[:, used][:, 0] + norm[:, used][:, -1])
        mean = np.median(norm[strong], axis=0)
        shift = np.median(offset[strong])
        second = reach**2 - 2 * np.sum(window[used] * mean[used]) * pitch - shift**2
        widths[-1] = math.sqrt(max(second, 0.0))
        ok = strong & (np.abs(offset) < 0.8 * reach)
        target = np.take_along_axis(wanted, np.full((count, 1), steps), 1)[:, 0] + offset
        angle = np.interp(target, turned, phi)[ok]
        points.append(seen.centre + r * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        numbers.append(edges[ok] % count)
        polarity.append(sign[ok])
        jumps.append(jump[ok])
        far.append(np.full(int(ok.sum()), r))
    if not points:
        return np.zeros((0, 2)), np.zeros(0, dtype=int), np.zeros(0), np.array(widths)
    numbers = np.concatenate(numbers)
    on = _on_the_star(numbers, np.concatenate(jumps), np.concatenate(far), count)
    return (
        np.concatenate(points)[on],
        numbers[on],
        np.concatenate(polarity)[on],
        np.array(widths),
    )


def _on_the_star(numbers, jumps, far, count):
    """Which edges (n,) are neither hidden nor so near the star's rim that its blur moves them.

    jumps: of the light across them; far: radii. Sectors keep their contrast up to the rim.
    """
    on = np.zeros(len(numbers), dtype=bool)
    for number in range(count):
        own = numbers == number
        if own.any():
            clear = own & (jumps > _CONTRAST * np.median(jumps[own]))
            on |= clear & (far < _WITHIN * far[clear].max())
    return on


def _half_widths(widths, radii, wanted):
    """Half widths that contain the steps, smooth over the circles: smear and blur / r.

    widths: measured on circles of those radii. wanted: radii of the circles to come.
    """
    good = np.isfinite(widths)
    if good.sum() < 4:
        return None
    design = np.stack([np.ones(good.sum()), 1 / radii[good] ** 2], axis=1)
    square = widths[good] ** 2
    keep = np.ones(good.sum(), dtype=bool)
    for _ in range(3):
        found, *_ = np.linalg.lstsq(design[keep], square[keep], rcond=None)
        rest = square - design @ found
        keep = np.abs(rest) <= 3 * robust_scale(rest[keep]) + 1e-12
    spread = np.sqrt(np.clip(found[0] + found[1] / wanted**2, (0.5 / wanted) ** 2, None))
    return 2.4 * spread + 1.5 / wanted


_STEP = np.array([1e-2, 1e-2, 1e-5, 1e-5, 1e-5, 1e-8, 1e-3])


class _Model:
    """Residuals of all measured edges of both pictures, px, and what is known beforehand.

    Parameters, for each picture: centre 2, p, q, phase, rate, bias of dark against bright; lens.
    """

    def __init__(self, lens, found, seen, count, row):
        self.lens, self.row, self.period = lens, row, 2 * math.pi / count
        self.points = np.concatenate([f[0] for f in found])
        self.number = np.concatenate([f[1] for f in found])
        self.sign = np.concatenate([f[2] for f in found])
        self.which = np.repeat([0, 1], [len(f[0]) for f in found])
        # Rates are against the row of the centre, which keeps them apart from the phases.
        self.middle = [one.centre[row] for one in seen]
        self.still = True  # the first picture is held at rest

    def start(self, seen, bend):
        """Parameters of two stars and a lens."""
        both = [
            [*one.centre, one.p, one.q, one.phase + one.rate * middle, one.rate, 0.0]
            for one, middle in zip(seen, self.middle, strict=True)
        ]
        return np.concatenate([*both, bend])

    def stars(self, values):
        """Two stars, their phases against the row 0, and the lens."""
        found = []
        for own, middle in zip((values[:7], values[7:14]), self.middle, strict=True):
            phase = own[4] - own[5] * middle
            found.append(_Seen(own[:2].copy(), own[2], own[3], phase, own[5]))
        return found, values[14:]

    def residuals(self, values):
        """Measured minus modelled, along the circle."""
        out = np.empty(len(self.points))
        stars, bend = self.stars(values)
        for k, one in enumerate(stars):
            own = self.which == k
            at = self.points[own]
            angle = _angle(self.lens, bend, one, at) - one.phase - one.rate * at[:, self.row]
            angle = angle - self.number[own] * self.period
            angle = (angle + math.pi) % (2 * math.pi) - math.pi
            far = np.hypot(*(at - one.centre).T)
            out[own] = angle * far - values[7 * k + 6] * self.sign[own]
        return out

    def prior(self, values):
        """What is known beforehand, in sigmas: one camera pose, small biases, an ordinary lens."""
        known = [
            (values[9] - values[2]) / 0.002,
            (values[10] - values[3]) / 0.002,
            values[6] / 0.5,
            values[13] / 0.5,
        ]
        if self.still:
            known.append(values[5] / 1e-12)
        return np.concatenate([known, values[14:] / self.lens.sigmas])

    def fitted(self, start, iterations):
        """What `fit` returns."""
        steps = np.concatenate([_STEP, _STEP, np.full(len(self.lens.sigmas), 1e-4)])
        return fit(
            self.residuals, start, steps, self.prior, iterations, floor=0.01, groups=self.which
        )


def _fit(lights, lens, seen, count, reach, axis):
    """All edges of both pictures at once."""
    # Circles closer than a pixel see the same pixels.
    most = np.clip(reach[1] - reach[0], 30, _CIRCLES)
    radii = np.linspace(reach[0], reach[1], int(np.clip(_EDGES / count, 30, most)))
    row = 1 if axis == "y" else 0
    bend = np.zeros(len(lens.sigmas))
    smear = [None, None]
    for some in (radii[::3], radii, radii):
        found = [
            _edges(light, lens, bend, one, count, some, axis, wide)
            for light, one, wide in zip(lights, seen, smear, strict=True)
        ]
        if min(len(f[0]) for f in found) < 4 * count:
            raise CannotMeasure(
                "too few edges of the star can be measured: let it fill more of the picture, turn "
                "more slowly or expose for a shorter time"
            )
        smear = [_half_widths(f[3], some, radii) for f in found]
        model = _Model(lens, found, seen, count, row)
        values, residuals, weights, influence, believed = model.fitted(model.start(seen, bend), 8)
        seen, bend = model.stars(values)
    return {
        "seen": seen,
        "bend": bend,
        "model": model,
        "points": model.points,
        "number": model.number,
        "which": model.which,
        "values": values,
        "residuals": residuals,
        "weights": weights,
        "influence": influence,
        "believed": believed,
    }


def _still_turns(fitted, rows):
    """Rotation of the star "at rest" during the readout, degrees, and its sigma."""
    model = fitted["model"]
    model.still = False
    values, residuals, weights, influence, believed = model.fitted(fitted["values"], 6)
    cluster = fitted["number"] + 1000 * fitted["which"]
    sigma = math.hypot(sigma_of(influence[5], residuals, weights, cluster), believed[5])
    return math.degrees(values[5]) * (rows - 1), math.degrees(sigma) * (rows - 1)


def _rate(fitted, photos, axis, count, lens):
    """Rotation per row and its sigma, radians. Raises CannotMeasure where it says nothing."""
    static, rotating = photos
    rows = static.height if axis == "y" else static.width
    which, residuals, weights = fitted["which"], fitted["residuals"], fitted["weights"]
    rate = float(fitted["values"][12])
    cluster = fitted["number"] + count * which
    sigma = sigma_of(fitted["influence"][12], residuals, weights, cluster)
    sigma = math.hypot(sigma, fitted["believed"][12])
    turned, turned_sigma = (math.degrees(a) * (rows - 1) for a in (abs(rate), sigma))
    kept = [float((weights[which == k] > 0.1).mean()) for k in range(2)]
    if min(kept) < 0.6:
        raise CannotMeasure(
            f"the edges in {photos[int(np.argmin(kept))].name} do not follow one turning star"
        )
    still, still_sigma = _still_turns(fitted, rows)
    if abs(still) > max(0.3, 6 * still_sigma, 0.02 * turned):
        raise CannotMeasure(
            f"the star in {static.name} is not at rest: it turns by {abs(still):.2f} degrees "
            "during the readout; give a photograph of the star standing still first"
        )
    if turned < max(0.15, 5 * turned_sigma):
        raise CannotMeasure(
            f"the star in {rotating.name} does not turn: {turned:.3f} degrees during the readout, "
            f"with a sigma of {turned_sigma:.3f}"
        )
    # Sub-pixel effects that repeat from circle to circle; a lens known only by its four numbers.
    floor = 0.008 if len(lens.sigmas) else 0.005
    return rate, math.hypot(sigma, math.radians(floor) / (rows - 1))


def _drawing(fitted, photos, axis, count, reach, lens):
    """What `corridor.figures` shows of it."""
    row = 1 if axis == "y" else 0
    moving = fitted["which"] == 1
    one = fitted["seen"][1]
    at = fitted["points"][moving]
    period = 2 * math.pi / count
    angle = _angle(lens, fitted["bend"], one, at) - one.phase - fitted["number"][moving] * period
    angle -= one.rate * one.centre[row]
    angle = (angle + math.pi) % (2 * math.pi) - math.pi
    curves = []
    for seen in fitted["seen"]:
        radii = np.linspace(reach[0], reach[1], 40)
        lines = []
        for number in range(count):
            phi = np.full(radii.shape, number * period + seen.phase)
            for _ in range(30):
                x, y = (
                    (1 + seen.p) * np.cos(phi) + seen.q * np.sin(phi),
                    (1 - seen.p) * np.sin(phi) + seen.q * np.cos(phi),
                )
                size = radii / np.hypot(x, y)
                place = seen.centre + np.stack([x * size, y * size], axis=1)
                new = number * period + seen.phase + seen.rate * place[:, row]
                phi = phi + 0.7 * (new - phi)
            lines.append(place)
        curves.append(lines)
    return {
        "photos": [(p.name, p.grey) for p in photos],
        "curves": curves,
        "points": [fitted["points"][~moving], at],
        "residuals": [fitted["residuals"][~moving], fitted["residuals"][moving]],
        "weights": [fitted["weights"][~moving], fitted["weights"][moving]],
        "row": at[:, row] - one.centre[row],
        "turned_deg": np.degrees(angle),
        "rate_deg": math.degrees(one.rate),
        "axis": axis,
    }
