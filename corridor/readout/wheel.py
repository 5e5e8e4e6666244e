"""Readout time from a bicycle wheel, one photograph at rest and one while it turns.

Spokes are laced: they pass the axis at a distance and lie in two planes. Each is therefore a line
in the wheel's own frame, with a direction a, a distance d from the axis and a height w at the hub
(none at the rim), which the photograph at rest shows straight. In the other one a point on the
row y was seen when the wheel had turned by

    turn + rate (y - middle)

so that every point of every bent spoke says something about `rate`, and readout = rate (L - 1) /
angular velocity. Which bent spoke belongs to which straight one is tried for every multiple of
one spoke. Eq. 7.10 of Zhou 2019 is the case of a single spoke through the axis.

Source: Zhou 2019, section 7.4.2.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from corridor.geometry import robust_scale
from corridor.readout import wheel_view
from corridor.readout.fitting import fit, sigma_of, single_threaded
from corridor.readout.lens import lens_for
from corridor.readout.photograph import CannotMeasure, Photograph, same_size
from corridor.readout.result import Readout, of_turning

_REACH = 0.30, 0.86  # circles between hub and rim, where spokes are apart
_CIRCLES = 40
_OUTER = 0.6  # beyond: circles on which spokes are farthest apart
_FEWEST = 8  # spokes
# Share of the readout: 0.02 px that spokes and rim have in common, at 2 to 9 % a pixel.
_SYSTEMATIC = 1.6e-3
_RIM = 0.92  # distance from the axis at which spokes meet the rim's plane, of the edge that is seen
_APART = math.radians(1.5)  # less is no distance between spokes
_LEAN = 0.24  # largest distance of a spoke from the axis
_METHOD = (
    "points on straight and bent spokes of both photographs; pose of the wheel, lacing and "
    "rotation per row by robust least squares"
)


@dataclass(frozen=True)
class _Bent:
    """A hypothesis about the rotating picture."""

    axis: str
    rate: float  # radians a row
    turn: float  # radians, on the row of the axis
    match: float  # correlation of the spokes


@single_threaded
def measure_wheel(
    static: Photograph,
    rotating: Photograph,
    turns_per_second: float,
    *,
    speed_sigma_percent: float = 0.0,
    sense: str | None = None,
    row_direction: str | None = None,
    camera=None,
) -> Readout:
    """Readout time from a wheel at rest and the same wheel turning, or from two turning bars.

    Arguments and errors as `measure_star`. Where no wheel is seen at rest and both pictures show
    one bar smeared by its rotation, `measure_bar` takes over.
    """
    same_size(static, rotating)
    lens = lens_for(static, camera)
    try:
        rim, _ = wheel_view.find_rim(static.grey, static.name)
        found = _measure(static, rotating, rim, lens)
    except CannotMeasure as no_wheel:
        from corridor.readout.bar import find_bar, measure_bar

        bar = find_bar(static, rotating) if "no wheel" in str(no_wheel) else None
        if bar is None:
            raise no_wheel from None
        return measure_bar(
            static,
            rotating,
            turns_per_second,
            speed_sigma_percent=speed_sigma_percent,
            sense=sense,
            row_direction=row_direction,
            found=bar,
        )
    return of_turning(
        found["axis"],
        found["rows"],
        found["rate"],
        found["sigma"],
        turns_per_second,
        speed_sigma_percent,
        sense,
        row_direction,
        target="wheel",
        method=_METHOD,
        extra={"spokes": found["spokes"], "residual_px": found["residual_px"]},
        drawing=found["drawing"],
    )


def _measure(static, rotating, rim, lens):
    lights = static.light(), rotating.light()
    radii = np.linspace(*_REACH, _CIRCLES)
    tries, most = [], 0
    for pose in wheel_view.poses_of(rim, lens):
        count = int(2 ** np.clip(math.ceil(math.log2(5.5 * pose.size)), 10, 13))
        light, _ = wheel_view.polar(lights[0], pose, lens, radii, count, 1)
        spokes, polarity, wide = _spokes(light, radii, pose.size)
        sign = wheel_view.rim_sign(lights[0], pose, lens)
        most = max(most, len(spokes))
        if len(spokes) >= _FEWEST:
            second = wheel_view.moved(*lights, pose, lens)
            for bent in _bent(lights[1], light, second, lens, radii, count, wide):
                tries.append(_Try((pose, second), spokes, polarity, wide, bent, sign, lens, radii))
    if most < _FEWEST:
        raise CannotMeasure(
            f"{static.name} shows no wheel at rest: {most} straight spokes were found in the rim"
        )
    if not tries:
        raise CannotMeasure(
            f"{rotating.name} does not show the wheel of {static.name}: its spokes cannot be "
            "followed from row to row"
        )
    best = max(one.bent.match for one in tries)
    tries = [one for one in tries if one.bent.match > 0.85 * best][:4]
    followed = [one for one in tries if one.follow(lights)]
    followed.sort(key=lambda one: one.cost)
    for one in followed[:2]:
        if one.follow(lights) and one.follow(lights) and one.holds():
            return one.result(static, rotating)
    raise CannotMeasure(
        f"the spokes in {rotating.name} do not follow those of {static.name} turning evenly"
    )


# --- spokes at rest ----------------------------------------------------------------------------


def _ridge(light, wide):
    """Light above that beside it for ridges `wide` samples wide; about 1 on the ridges."""
    filled = np.where(np.isfinite(light), light, np.nanmedian(light))
    wide = max(int(wide) | 1, 3)

    def mean(size):
        padded = np.concatenate([filled[:, -size:], filled, filled[:, :size]], axis=1)
        return cv2.blur(padded, (size, 1))[:, size:-size]

    inner, outer = mean(wide), mean(3 * wide)
    ridge = 1.5 * (inner - outer)
    # Spokes cover some twentieth of a circle and are what stands out of it.
    spread = np.quantile(np.abs(ridge), 0.95, axis=1, keepdims=True) + 1e-4
    return np.clip(ridge / spread, -1.5, 1.5)


def _spokes(light, radii, size):
    """Straight spokes (n, 2): direction and distance from the axis; polarity; width in radians."""
    count = light.shape[1]
    best = None
    for width in (2.5, 4.0, 6.5, 10.0):
        wide = width / (size * radii.mean())  # radians
        if wide > 0.06:
            break
        ridge = _ridge(light, wide * count / (2 * np.pi))
        for polarity in (1, -1):
            lines = _Lines(np.clip(polarity * ridge, -0.3, 1), radii, wide)
            # Twenty of the best, a spoke's width of them each.
            best_lines = np.sort(lines.score.max(axis=1))[::-1][: 20 * 4].mean()
            if best is None or best_lines > 1.03 * best[0]:
                best = (best_lines, lines, polarity, wide)
    _, lines, polarity, wide = best
    return _merged(lines.found(), radii), polarity, wide


def _merged(lines, radii):
    """Lines that run beside each other are the two sides of one wide spoke: their middle."""
    if not len(lines):
        return lines
    angle = lines[:, 0] + np.arcsin(np.clip(lines[:, 1] / radii[:, None], -0.99, 0.99))
    out, left = [], list(range(len(lines)))
    while left:
        gap = angle[:, left] - angle[:, [left[0]]]
        gap = (gap + np.pi) % (2 * np.pi) - np.pi
        near = np.abs(gap).mean(axis=0) < _APART
        own = [k for k, same in zip(left, near, strict=True) if same]
        turn = (lines[own, 0] - lines[own[0], 0] + np.pi) % (2 * np.pi) - np.pi
        out.append((lines[own[0], 0] + turn.mean(), lines[own, 1].mean()))
        left = [k for k in left if k not in own]
    return np.array(out)


class _Lines:
    """Lines (direction, distance from the axis) scored by the ridges they lie on."""

    def __init__(self, ridge, radii, wide):
        self.ridge, self.radii, self.wide = ridge[::2].copy(), radii[::2], wide
        self.count = ridge.shape[1]
        self.sample = 2 * np.pi / self.count
        self.stride = max(1, int(0.5 * wide / self.sample))
        pitch = max(0.6 * wide * self.radii.mean(), 0.004)
        self.distance = np.arange(-_LEAN, _LEAN + 1e-9, pitch)
        lean = np.arcsin(self.distance[:, None] / self.radii)
        self.shift = np.round(lean / self.sample).astype(int)
        self.directions = np.arange(0, self.count, self.stride)
        self.score = self._support(0, len(self.directions))

    def _support(self, first, last):
        """Scores (directions, distances) of the directions first to last, cyclic."""
        start, size = first * self.stride, (last - first) * self.stride
        margin = int(np.abs(self.shift).max()) + 1
        wanted = np.arange(start - margin, start + size + margin) % self.count
        strip = self.ridge[:, wanted]
        out = np.zeros((len(self.distance), last - first))
        for j, shifts in enumerate(self.shift):
            for circle, shift in enumerate(shifts):
                begin = margin + shift
                out[j] += strip[circle, begin : begin + size : self.stride][: last - first]
        return out.T / len(self.radii)

    def found(self, most=80):
        """Lines (n, 2), strongest first; each is taken out of the ridges before the next."""
        lines, supports = [], []
        half = int(math.ceil(0.9 * self.wide / self.sample))
        around = int(math.ceil(0.25 / (self.sample * self.stride)))
        for _ in range(most):
            k, j = np.unravel_index(np.argmax(self.score), self.score.shape)
            value = self.score[k, j]
            strong = np.median(supports[:8]) if supports else value
            if value < max(0.3, 0.6 * strong):
                break
            lines.append((self.directions[k] * self.sample, self.distance[j]))
            supports.append(value)
            for circle, shift in enumerate(self.shift[j]):
                centre = self.directions[k] + shift
                self.ridge[circle, np.arange(centre - half, centre + half + 1) % self.count] = 0
            # Lines that only cross this one lose too little to be looked at again.
            first, last = k - around, k + around + 1
            near = np.arange(first, last) % len(self.directions)
            self.score[near] = self._support(first, last)
        return np.array(lines).reshape(-1, 2)


# --- the rotating picture, roughly ---------------------------------------------------------------


def _bent(light, still, pose, lens, radii, count, wide):
    """Hypotheses about axis, rate and turn: the best, and those with the wheel some spokes on."""
    circles = np.arange(0, len(radii), 3)
    samples = 2048
    found = []
    for row, axis in ((1, "y"), (0, "x")):
        values, rows = wheel_view.polar(light, pose, lens, radii[circles], samples, row)
        rows = rows - pose.axis[row]
        limit = math.radians(200) / light.shape[0 if axis == "y" else 1]
        phi = np.arange(samples) * 2 * np.pi / samples
        for broad in (0.016, 0.035):
            broad = max(broad, 1.2 * wide)
            moving = _ridge(values, broad * samples / (2 * np.pi))
            resting = _ridge(_resampled(still[circles], samples), broad * samples / (2 * np.pi))
            spectrum = np.conj(np.fft.rfft(resting, axis=1))
            norm = math.sqrt((resting**2).sum())
            step = 0.5 * broad / pose.size
            steps = math.ceil(limit / step)
            for rate in np.arange(-steps, steps + 1) * step:
                unwound = _unwound(moving, rate * rows, phi)
                total = np.fft.irfft((np.fft.rfft(unwound, axis=1) * spectrum).sum(axis=0), samples)
                top = int(np.argmax(total))
                match = total[top] / (norm * math.sqrt((unwound**2).sum()) + 1e-9)
                found.append((match, axis, rate, phi[top], total, broad, step))
    found.sort(key=lambda one: -one[0])
    match, axis, rate, turn, total, broad, step = found[0]
    if match < 0.12:
        return []
    near = [
        one
        for one in found
        if one[1] == axis and abs(one[2] - rate) < 1.5 * step and one[5] == broad
    ]
    # Other multiples of a spoke, where they match about as well.
    hypotheses = [_Bent(axis, rate, turn, match)]
    total = near[0][4].copy()
    guard = max(int(1.5 * broad * samples / (2 * np.pi)), 2)
    for _ in range(3):
        top = int(np.argmax(total))
        total[np.arange(top - guard, top + guard + 1) % samples] = -np.inf
        other = int(np.argmax(total))
        if total[other] < 0.75 * near[0][4].max():
            break
        hypotheses.append(_Bent(axis, rate, phi[other], match))
        total[other] = near[0][4].min()
    return hypotheses[:3]


def _resampled(values, samples):
    """Circles averaged to another number of samples (a power of two apart) or interpolated."""
    count = values.shape[1]
    if count > samples:
        return values.reshape(len(values), samples, count // samples).mean(axis=2)
    return np.repeat(values, samples // count, axis=1)


def _unwound(values, ahead, phi):
    """Circles with the rotation `ahead` (radians at each sample) undone."""
    out = np.empty_like(values)
    turn = 2 * np.pi
    for k, line in enumerate(values):
        angle = np.maximum.accumulate(phi - ahead[k])
        line = np.concatenate([line, line, line])
        out[k] = np.interp(phi, np.concatenate([angle - turn, angle, angle + turn]), line)
    return out


# --- points on spokes ----------------------------------------------------------------------------


def _profiles(light, pose, lens, bend, radii, angles, half, samples, rate, row, reference):
    """Light across spokes: (circles, spokes, 2 samples + 1), NaN outside, and where it was taken.

    angles: (circles, spokes) expected on the wheel as it stood on the row `reference`.
    half: (circles,) half width of the profiles in radians.
    """
    offset = np.linspace(-1, 1, 2 * samples + 1)
    wanted = angles[:, :, None] + half[:, None, None] * offset
    phi = wanted
    shape = wanted.shape
    r = np.broadcast_to(radii[:, None, None], shape).ravel()
    for _ in range(1 if rate == 0 else 8):
        at = wheel_view.on_picture(
            pose, lens, bend, r * np.cos(phi).ravel(), r * np.sin(phi).ravel()
        )
        if rate == 0:
            break
        phi = wanted + rate * (at[:, row].reshape(shape) - reference)
    at = at.reshape(shape[0], shape[1] * shape[2], 2)
    values = wheel_view.sample(light, at).reshape(shape)
    return values, at.reshape(*shape, 2)


def _points(profile, at, polarity):
    """Points on spokes from their profiles, by the shape they have in common on each circle.

    Returns pixels (n, 2), spoke (n,) and circle (n,).
    """
    circles, spokes, length = profile.shape
    half = length // 2
    level = np.nanmedian(profile, axis=2, keepdims=True)
    clean = polarity * (profile - level)
    whole = np.isfinite(clean).all(axis=2)
    out = [], [], []
    lags = np.arange(-half // 2, half // 2 + 1)
    for k in range(circles):
        near = slice(max(k - 1, 0), k + 2)
        pool = clean[near][whole[near]]
        own = np.flatnonzero(whole[k])
        if len(pool) < 6 or not len(own):
            continue
        shape = np.median(pool, axis=0)
        shape = 0.5 * (shape + shape[::-1])
        window = np.hanning(length + 2)[1:-1]
        shape = np.maximum(shape - np.quantile(shape, 0.3), 0) * window
        shape = shape - shape.mean()
        lines = clean[k, own]
        # A straight background beside the spoke says nothing about its place.
        score = np.empty((len(lags), len(own)))
        inner = np.arange(half // 2, length - half // 2)
        cut = shape[inner] - shape[inner].mean()
        slope = inner - inner.mean()
        cut = cut - slope * (cut @ slope) / (slope @ slope)
        for n, lag in enumerate(lags):
            part = lines[:, inner + lag]
            score[n] = part @ cut
        top = np.argmax(score, axis=0)
        ok = (top > 0) & (top < len(lags) - 1)
        best = np.clip(top, 1, len(lags) - 2)
        a, b, c = (score[best + d, np.arange(len(own))] for d in (-1, 0, 1))
        curve = a - 2 * b + c
        ok &= (b > 0.3 * np.median(b)) & (curve < 0)
        fine = lags[best] + 0.5 * (a - c) / np.where(curve < 0, curve, -1)
        fine = np.clip(fine, lags[0], lags[-1])
        position = half + fine
        low = np.clip(np.floor(position).astype(int), 0, length - 2)
        share = (position - low)[:, None]
        place = at[k, own, low] * (1 - share) + at[k, own, low + 1] * share
        out[0].append(place[ok])
        out[1].append(own[ok])
        out[2].append(np.full(int(ok.sum()), k))
    if not out[0]:
        return np.zeros((0, 2)), np.zeros(0, int), np.zeros(0, int)
    return tuple(np.concatenate(part) for part in out)


def _half_width(
    light, pose, lens, bend, radii, angles, polarity, most, rate=0.0, row=0, reference=0.0
):  # fmt: skip
    """Half width in radians of spokes on the outer circles, blur and smear of the exposure
    included, from their mean; at most `most`."""
    outer = radii > _OUTER
    profile, _ = _profiles(
        light, pose, lens, bend, radii[outer], angles[outer], np.full(int(outer.sum()), most), 60,
        rate, row, reference,
    )  # fmt: skip
    level = np.nanmedian(profile, axis=2, keepdims=True)
    mean = np.nanmedian((polarity * (profile - level)).reshape(-1, profile.shape[2]), axis=0)
    mean = 0.5 * (mean + mean[::-1])
    mean = mean - np.quantile(mean, 0.2)
    top = mean[58:63].mean()
    below = np.flatnonzero(mean[60:] < 0.5 * top)
    return most * (below[0] if len(below) else 60) / 60


# --- everything at once --------------------------------------------------------------------------


class _Try:
    """One hypothesis: pose, lacing, axis and rotation, followed until it holds or does not."""

    def __init__(self, poses, spokes, polarity, wide, bent, sign, lens, radii):
        self.poses, self.spokes, self.polarity, self.wide = poses, spokes, polarity, wide
        self.bent, self.lens, self.radii = bent, lens, radii
        self.row = 1 if bent.axis == "y" else 0
        self.reference = poses[1].axis[self.row]
        self.rate, self.turn = bent.rate, bent.turn
        self.bend = np.zeros(len(lens.sigmas))
        self.height = np.zeros(len(spokes))
        self.size = poses[0].size
        self.sign = sign
        self.smear, self.rim_height = 0.0, None
        self.fitted = None

    def follow(self, lights):
        """Points on spokes where they are expected, and a fit to them; whether there are enough."""
        radii, size, lens, bend = self.radii, self.size, self.lens, self.bend
        rate, row, reference = self.rate, self.row, self.reference
        first, second = self.poses
        # The lens found so far also bends where spokes are expected.
        still = _expected(self.spokes, self.height, 0.0, radii, first, lens, bend)
        moving = _expected(
            self.spokes, self.height, self.turn, radii, second, lens, bend, rate, row, reference
        )
        spacing = _spacing(still)
        # Spokes may be wider than the ridge that found them; they must not fill their profiles.
        own = radii[radii > _OUTER].mean() * _half_width(
            lights[0], first, lens, bend, radii, still, self.polarity, min(8 * self.wide, 0.1)
        )
        half_still = np.maximum(2.5 * self.wide * radii.mean(), 2.2 * own + 2 / size) / radii
        half_still = np.clip(half_still, 4 / (size * radii), 0.12)
        self.smear = _half_width(
            lights[1], second, lens, bend, radii, moving, self.polarity, 0.1, rate, row, reference
        )
        loose = 0.02 if self.fitted is None else 0.004
        half_move = np.maximum(2.2 * self.smear + 2 / (size * radii), half_still) + loose
        half_move = np.minimum(half_move, 0.2)
        points, owner = [], []
        for k, (angles, half) in enumerate(((still, half_still), (moving, half_move))):
            samples = int(np.clip(math.ceil(half.max() * size * 1.3), 12, 90))
            profile, at = _profiles(
                lights[k], self.poses[k], lens, bend, radii, angles, half, samples,
                rate if k else 0.0, row, reference,
            )  # fmt: skip
            place, whose, circle = _points(profile, at, self.polarity)
            # A neighbour within the profile would draw the point to itself.
            clear = spacing[circle, whose] > 0.8 * half[circle]
            points.append(place[clear])
            owner.append(whose[clear])
        if min(len(p) for p in points) < 6 * len(self.spokes):
            return False
        rims = [
            wheel_view.rim_edge(light, pose, lens, bend, self.sign)
            for light, pose in zip(lights, self.poses, strict=True)
        ]
        if min(len(rim) for rim in rims) < 60:
            return False
        fitted = _joint(
            points, owner, rims, first, second, self.spokes, self.height, bend, rate,
            self.turn, row, reference, lens, self.rim_height, 8 if self.fitted else 4,
        )  # fmt: skip
        self.fitted = fitted
        self.rim_height = fitted["rim_height"]
        self.poses, self.bend = fitted["poses"], fitted["bend"]
        self.spokes, self.height = fitted["spokes"], fitted["height"]
        self.rate, self.turn = fitted["rate"], fitted["turn"]
        kind, residuals = fitted["kind"], fitted["residuals"]
        self.scales = [robust_scale(residuals[kind == k]) for k in (0, 1)]
        self.kept = [float((fitted["weights"][kind == k] > 0.1).mean()) for k in (0, 1)]
        self.cost = self.scales[1]
        return 0.5 < self.poses[0].size / self.size < 2

    def holds(self):
        """Whether the bent spokes are as good as the straight ones, blur by the turn aside."""
        blurred = 0.1 * self.smear * self.size * self.radii.mean()
        return self.scales[1] < 2.5 * self.scales[0] + 0.5 + blurred and self.kept[1] > 0.55

    def result(self, static, rotating):
        """What `measure_wheel` needs of it. Raises CannotMeasure where the wheel is at rest."""
        fitted, axis = self.fitted, self.bent.axis
        rows = static.height if axis == "y" else static.width
        sigma = sigma_of(
            fitted["influence"], fitted["residuals"], fitted["weights"], fitted["cluster"]
        )
        # Few spokes understate what they have in common; spokes are not quite straight lines.
        sigma = math.hypot(1.4 * sigma, fitted["believed"], _SYSTEMATIC * self.rate)
        turned = math.degrees(abs(self.rate)) * (rows - 1)
        sigma_deg = math.degrees(sigma) * (rows - 1)
        if turned < max(0.5, 5 * sigma_deg):
            raise CannotMeasure(
                f"the wheel in {rotating.name} does not turn: {turned:.2f} degrees during the "
                "readout"
            )
        photos = static, rotating
        return {
            "axis": axis,
            "rows": rows,
            "rate": self.rate,
            "sigma": sigma,
            "spokes": len(self.spokes),
            "residual_px": self.scales,
            "drawing": _drawing(fitted, photos, axis, self.row, self.reference, self.lens),
        }


def _spacing(angles):
    """Distance (circles, spokes) of each spoke from its nearest neighbour, radians."""
    order = np.argsort(angles % (2 * np.pi), axis=1)
    sorted_ = np.take_along_axis(angles % (2 * np.pi), order, 1)
    gap = np.diff(np.concatenate([sorted_, sorted_[:, :1] + 2 * np.pi], axis=1), axis=1)
    nearest = np.minimum(gap, np.roll(gap, 1, axis=1))
    out = np.empty_like(angles)
    np.put_along_axis(out, order, nearest, 1)
    return out


def _expected(spokes, height, turn, radii, pose, lens, bend, rate=0.0, row=0, reference=0.0):
    """Angles (circles, spokes) in the rim's plane at which spokes out of it are seen.

    With a rate: as on the row `reference`, so that `_profiles` finds them on their own rows.
    """
    origin, axes = pose.frame(lens.principal)
    camera = -axes.T @ origin
    angle = np.broadcast_to(spokes[:, 0] + turn, (len(radii), len(spokes)))
    ahead = np.zeros(angle.shape)
    for _ in range(1 if rate == 0 else 6):
        at = angle + ahead
        along = np.sqrt(np.maximum(radii[:, None] ** 2 - spokes[:, 1] ** 2, 1e-6))
        x = along * np.cos(at) - spokes[:, 1] * np.sin(at)
        y = along * np.sin(at) + spokes[:, 1] * np.cos(at)
        z = height * (_RIM - along)
        grow = z / (z - camera[2])
        px, py = x + grow * (camera[0] - x), y + grow * (camera[1] - y)
        # On the same circle as the profiles, not where this very point is seen.
        seen = np.arctan2(py, px) + _slip(px, py, radii, spokes, at)
        if rate == 0:
            break
        pixel = wheel_view.on_picture(
            pose, lens, bend, (radii[:, None] * np.cos(seen)).ravel(),
            (radii[:, None] * np.sin(seen)).ravel(),
        )  # fmt: skip
        ahead = rate * (pixel[:, row].reshape(angle.shape) - reference)
    return seen - ahead


def _slip(px, py, radii, spokes, at):
    """Change of a leaning spoke's angle between the radius it is seen at and the circle."""
    seen = np.hypot(px, py)
    lean = np.clip(spokes[:, 1] / np.maximum(seen, 0.05), -0.99, 0.99)
    wanted = np.clip(spokes[:, 1] / radii[:, None], -0.99, 0.99)
    return np.arcsin(wanted) - np.arcsin(lean)


