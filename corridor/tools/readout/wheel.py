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

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.core.options import options
from corridor.tools.readout import wheel_view
from corridor.tools.readout.bar import find_bar, measure_bar
from corridor.tools.readout.fitting import Fitted, fit, vertex
from corridor.tools.readout.lens import Calibration, lens_for
from corridor.tools.readout.photograph import CannotMeasure, Photo, read_two
from corridor.tools.readout.result import Readout
from corridor.tools.readout.turning import Known, Turning, bent
from corridor.tools.readout.video import Film, known_from_film
from corridor.tools.readout.wheel_view import NoWheel, Pose

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
class _Looks:
    """How spokes look: +1 brighter or -1 darker than what is behind, width in radians on the mean
    circle; rim_sign: +1 where the light grows outwards across the rim's edge."""

    polarity: int
    wide: float
    rim_sign: int = 1


@dataclass(frozen=True)
class _Lacing:
    """spokes: (n, 2) direction and distance from the axis; height: (n,) of the flange, of the
    radius; rim_height: of the plane in which spokes meet the rim, None where not yet known."""

    spokes: np.ndarray
    height: np.ndarray
    rim_height: float | None = None


@dataclass(frozen=True)
class _View:
    """One photograph of the wheel as it is believed: on the row `reference` it had turned by `turn`
    radians, and `rate` more on every further row."""

    light: np.ndarray
    pose: Pose
    row: int = 1
    reference: float = 0.0
    turn: float = 0.0
    rate: float = 0.0

    def seen(self, place, angles, rounds):
        """Pixels at which angles, told as the wheel stood on the row `reference`, are seen, and
        how far it had turned there; place: angles -> pixels."""
        return bent(place, angles, self.rate, self.row, self.reference, rounds)

    def profiles(self, radii, angles, half, samples):
        """Light across spokes (circles, spokes, 2 samples + 1), NaN outside, and its pixels.

        angles: (circles, spokes) expected. half: (circles,) half width of the profiles in radians.
        """
        offset = np.linspace(-1, 1, 2 * samples + 1)
        angles = angles[:, :, None] + half[:, None, None] * offset
        at, _ = self.seen(lambda at: self.pose.on_circles(radii[:, None, None], at), angles, 8)
        flat = at.reshape(len(at), -1, 2)
        return wheel_view.sample(self.light, flat).reshape(at.shape[:-1]), at

    def expected(self, lacing, radii):
        """Angles (circles, spokes) in the rim's plane at which spokes out of it are seen."""
        origin, axes = self.pose.frame()
        camera = -axes.T @ origin
        away = lacing.spokes[:, 1]
        along = np.sqrt(np.maximum(radii[:, None] ** 2 - away**2, 1e-6))
        z = lacing.height * (_RIM - along)
        grow = z / (z - camera[2])
        leaning = np.arcsin(np.clip(away / radii[:, None], -0.99, 0.99))

        def seen_at(at):
            x = along * np.cos(at) - away * np.sin(at)
            y = along * np.sin(at) + away * np.cos(at)
            px, py = x + grow * (camera[0] - x), y + grow * (camera[1] - y)
            # On the same circle as the profiles, not where this very point is seen.
            seen = np.maximum(np.hypot(px, py), 0.05)
            lean = np.arcsin(np.clip(away / seen, -0.99, 0.99))
            return np.arctan2(py, px) + leaning - lean

        angle = np.broadcast_to(lacing.spokes[:, 0] + self.turn, along.shape)
        _, turned = self.seen(
            lambda at: self.pose.on_circles(radii[:, None], seen_at(at)), angle, 6
        )
        return seen_at(angle + turned) - turned

    def half_width(self, radii, angles, polarity, most):
        """Half width in radians of spokes on the outer circles, blur and smear of the exposure
        included, from their mean; at most `most`."""
        outer = radii > _OUTER
        half = np.full(int(outer.sum()), most)
        profile, _ = self.profiles(radii[outer], angles[outer], half, 60)
        level = np.nanmedian(profile, axis=2, keepdims=True)
        mean = np.nanmedian((polarity * (profile - level)).reshape(-1, profile.shape[2]), axis=0)
        mean = 0.5 * (mean + mean[::-1])
        mean = mean - np.quantile(mean, 0.2)
        below = np.flatnonzero(mean[60:] < 0.5 * mean[58:63].mean())
        return most * (below[0] if len(below) else 60) / 60


