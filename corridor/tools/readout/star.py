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

import math
from dataclasses import dataclass, replace
from itertools import islice

import cv2
import numpy as np

from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.tools.readout.fitting import Fitted, fit
from corridor.tools.readout.lens import Calibration, lens_for
from corridor.tools.readout.photograph import CannotMeasure, Photo, read_two
from corridor.tools.readout.result import Readout
from corridor.tools.readout.turning import Known, Turning, bent

_SMALL = 900  # px, long side of the picture in which the star is looked for
_CIRCLES = 120  # of which fewer are used where there are many sectors
_EDGES = 3200  # edges a picture, about
_FEWEST = 5  # px of a sector along the innermost circle
_FEWEST_SECTORS = 6  # two lines through one point fit any perspective
_LIKELY = 0.5  # of the best share: what may become the best by moving the centre
_FOLLOWED = 0.35  # least share of the light's variation that follows the sectors
_WHOLE = 2 / math.pi  # share of sharp sectors' light in their first harmonic
_DOUBTFUL = 0.5  # the same, of which something is wrong with a star at rest
_STEEPEST = math.tan(math.radians(22.5)) ** 2  # size of (p, q) for a tilt of 45 degrees
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


@one_thread()
def measure_star(
    static: Photo,
    rotating: Photo,
    turns_per_second: float,
    *,
    speed_sigma_percent: float = 0.0,
    sense: str | None = None,
    row_direction: str | None = None,
    sectors: int | None = None,
    camera: Calibration = None,
) -> Readout:
    """Readout time from two photographs of a Siemens star, at rest and turning.

    static, rotating: files, or photographs that have been read. turns_per_second: speed of the
    star, its standard error in per cent beside it. sense, row_direction: what is known of them in
    the stored picture. sectors: black and white ones together, None: counted. camera: a calibrated
    `corridor.camera.Camera`, a TOML file with one, or None.
    Raises InputError where the pictures do not fit each other or what is given, CannotMeasure
    where they show no star, or one that does not turn.
    """
    static, rotating = read_two(static, rotating)
    lens = lens_for(static, camera)
    centre, count, reach = _find(static, sectors)
    if count < _FEWEST_SECTORS:
        raise CannotMeasure(
            f"the star in {static.name} has {count} sectors, whose edges do not show from which "
            f"side it is seen: use one of {_FEWEST_SECTORS} sectors or more"
        )
    lights = static.light(), rotating.light()
    still, share = _at_rest(lights[0], lens, centre, count, reach)
    if share < _DOUBTFUL:
        _check_chosen(static, rotating, lens, sectors)
    row, start = _start(rotating, lights[1], lens, still, count, reach)
    stars = _Stars.measured(lights, lens, [still, start], count, reach, row)
    rate, sigma = stars.rate((static, rotating))
    residuals = stars.fitted.residuals
    turning = Turning(
        "star", (static, rotating), row, rate, sigma, stars.points, residuals, stars.fitted.used,
        stars.which, stars.which == 1, stars.seen[1].centre, stars.curves(reach),
    )  # fmt: skip
    turning.check_turns(0.15)
    extra = {
        "sectors": count,
        "residual_px": [robust_scale(residuals[stars.which == k]) for k in range(2)],
    }
    known = Known(turns_per_second, speed_sigma_percent, sense, row_direction)
    doubtful = ()
    if share < _DOUBTFUL:
        doubtful = (
            f"the {count} sectors that were counted in {static.name} explain {100 * share:.0f} % "
            f"of its light, of a star at rest {100 * _WHOLE:.0f}: is it covered, or did it turn?",
        )
    return turning.readout(known, _METHOD, extra, doubtful)