def _joint(
    points, owner, rims, first, second, spokes, height, bend, rate, turn, row, reference, lens,
    rim_height, iterations,
):  # fmt: skip
    """Pose, shift of the camera, lens, lacing and rotation per row from all points."""
    number = len(spokes)
    pixels = np.concatenate([points[0], points[1], rims[0], rims[1]])
    kind = np.repeat([0, 1, 2, 3], [len(points[0]), len(points[1]), len(rims[0]), len(rims[1])])
    member = np.concatenate([owner[0], owner[1], np.full(len(rims[0]) + len(rims[1]), -1)])
    lenses = len(lens.sigmas)
    shared = 14 + lenses
    on_spoke = member >= 0
    moving = (kind == 1) | (kind == 3)
    ahead = pixels[:, row] - reference

    def unpack(v):
        focal = lens.focal * math.exp(v[5])
        one = wheel_view.Pose((v[0], v[1]), (v[2], v[3]), math.exp(v[4]), focal)
        two = wheel_view.Pose(
            (v[0] + v[6], v[1] + v[7]), (v[2] + v[8], v[3] + v[9]), math.exp(v[4] + v[10]), focal
        )
        return one, two, v[14:shared]

    def model(v):
        one, two, bent = unpack(v)
        out = np.empty(len(pixels))
        for pose, own in ((one, ~moving), (two, moving)):
            camera, direction, depth = wheel_view.rays(pose, lens, bent, pixels[own])
            spoke = on_spoke[own]
            scale = pose.focal / depth
            result = np.empty(int(own.sum()))
            hit = camera[:2] + depth[:, None] * direction[:, :2]
            result[~spoke] = (np.hypot(*hit[~spoke].T) - 1) * scale[~spoke]
            who = member[own][spoke]
            angle = v[shared + who]
            if pose is two:
                angle = angle + v[11] + v[12] * ahead[own][spoke]
            away, w = v[shared + number + who], v[shared + 2 * number + who]
            c, s = np.cos(angle), np.sin(angle)
            d = direction[spoke]
            # Normal of the plane through the spoke (c, s, -w) and the ray.
            nx = s * d[:, 2] + w * d[:, 1]
            ny = -w * d[:, 0] - c * d[:, 2]
            nz = c * d[:, 1] - s * d[:, 0]
            from_spoke = np.stack(
                [camera[0] + away * s, camera[1] - away * c, camera[2] - w * (_RIM + v[13])], axis=1
            )
            gap = from_spoke[:, 0] * nx + from_spoke[:, 1] * ny + from_spoke[:, 2] * nz
            result[spoke] = gap / np.sqrt(nx * nx + ny * ny + nz * nz) * scale[spoke]
            out[own] = result
        return out

    # A first fit, to points not yet well placed, leaves the lens alone.
    focal_sigma = lens.focal_sigma if rim_height is not None and lens.focal_sigma else 1e-9
    lens_sigmas = lens.sigmas if rim_height is not None else 1e-9 * lens.sigmas

    def prior(v):
        return np.concatenate(
            [
                [v[5] / focal_sigma, v[6] / 0.003, v[7] / 0.003, v[13] / 0.05],
                v[14:shared] / lens_sigmas,
                v[shared + 2 * number :] / 0.12,
                [v[2] / 1e5, v[10] / 0.05],
            ]
        )

    start = np.concatenate(
        [
            [*first.tilt, *first.axis, math.log(first.size), math.log(first.focal / lens.focal)],
            np.subtract(second.tilt, first.tilt),
            np.subtract(second.axis, first.axis),
            [math.log(second.size / first.size), turn, rate, rim_height or 0.0],
            bend,
            spokes[:, 0],
            spokes[:, 1],
            height,
        ]
    )
    steps = np.concatenate(
        [
            [1e-5, 1e-5, 1e-2, 1e-2, 1e-5, 1e-4, 1e-5, 1e-5, 1e-2, 1e-2, 1e-5, 1e-5, 1e-8, 1e-3],
            np.full(lenses, 1e-4),
            np.full(number, 1e-5),
            np.full(number, 1e-5),
            np.full(number, 1e-3),
        ]
    )
    kinds = [shared + k * number + np.arange(number) for k in range(3)]
    values, residuals, weights, influence, believed = fit(
        model,
        start,
        steps,
        prior,
        iterations=iterations,
        # A thousand points see a hundredth of a pixel, to which neither are spokes straight nor
        # rims round: what is known beforehand must not give way to that.
        floor=0.12,
        groups=kind,
        own=(kinds, member),
    )
    one, two, bent = unpack(values)
    used = on_spoke
    cluster = np.where(used, member + number * (kind == 1), 2 * number + kind)
    return {
        "poses": (one, two),
        "bend": bent,
        "turn": float(values[11]),
        "rate": float(values[12]),
        "spokes": np.stack([values[kinds[0]], values[kinds[1]]], axis=1),
        "height": values[kinds[2]],
        "rim_height": float(values[13]),
        "points": pixels,
        "residuals": residuals,
        "weights": weights,
        "kind": kind,
        "member": member,
        "cluster": cluster,
        "influence": influence[12],
        "believed": float(believed[12]),
    }