@options(film=Film)
@one_thread()
def measure_wheel(
    static: Photo,
    rotating: Photo,
    turns_per_second: float | None = None,
    *,
    film: Film,
    speed_sigma_percent: float = 0.0,
    sense: str | None = None,
    row_direction: str | None = None,
    camera: Calibration = None,
) -> Readout:
    """Readout time from a wheel at rest and the same wheel turning, or from two turning bars.

    turns_per_second or video: the speed, or a film of the wheel from the same side that gives
    speed and sense; video_fps, photo_time: see `speed_from_video`. film: a `Film` in place of the
    three. Other arguments and errors as `measure_star`. Where no wheel is seen at rest and both
    pictures show one bar smeared by its rotation, `measure_bar` takes over.
    """
    if (turns_per_second is None) == (film.video is None):
        raise InputError("give either the turns a second or a video of the turning wheel")
    static, rotating = read_two(static, rotating)
    lens = lens_for(static, camera)
    known = Known(turns_per_second, speed_sigma_percent, sense, row_direction)
    if film.video is not None:
        known = known_from_film(known, film)
    try:
        rim = wheel_view.find_rim(static)
        return _measure(static, rotating, rim, lens, known)
    except NoWheel:
        bar = find_bar(static, rotating)
        if bar is None:
            raise
    return measure_bar(static, rotating, known, bar)


def _measure(static, rotating, rim, lens, known):
    lights = static.light(), rotating.light()
    radii = np.linspace(*_REACH, _CIRCLES)
    tries, most = [], 0
    for pose in wheel_view.poses_of(rim, lens):
        count = int(2 ** np.clip(math.ceil(math.log2(5.5 * pose.size)), 10, 13))
        light, _ = wheel_view.polar(lights[0], pose, radii, count, 1)
        spokes, looks = _spokes(light, radii, pose.size)
        most = max(most, len(spokes))
        if len(spokes) < _FEWEST:
            continue
        looks = replace(looks, rim_sign=wheel_view.rim_sign(lights[0], pose))
        second = wheel_view.moved(*lights, pose)
        for match, row, rate, turn in _hypotheses(lights[1], light, second, radii, looks.wide):
            views = (
                _View(lights[0], pose, row, second.axis[row]),
                _View(lights[1], second, row, second.axis[row], turn, rate),
            )
            tries.append(_Try(match, views, _Lacing(spokes, np.zeros(len(spokes))), looks, radii))
    if most < _FEWEST:
        raise NoWheel(
            f"{static.name} shows no wheel at rest: {most} straight spokes were found in the rim"
        )
    if not tries:
        raise CannotMeasure(
            f"{rotating.name} does not show the wheel of {static.name}: its spokes cannot be "
            "followed from row to row"
        )
    best = max(one.match for one in tries)
    tries = [one for one in tries if one.match > 0.85 * best][:4]
    followed = [one for one in tries if one.follow()]
    followed.sort(key=lambda one: one.scales[1])
    for one in followed[:2]:
        if one.follow() and one.follow() and one.holds():
            return one.result((static, rotating), known)
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
    """Straight spokes (n, 2): direction and distance from the axis; and how they look."""
    count = light.shape[1]
    best = None
    for width in (2.5, 4.0, 6.5, 10.0):
        wide = width / (size * radii.mean())  # radians
        # In a small rim even the thinnest spoke is wide; it is tried all the same.
        if wide > 0.06 and best is not None:
            break
        ridge = _ridge(light, wide * count / (2 * np.pi))
        for polarity in (1, -1):
            lines = _Lines(np.clip(polarity * ridge, -0.3, 1), radii, wide)
            # Twenty of the best, a spoke's width of them each.
            best_lines = np.sort(lines.score.max(axis=1))[::-1][: 20 * 4].mean()
            if best is None or best_lines > 1.03 * best[0]:
                best = (best_lines, lines, polarity, wide)
    _, lines, polarity, wide = best
    return _merged(lines.found(), radii), _Looks(polarity, wide)


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