def _check_chosen(static: Photo, rotating: Photo, lens, sectors: int | None) -> None:
    """Raises InputError where the other photograph, or another number, makes a star at rest."""
    counted = []
    for photo in (static, rotating):
        try:
            centre, count, reach = _find(photo, None)
        except CannotMeasure:
            return
        share = _at_rest(photo.light(), lens, centre, count, reach)[1]
        counted.append((share >= _DOUBTFUL, count))
    if not counted[0][0] and counted[1][0]:
        raise InputError(
            f"the star stands still in {rotating.name} and not in {static.name}: exchange the two"
        )
    if sectors is not None and counted[0][0] and counted[0][1] != sectors:
        raise InputError(
            f"--sectors {sectors}: the star in {static.name} has {counted[0][1]}; black and white "
            "ones count together"
        )


# --- finding the star --------------------------------------------------------------------------


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
    small, factor = photo.shrunk(_SMALL)
    if np.ptp(small) < 20:
        raise CannotMeasure(f"{photo.name} shows no star: it has no contrast")
    found = [_star_about(small, centre, sectors) for centre in meeting_points(small)]
    found = [one for one in found if one is not None]
    if not found:
        wanted = f" of {sectors} sectors" if sectors else ""
        raise CannotMeasure(
            f"{photo.name} shows no star{wanted} at rest: no point around which black and white "
            "sectors alternate evenly was found"
        )
    _, centre, order, low, high = max(found, key=lambda one: one[0])
    inner = max(low * factor, _FEWEST * order / math.pi)
    return (centre + 0.5) * factor - 0.5, 2 * order, (inner, 0.97 * high * factor)


def _star_about(small, centre, sectors):
    """Score, centre, half the sectors, innermost and outermost radius of a star, or None."""
    angles = np.arange(512) * 2 * np.pi / 512
    radii = np.arange(6.0, 0.75 * max(small.shape), 2.0)
    values, inside = _circle_samples(small, centre, radii, angles)
    whole = inside.mean(axis=1) > 0.97
    if whole.sum() < 8:
        return None
    radii, values = radii[whole], values[whole]
    waves = np.fft.rfft(values - values.mean(axis=1, keepdims=True), axis=1)
    power = np.abs(waves) ** 2
    total = power[:, 1:].sum(axis=1) + 1e-6
    # A perspective spreads a harmonic to its neighbours of the second order.
    share = sum(np.roll(power, shift, axis=1) for shift in range(-2, 3)) / total[:, None]
    strong = np.sqrt(total / 512**2) > 6
    if sectors is None:
        support = np.where(share > 0.55, 1.0, 0.0) * strong[:, None]
        # Sectors keep their phase from circle to circle; what lies beside the star does not.
        same = np.abs((waves * support / np.sqrt(total)[:, None]).sum(axis=0)) ** 2
        held = sum(np.roll(same, shift) for shift in range(-2, 3))
        held[:2] = held[120:] = 0
        order = int(np.argmax(np.where(held >= 0.8 * held.max(), same, 0)))
    else:
        order = sectors // 2
    if order < 1:
        return None
    flags = (share[:, order] > 0.55) & strong & (radii * np.pi / order > 3)
    run = _longest(flags & _alike(waves[:, order], flags))
    if run is None:
        return None
    low, high = radii[run[0]], radii[run[1]]
    if high / low <= 1.6 or high - low <= 12:
        return None
    return (high - low) * share[run[0] : run[1] + 1, order].mean(), centre, order, low, high


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
    return _star_angle(away, seen.p, seen.q)


def _star_angle(away, p, q):
    """Angle on the star of places (n, 2) seen from its centre; M^-1 but for its scale."""
    x, y = away.T
    return np.arctan2((1 + p) * y - q * x, (1 - p) * x - q * y)