def _drawing(fitted, photos, axis, row, reference, lens):
    """What `corridor.figures` shows of it."""
    first, second = fitted["poses"]
    spokes, height, rate, turn = (fitted[k] for k in ("spokes", "height", "rate", "turn"))
    bend, kind = fitted["bend"], fitted["kind"]
    radii = np.linspace(0.15, 0.97, 40)
    curves = []
    for pose, moving in ((first, False), (second, True)):
        lines = []
        for (angle, away), w in zip(spokes, height, strict=True):
            along = np.sqrt(np.maximum(radii**2 - away**2, 0))
            at = np.full(radii.shape, angle + (turn if moving else 0.0))
            for _ in range(12 if moving else 1):
                c, s = np.cos(at), np.sin(at)
                place = wheel_view.on_picture(
                    pose, lens, bend, along * c - away * s, along * s + away * c, w * (_RIM - along)
                )
                if moving:
                    at = angle + turn + rate * (place[:, row] - reference)
            lines.append(place)
        curves.append(lines)
    moving = kind == 1
    at = fitted["points"][moving]
    size = second.size
    far = np.hypot(*(at - np.asarray(second.axis)).T)
    ahead = at[:, row] - reference
    return {
        "photos": [(p.name, p.grey) for p in photos],
        "curves": curves,
        "points": [fitted["points"][kind == 0], at],
        "residuals": [fitted["residuals"][kind == 0], fitted["residuals"][moving]],
        "weights": [fitted["weights"][kind == 0], fitted["weights"][moving]],
        "row": ahead,
        "turned_deg": np.degrees(
            rate * ahead + fitted["residuals"][moving] / np.maximum(far, 0.1 * size)
        ),
        "rate_deg": math.degrees(rate),
        "axis": axis,
    }