def _hypotheses(light, still, pose, radii, wide, samples=2048):
    """Match, row, rate and turn: the best, and those with the wheel some spokes on."""
    circles = np.arange(0, len(radii), 3)
    phi = wheel_view.directions(samples)
    best = 0.0, 1, 0.0, 0.0, phi
    for row in (1, 0):
        values, rows = wheel_view.polar(light, pose, radii[circles], samples, row)
        limit = math.radians(200) / light.shape[1 - row]
        for broad in (0.016, 0.035):
            broad = max(broad, 1.2 * wide)
            moving = _ridge(values, broad * samples / (2 * np.pi))
            resting = _ridge(_resampled(still[circles], samples), broad * samples / (2 * np.pi))
            spectrum = np.conj(np.fft.rfft(resting, axis=1))
            norm = math.sqrt((resting**2).sum())
            step = 0.5 * broad / pose.size
            steps = math.ceil(limit / step)
            for rate in np.arange(-steps, steps + 1) * step:
                unwound = _unwound(moving, rate * (rows - pose.axis[row]), phi)
                total = np.fft.irfft((np.fft.rfft(unwound, axis=1) * spectrum).sum(axis=0), samples)
                match = total.max() / (norm * math.sqrt((unwound**2).sum()) + 1e-9)
                if match > best[0]:
                    best = match, row, rate, broad, total
    match, row, rate, broad, total = best
    if match < 0.12:
        return []
    hypotheses = []
    # Other multiples of a spoke, where they match about as well.
    least = 0.75 * total.max()
    guard = max(int(1.5 * broad * samples / (2 * np.pi)), 2)
    while len(hypotheses) < 3 and total.max() >= least:
        top = int(np.argmax(total))
        hypotheses.append((match, row, rate, phi[top]))
        total[np.arange(top - guard, top + guard + 1) % samples] = -np.inf
    return hypotheses


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