class _Circles:
    """Light on circles about a centre, for looking how well sectors explain it."""

    def __init__(self, light, lens, centre, count, reach, circles=24, turns=512):
        self.order = count // 2
        radii = np.linspace(reach[0], reach[1], circles)
        angles = np.arange(turns) * 2 * np.pi / turns
        values, inside = _circle_samples(light, centre, radii, angles)
        values = values - values.mean(axis=1, keepdims=True)
        values = values / (values.std(axis=1) + 1e-3)[:, None]
        self.values = np.where(inside, values, 0).ravel()
        away = radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        self.away, self.centre = away.reshape(-1, 2), centre
        self.flat = lens.ideal(centre + self.away, np.zeros(len(lens.sigmas)))
        self.flat = self.flat - lens.ideal(centre[None], np.zeros(len(lens.sigmas)))

    def best(self, p, q, row=1, rates=(0.0,)):
        """Share of the light's variation that follows the star's first harmonic when the rotation
        is undone, the rate at which it is largest, and the phase of the first dark-to-bright edge.
        """
        order = self.order
        carrier = self.values * np.exp(-1j * order * _star_angle(self.flat, p, q))
        carrier = carrier.astype(np.complex64)
        along = (1j * order * self.away[:, row]).astype(np.complex64)
        across = self.away[:, 0] if row else -self.away[:, 1]
        best = (-1.0, 0.0, 0.0)
        for rate in rates:
            # Equal steps on the star, not in the picture; folded parts count little.
            stretch = np.clip(1 - rate * across, 0, None)
            total = np.sum(carrier * stretch * np.exp(np.complex64(rate) * along))
            share = abs(total) / len(self.values)
            if share > best[0]:
                best = share, rate, -np.angle(total) / order - math.pi / (2 * order)
        return best


def _at_rest(light, lens, centre, count, reach):
    """The star at rest, its perspective to a fraction of a sector; share that follows it.

    A tilt of 30 degrees moves edges by more than a sector where there are many.
    """
    circles = _Circles(light, lens, centre, count, reach, 10)
    best, (p, q) = circles.best(0.0, 0.0), (0.0, 0.0)
    step = 0.4 / circles.order
    while step > 0.05 / circles.order:
        size = _STEEPEST if step == 0.4 / circles.order else 2 * step
        grid = np.arange(-math.ceil(size / step), math.ceil(size / step) + 1) * step
        for one, other in [(p + a, q + b) for a in grid for b in grid]:
            if math.hypot(one, other) <= _STEEPEST:
                found = circles.best(one, other)
                if found[0] > best[0]:
                    best, (p, q) = found, (one, other)
        step /= 3
    return _Seen(centre, p, q, phase=best[2]), best[0]


def _start(photo, light, lens, still, count, reach):
    """Axis of the rows and the bent star of the rotating picture, to a fraction of a sector.

    It is seen from where the star at rest was, but for a hand's movement.
    """
    limit = 2 * math.pi / min(light.shape)
    step = 0.5 / (count / 2 * reach[1])
    rates = np.arange(-math.ceil(limit / step), math.ceil(limit / step) + 1) * step
    # A hand-held camera moves between two photographs; near its centre a star is hardly bent.
    small, factor = photo.shrunk(_SMALL)
    near = ((centre + 0.5) * factor - 0.5 for centre in meeting_points(small, 3))
    near = (one for one in near if np.hypot(*(one - still.centre)) < 0.25 * reach[1])
    centres = [still.centre, *islice(near, 1)]
    tried = []
    for centre in centres:
        circles = _Circles(light, lens, centre, count, reach)
        for row in (1, 0):
            share, rate, phase = circles.best(still.p, still.q, row, rates)
            tried.append((share, row, replace(still, centre=centre, phase=phase, rate=rate)))
    likely = _LIKELY * max(share for share, _, _ in tried)
    settled = [
        _settled(light, lens, seen, count, reach, row, step)
        for share, row, seen in tried
        if share >= likely
    ]
    share, row, seen = max(settled, key=lambda one: one[0])
    if share < _FOLLOWED:
        raise CannotMeasure(
            f"{photo.name} does not show the star of the photograph at rest: its sectors cannot be "
            "followed from row to row"
        )
    # The rate is against the row of the centre here, against the picture's first row elsewhere.
    seen.phase -= seen.rate * seen.centre[row]
    return row, seen