def _points(profile, at, polarity):
    """Points on spokes from their profiles, by the shape they have in common on each circle.

    Returns pixels (n, 2), spoke (n,) and circle (n,).
    """
    circles, spokes, length = profile.shape
    half = length // 2
    level = np.nanmedian(profile, axis=2, keepdims=True)
    clean = polarity * (profile - level)
    whole = np.isfinite(clean).all(axis=2)
    found = [(np.zeros((0, 2)), np.zeros(0, int), np.zeros(0, int))]
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
        inner = np.arange(half // 2, length - half // 2)
        cut = shape[inner] - shape[inner].mean()
        slope = inner - inner.mean()
        cut = cut - slope * (cut @ slope) / (slope @ slope)
        score = np.stack([lines[:, inner + lag] @ cut for lag in lags])
        top = np.argmax(score, axis=0)
        ok = (top > 0) & (top < len(lags) - 1)
        best = np.clip(top, 1, len(lags) - 2)
        a, b, c = (score[best + d, np.arange(len(own))] for d in (-1, 0, 1))
        ok &= (b > 0.3 * np.median(b)) & (a - 2 * b + c < 0)
        position = half + lags[best] + vertex(a, b, c)
        low = np.clip(np.floor(position).astype(int), 0, length - 2)
        share = (position - low)[:, None]
        place = at[k, own, low] * (1 - share) + at[k, own, low + 1] * share
        found.append((place[ok], own[ok], np.full(int(ok.sum()), k)))
    return tuple(np.concatenate(part) for part in zip(*found, strict=True))


# --- everything at once --------------------------------------------------------------------------


class _Try:
    """One hypothesis: pose, lacing, axis and rotation, followed until it holds or does not.

    match: correlation of the spokes. views: of the photographs at rest and turning.
    """

    def __init__(self, match, views, lacing, looks, radii):
        self.match, self.views, self.lacing = match, views, lacing
        self.looks, self.radii = looks, radii
        self.size, self.smear, self.joint = views[0].pose.size, 0.0, None

    def follow(self):
        """Points on spokes where they are expected, and a fit to them; whether there are enough."""
        found = [self._on_spokes(k, half) for k, half in enumerate(self._half_widths())]
        rims = [
            wheel_view.rim_edge(view.light, view.pose, self.looks.rim_sign) for view in self.views
        ]
        if min(len(place) for place, _ in found) < 6 * len(self.lacing.spokes):
            return False
        if min(len(rim) for rim in rims) < 60:
            return False
        self.joint = joint = _Joint(self.views, self.lacing, found, rims)
        fitted = joint.fitted
        self.lacing = joint.lacing(fitted.values)
        # The lens found so far also bends where spokes are expected.
        self.views = joint.views(fitted.values)
        groups = [joint.kind == k for k in (0, 1)]
        self.scales = [robust_scale(fitted.residuals[own]) for own in groups]
        self.kept = [float(fitted.used[own].mean()) for own in groups]
        return 0.5 < self.views[0].pose.size / self.size < 2

    def _half_widths(self):
        """Half widths (circles,) of the profiles across spokes at rest and turning, radians.

        Spokes may be wider than the ridge that found them; they must not fill their profiles.
        """
        radii, size, wide = self.radii, self.size, self.looks.wide
        widths = [
            view.half_width(radii, view.expected(self.lacing, radii), self.looks.polarity, most)
            for view, most in zip(self.views, (min(8 * wide, 0.1), 0.1), strict=True)
        ]
        own, self.smear = radii[radii > _OUTER].mean() * widths[0], widths[1]
        still = np.maximum(2.5 * wide * radii.mean(), 2.2 * own + 2 / size) / radii
        still = np.clip(still, 4 / (size * radii), 0.12)
        loose = 0.02 if self.joint is None else 0.004
        moving = np.maximum(2.2 * self.smear + 2 / (size * radii), still) + loose
        return still, np.minimum(moving, 0.2)

    def _on_spokes(self, k, half):
        """Points (n, 2) on the spokes of a picture, and whose they are (n,)."""
        angles = self.views[k].expected(self.lacing, self.radii)
        samples = int(np.clip(math.ceil(half.max() * self.size * 1.3), 12, 90))
        profile, at = self.views[k].profiles(self.radii, angles, half, samples)
        place, whose, circle = _points(profile, at, self.looks.polarity)
        # A neighbour within the profile would draw the point to itself.
        clear = _spacing(self.views[0].expected(self.lacing, self.radii))[circle, whose]
        clear = clear > 0.8 * half[circle]
        return place[clear], whose[clear]

    def holds(self):
        """Whether the bent spokes are as good as the straight ones, blur by the turn aside."""
        blurred = 0.1 * self.smear * self.size * self.radii.mean()
        return self.scales[1] < 2.5 * self.scales[0] + 0.5 + blurred and self.kept[1] > 0.55

    def result(self, photos, known):
        """The readout. Raises CannotMeasure where the wheel is at rest."""
        joint, view = self.joint, self.views[1]
        # Few spokes understate what they have in common; spokes are not quite straight lines.
        sigma = joint.fitted.sigma(_RATE, joint.cluster, 1.4)
        sigma = math.hypot(sigma, _SYSTEMATIC * view.rate)
        shown = np.flatnonzero(joint.member >= 0)
        turning = Turning(
            "wheel", photos, view.row, view.rate, sigma, joint.pixels[shown],
            joint.fitted.residuals[shown], joint.fitted.used[shown], joint.kind[shown],
            joint.kind[shown] == 1, np.asarray(view.pose.axis),
            [_curves(one, self.lacing) for one in self.views],
        )  # fmt: skip
        turning.check_turns(0.5)
        extra = {"spokes": len(self.lacing.spokes), "residual_px": self.scales}
        return turning.readout(known, _METHOD, extra)


def _spacing(angles):
    """Distance (circles, spokes) of each spoke from its nearest neighbour, radians."""
    apart = np.abs((angles[:, :, None] - angles[:, None] + np.pi) % (2 * np.pi) - np.pi)
    apart[:, np.eye(angles.shape[1], dtype=bool)] = np.inf
    return apart.min(axis=2)


_RATE = 12  # place of the rotation per row among the parameters
# A thousand points see a hundredth of a pixel, to which neither are spokes straight nor rims round:
# what is known beforehand must not give way to that.
_FLOOR = 0.12
# Six degrees each way: other tilts (2,), radians, from which a fit begins that has gone astray.
_TILTS = [(0.1, 0.0), (0.0, 0.1), (-0.1, 0.0), (0.0, -0.1)]
_SHARED = 14  # parameters before those of the lens and of the spokes
_STEPS = [1e-5, 1e-5, 1e-2, 1e-2, 1e-5, 1e-4, 1e-5, 1e-5, 1e-2, 1e-2, 1e-5, 1e-5, 1e-8, 1e-3]


class _Joint:
    """Pose, shift of the camera, lens, lacing and rotation per row from all points.

    Parameters: tilt 2, axis 2, log size, log focal; changes of the first five to the second
    picture; turn, rate, height of the rim's plane; lens; direction, distance and height of each
    spoke. kind (n,): 0, 1 on spokes at rest and turning, 2, 3 on the rims; member (n,): which
    spoke, -1 on rims.
    """

    def __init__(self, views, lacing, found, rims):
        self._views, self.number = views, len(lacing.spokes)
        parts = [found[0][0], found[1][0], *rims]
        self.pixels = np.concatenate(parts)
        self.kind = np.repeat(np.arange(4), [len(part) for part in parts])
        on_rims = np.full(len(rims[0]) + len(rims[1]), -1)
        self.member = np.concatenate([found[0][1], found[1][1], on_rims])
        self.lens = views[0].pose.lens
        self.first = _SHARED + len(self.lens.sigmas)
        self.kinds = [self.first + k * self.number + np.arange(self.number) for k in range(3)]
        # A first fit, to points not yet well placed, leaves the lens alone.
        self.loose = lacing.rim_height is not None
        self.fitted = self._fit(lacing, views[0].pose.tilt)
        if self._astray(self.fitted):
            best = min((self._fit(lacing, tilt) for tilt in _TILTS), key=self._misfit)
            # On a long way spokes are lost: once more from where it ended.
            again = self._fit(lacing, best.values[:2])
            self.fitted = min((self.fitted, best, again), key=self._misfit)

    def views(self, v):
        """Both photographs as the parameters have them."""
        first, second = self._views
        seen = self.lens.focal * math.exp(v[5]), self.lens, v[_SHARED : self.first]
        one = Pose((v[0], v[1]), (v[2], v[3]), math.exp(v[4]), *seen)
        tilt, axis = (v[0] + v[6], v[1] + v[7]), (v[2] + v[8], v[3] + v[9])
        two = Pose(tilt, axis, math.exp(v[4] + v[10]), *seen)
        turned = {"turn": float(v[11]), "rate": float(v[_RATE])}
        return replace(first, pose=one), replace(second, pose=two, **turned)

    def lacing(self, v):
        """The lacing as the parameters have it."""
        angle, away, height = (v[kind] for kind in self.kinds)
        return _Lacing(np.stack([angle, away], axis=1), height, float(v[13]))

    @property
    def cluster(self):
        """What errs together: points (n,) of one spoke in one picture, of one rim."""
        on_spoke = self.member + self.number * (self.kind == 1)
        return np.where(self.member >= 0, on_spoke, 2 * self.number + self.kind)

    def residuals(self, v):
        """Distances (n,) px from spokes and rims."""
        out = np.empty(len(self.pixels))
        for view, own in zip(self.views(v), (self.kind % 2 == 0, self.kind % 2 == 1), strict=True):
            pixels, member = self.pixels[own], self.member[own]
            camera, direction, depth = view.pose.rays(pixels)
            scale = view.pose.focal / depth
            hit = camera[:2] + depth[:, None] * direction[:, :2]
            result = (np.hypot(*hit.T) - 1) * scale
            spoke = member >= 0
            who, d = member[spoke], direction[spoke]
            angle, away, w = (v[kind][who] for kind in self.kinds)
            angle = angle + view.turn + view.rate * (pixels[spoke, view.row] - view.reference)
            c, s = np.cos(angle), np.sin(angle)
            # Normal of the plane through the spoke (c, s, -w) and the ray.
            normal = np.cross(np.stack([c, s, -w], axis=1), d)
            on_spoke = np.stack([-away * s, away * c, w * (_RIM + v[13])], axis=1)
            gap = np.sum((camera - on_spoke) * normal, axis=1)
            result[spoke] = gap / np.linalg.norm(normal, axis=1) * scale[spoke]
            out[own] = result
        return out

    def prior(self, v):
        """What is known beforehand, in sigmas: camera hardly moved, ordinary lens and flanges."""
        lens = self.lens
        focal = lens.focal_sigma if self.loose and lens.focal_sigma else 1e-9
        sigmas = lens.sigmas if self.loose else 1e-9 * lens.sigmas
        return np.concatenate(
            [
                [v[5] / focal, v[6] / 0.003, v[7] / 0.003, v[13] / 0.05],
                v[_SHARED : self.first] / sigmas,
                v[self.kinds[2]] / 0.12,
                [v[2] / 1e5, v[10] / 0.05],
            ]
        )

    def _astray(self, fitted) -> bool:
        """Whether the focal length is none that such a camera has.

        A wheel seen nearly from the front hardly tells it, and which way it leans less; a fit that
        begins on the wrong side runs away with both.
        """
        return self.loose and abs(self.prior(fitted.values)[0]) > 3.0

    def _misfit(self, fitted) -> float:
        """Squares of residuals and of what is known beforehand, over their variances.

        A spoke that was lost counts as five sigmas: the fit without it is no better.
        """
        away = np.minimum(np.abs(fitted.residuals) / _FLOOR, 5.0)
        return float(np.sum(away**2) + np.sum(self.prior(fitted.values) ** 2))

    def _fit(self, lacing, tilt) -> Fitted:
        """The fit that begins with a tilt (2,) of the wheel, radians."""
        first, second = self._views
        one, two = first.pose, second.pose
        focal = math.log(one.focal / self.lens.focal)
        start = np.concatenate(
            [
                [*tilt, *one.axis, math.log(one.size), focal],
                np.subtract(two.tilt, one.tilt),
                np.subtract(two.axis, one.axis),
                [math.log(two.size / one.size), second.turn, second.rate, lacing.rim_height or 0.0],
                one.bent,
                *lacing.spokes.T,
                lacing.height,
            ]
        )
        each = np.repeat([1e-4, 1e-5, 1e-5, 1e-3], [len(one.bent), *[self.number] * 3])
        return fit(
            self.residuals,
            start,
            np.concatenate([_STEPS, each]),
            self.prior,
            floor=_FLOOR,
            groups=self.kind,
            own=(self.kinds, self.member),
            rough=not self.loose,
        )


def _curves(view, lacing):
    """Lines of pixels along every spoke, for the drawing."""
    angle, away = lacing.spokes.T[:, :, None]
    along = np.sqrt(np.maximum(np.linspace(0.15, 0.97, 40) ** 2 - away**2, 0))
    z = lacing.height[:, None] * (_RIM - along)

    def place(at):
        c, s = np.cos(at), np.sin(at)
        return view.pose.pixels(along * c - away * s, along * s + away * c, z)

    angle = np.broadcast_to(angle + view.turn, along.shape)
    return list(view.seen(place, angle, 12)[0])