def _settled(light, lens, seen, count, reach, row, step):
    """The centre moved and the rate changed until the rotation is undone best."""
    size = 0.15 * reach[0] + 0.02 * reach[1]
    moves = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for _ in range(12):
        near = seen.rate + np.array([-0.6, -0.2, 0.0, 0.2, 0.6]) * min(1.0, size / 4) * step
        best = None
        for move in moves * size:
            centre = seen.centre + move
            circles = _Circles(light, lens, centre, count, reach, 12, 256)
            share, rate, phase = circles.best(seen.p, seen.q, row, near)
            if best is None or share > best[0] + 1e-6:
                found = replace(seen, centre=centre, phase=phase, rate=rate)
                best = (share, found, np.any(move))
        if not best[2]:
            size *= 0.5
        share, seen = best[:2]
        if size < 0.3:
            break
    return share, row, seen


# --- edges, and what they say ------------------------------------------------------------------


@dataclass
class _Edges:
    """Edges on circles, as centroids of their steps.

    pixels: (n, 2). number: (n,) of the edge. sign: (n,) +1 from dark to bright. widths: (circles,)
    of the steps, radians, NaN where there are none.
    """

    pixels: np.ndarray
    number: np.ndarray
    sign: np.ndarray
    widths: np.ndarray

    @classmethod
    def found(cls, light, lens, bend, seen, count, radii, row, smear):
        """Edges of a star where it is believed to be.

        smear: half width in radians beyond which a step is over, per circle, or None.
        """
        widths, parts = [], []
        for circle, r in enumerate(radii):
            half = None if smear is None else smear[circle]
            width, *part = _edges_on(light, lens, bend, seen, count, r, row, half)
            widths.append(width)
            if part:
                parts.append(part)
        if not parts:
            parts = [[np.zeros((0, 2)), np.zeros(0, int), *np.zeros((3, 0))]]
        pixels, number, sign, jump, far = map(np.concatenate, zip(*parts, strict=True))
        on = _on_the_star(number, jump, far, count)
        return cls(pixels[on], number[on], sign[on], np.array(widths))


def _edges_on(light, lens, bend, seen, count, r, row, smear):
    """Width of the steps on a circle, then pixels, numbers, signs, jumps and radii of its edges;
    NaN alone where none can be measured."""
    period = 2 * math.pi / count
    phi = np.linspace(0, 2 * np.pi, max(720, int(2.5 * r)), endpoint=True)
    at = seen.centre + r * np.stack([np.cos(phi), np.sin(phi)], axis=1)
    turned = np.unwrap(_angle(lens, bend, seen, at)) - seen.rate * at[:, row] - seen.phase
    if np.diff(turned).min() < 0.2 * (phi[1] - phi[0]):
        return (np.nan,)
    half = 0.47 * period if smear is None else min(0.47 * period, smear)
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
    height, width = light.shape
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
        return (np.nan,)
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
    ok = strong & (np.abs(offset) < 0.8 * reach)
    angle = np.interp(wanted[:, steps] + offset, turned, phi)[ok]
    pixels = seen.centre + r * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    far = np.full(len(pixels), r)
    return math.sqrt(max(second, 0.0)), pixels, edges[ok] % count, sign[ok], jump[ok], far


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


class _Stars:
    """All measured edges of both pictures and the stars fitted to them.

    Parameters, for each picture: centre 2, p, q, phase, rate, bias of dark against bright; lens.
    """

    def __init__(self, lens, found, seen, count, row):
        self.lens, self.row, self.count = lens, row, count
        self.points = np.concatenate([edges.pixels for edges in found])
        self.number = np.concatenate([edges.number for edges in found])
        self.sign = np.concatenate([edges.sign for edges in found])
        self.which = np.repeat([0, 1], [len(edges.pixels) for edges in found])
        # Rates are against the row of the centre, which keeps them apart from the phases.
        self.middle = [one.centre[row] for one in seen]

    @classmethod
    def measured(cls, lights, lens, seen, count, reach, row):
        """Edges looked for where the stars are believed to be, and the stars fitted, in turns."""
        # Circles closer than a pixel see the same pixels.
        most = np.clip(reach[1] - reach[0], 30, _CIRCLES)
        radii = np.linspace(reach[0], reach[1], int(np.clip(_EDGES / count, 30, most)))
        bend = np.zeros(len(lens.sigmas))
        smear = [None, None]
        for some in (radii[::3], radii, radii):
            found = [
                _Edges.found(light, lens, bend, one, count, some, row, wide)
                for light, one, wide in zip(lights, seen, smear, strict=True)
            ]
            if min(len(edges.pixels) for edges in found) < 4 * count:
                raise CannotMeasure(
                    "too few edges of the star can be measured: let it fill more of the picture, "
                    "turn more slowly or expose for a shorter time"
                )
            smear = [_half_widths(edges.widths, some, radii) for edges in found]
            stars = cls(lens, found, seen, count, row)
            stars.fitted = stars.fit(stars.start(seen, bend), still=True)
            seen, bend = stars.stars(stars.fitted.values)
        stars.seen, stars.bend = seen, bend
        return stars

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
            angle = angle - self.number[own] * 2 * math.pi / self.count
            angle = (angle + math.pi) % (2 * math.pi) - math.pi
            far = np.hypot(*(at - one.centre).T)
            out[own] = angle * far - values[7 * k + 6] * self.sign[own]
        return out

    def fit(self, start, still) -> Fitted:
        """Both stars and the lens. still: the first picture is held at rest."""

        def prior(values):
            """In sigmas: one camera pose, small biases, an ordinary lens."""
            pose = (values[9:11] - values[2:4]) / 0.002
            rest = [values[5] / 1e-12] if still else []
            return np.concatenate(
                [pose, values[[6, 13]] / 0.5, rest, values[14:] / self.lens.sigmas]
            )

        steps = np.concatenate([_STEP, _STEP, np.full(len(self.lens.sigmas), 1e-4)])
        return fit(self.residuals, start, steps, prior, floor=0.01, groups=self.which)

    def rate(self, photos):
        """Rotation per row and its sigma, radians. Raises CannotMeasure where the edges do not
        follow one star, or the first one turns as well."""
        rows = photos[0].grey.shape[1 - self.row]
        cluster = self.number + self.count * self.which
        rate, sigma = float(self.fitted.values[12]), self.fitted.sigma(12, cluster)
        kept = [float(self.fitted.used[self.which == k].mean()) for k in range(2)]
        if min(kept) < 0.6:
            raise CannotMeasure(
                f"the edges in {photos[int(np.argmin(kept))].name} do not follow one turning star"
            )
        loose = self.fit(self.fitted.values, still=False)
        still, still_sigma = loose.values[5], loose.sigma(5, cluster)
        if abs(still) > max(math.radians(0.3) / (rows - 1), 6 * still_sigma, 0.02 * abs(rate)):
            raise CannotMeasure(
                f"the star in {photos[0].name} is not at rest: it turns by "
                f"{math.degrees(abs(still)) * (rows - 1):.2f} degrees during the readout; give a "
                "photograph of the star standing still first"
            )
        # Sub-pixel effects that repeat from circle to circle; a lens known by its four numbers.
        floor = 0.008 if len(self.lens.sigmas) else 0.005
        return rate, math.hypot(sigma, math.radians(floor) / (rows - 1))

    def curves(self, reach):
        """Lines of pixels along every edge of either star, for the drawing."""
        radii = np.linspace(*reach, 40)
        found = []
        for seen in self.seen:

            def place(angle, seen=seen):
                x = (1 + seen.p) * np.cos(angle) + seen.q * np.sin(angle)
                y = (1 - seen.p) * np.sin(angle) + seen.q * np.cos(angle)
                away = np.stack([x, y], axis=-1) * (radii / np.hypot(x, y))[..., None]
                return seen.centre + away

            angle = 2 * math.pi / self.count * np.arange(self.count)[:, None] + seen.phase
            angle = np.broadcast_to(angle, (self.count, len(radii)))
            found.append(list(bent(place, angle, seen.rate, self.row, 0.0, 60)[0]))
        return found
