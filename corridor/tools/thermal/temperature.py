"""What the optics feel, from what the thermometer says.

A sensor's register is turned into degrees, rounding is smoothed away over time, and the optics
follow the thermometer through a first-order lag:

    lag dT/dt = thermometer - T
"""

from itertools import pairwise

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import minimize_scalar
from scipy.signal import find_peaks

from corridor.core.engine.compiled import compiled

_FINE = 8  # pieces of the thermometer's curve from one picture to the next
_LEAST_TO_SMOOTH = 8
_WANDERS = 0.1  # of the range: a move of the temperature that is none
_SLACK = 1.1  # of the variance of rounding, which few temperatures miss by chance


def degrees(register: np.ndarray, gain: float, offset: float) -> np.ndarray:
    """Degrees Celsius from the value of a sensor's register, which is gain * T + offset.

    Source: Zhou 2019, eq. 6.1 (its a and b).
    """
    return (np.asarray(register, dtype=float) - offset) / gain


def smoothed(time_s: np.ndarray, temperature_c: np.ndarray) -> np.ndarray:
    """Temperatures (n,), C, smoothed over time by a cubic spline.

    Rounded temperatures: the smoothest curve that misses them by no more than rounding does
    (step / sqrt 12); cross-validation would follow the steps of a slow curve. Others: by
    generalised cross-validation. Where the highest (or lowest) temperature lies within the series
    the heating may have been switched: each side then gets a curve of its own, if those are
    smoother. Unknown temperatures (NaN) stay unknown; fewer than eight known ones are handed back
    as they are.
    """
    time, warm = np.asarray(time_s, dtype=float), np.asarray(temperature_c, dtype=float)
    known = np.isfinite(warm)
    when, place, count = np.unique(time[known], return_inverse=True, return_counts=True)
    if len(when) < _LEAST_TO_SMOOTH or np.ptp(warm[known]) == 0:
        return warm.copy()
    mean = np.bincount(place, warm[known]) / count
    step = rounding(warm[known])
    best, stiff = _spline(when, mean, step)
    least = np.inf
    if step:
        reach = max(2, len(when) // 60)
        for turn in (int(np.argmax(best)), int(np.argmin(best))):
            for cut in range(turn - reach, turn + reach + 1):
                if not _LEAST_TO_SMOOTH <= cut <= len(when) - _LEAST_TO_SMOOTH:
                    continue
                parts = (np.s_[:cut], np.s_[cut:])
                sides = [_spline(when[part], mean[part], step) for part in parts]
                stiffer = min(side[1] for side in sides)
                tried = np.concatenate([side[0] for side in sides])
                left = np.sum((mean - tried) ** 2)
                if (stiffer, -left) > (stiff, -least):
                    best, stiff, least = tried, stiffer, left
    out = warm.copy()
    out[known] = best[place]
    return out


def rounding(temperature_c: np.ndarray) -> float:
    """Step to which temperatures (n,) are rounded, C; 0 where they hardly ever repeat."""
    values = np.unique(np.round(temperature_c, 6))
    if len(values) < 2 or len(values) > 0.8 * len(temperature_c):
        return 0.0
    return float(np.diff(values).min())


def _spline(when, mean, step):
    """A curve at the times, and log10 of its stiffness (times counted in mean intervals).

    It is a spline about a + b exp(-t / c), which is how things warm and cool (Newton) and what a
    spline of one stiffness would have to bend for.
    """
    # The spline's matrices lose digits with large and small numbers.
    at = (when - when[0]) * (len(when) - 1) / (when[-1] - when[0])
    newton = _newton(at, mean)
    rest = mean - newton
    if not step:
        return newton + make_smoothing_spline(at, rest)(at), 0.0
    low, high = -4.0, 10.0
    for _ in range(20):
        middle = (low + high) / 2
        left = np.mean((make_smoothing_spline(at, rest, lam=10.0**middle)(at) - rest) ** 2)
        low, high = (middle, high) if left <= _SLACK * step**2 / 12 else (low, middle)
    return newton + make_smoothing_spline(at, rest, lam=10.0**low)(at), low


def _newton(at, mean):
    """The exponential through temperatures that leaves least."""

    def fitted(exponent):
        design = np.stack([np.ones(len(at)), np.exp(-at / 10.0**exponent)], axis=1)
        return design @ np.linalg.lstsq(design, mean, rcond=None)[0]

    def left(exponent):
        return float(np.sum((mean - fitted(exponent)) ** 2))

    low, high = np.log10(at[-1] / 20), np.log10(5 * at[-1])
    found = minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 1e-3})
    return fitted(found.x)


class Thermometer:
    """The course of a thermometer, for optics of any lag behind it.

    time_s, temperature_c: (n,) in any order; NaN temperatures stay unknown and are passed over.
    Before the first one the thermometer is taken as constant; between them it follows a curve
    that does not overshoot (PCHIP) and may have a corner at its highest and lowest.
    """

    def __init__(self, time_s: np.ndarray, temperature_c: np.ndarray):
        time, self._warm = np.asarray(time_s, float), np.array(temperature_c, float)
        self._known = np.isfinite(self._warm)
        when, self._place, count = np.unique(
            time[self._known], return_inverse=True, return_counts=True
        )
        self._moments = len(when)
        if self._moments < 2:
            return
        mean = np.bincount(self._place, self._warm[self._known]) / count
        fine = (when[:-1, None] + np.diff(when)[:, None] * (np.arange(_FINE) / _FINE)).ravel()
        self._fine = fine = np.append(fine, when[-1])
        self._course = np.empty(len(fine))
        # At its highest and lowest the heating may have been switched: a corner, no summit.
        inside = {int(np.argmax(mean)), int(np.argmin(mean))} - {0, len(when) - 1}
        corners = [0, *sorted(inside), len(when) - 1]
        for first, last in zip(corners[:-1], corners[1:], strict=True):
            part, at = np.s_[first : last + 1], np.s_[first * _FINE : last * _FINE + 1]
            if last - first > 1:
                self._course[at] = _monotone(when[part], mean[part], fine[at])
            else:
                self._course[at] = np.interp(fine[at], when[part], mean[part])

    def optics(self, lag_s: float) -> np.ndarray:
        """Temperature of the optics (n,), C: the thermometer's through a first-order lag."""
        out = self._warm.copy()
        if lag_s > 0 and self._moments > 1:
            felt = _lagged(self._fine, self._course, lag_s)[::_FINE]
            out[self._known] = felt[self._place]
        return out


def optics(time_s: np.ndarray, temperature_c: np.ndarray, lag_s: float) -> np.ndarray:
    """Temperature of the optics (n,), C, at one lag behind a `Thermometer`."""
    return Thermometer(time_s, temperature_c).optics(lag_s)


@compiled()
def _monotone(x, y, fine):
    """PCHIP through y at x, of which each interval has `_FINE` pieces, as SciPy's: many courses.

    Source: Fritsch and Butland 1984; the ends are those of Moler 2004, section 3.6.
    """
    n = len(x) - 1
    h, rise = np.diff(x), np.diff(y) / np.diff(x)
    slope = np.zeros(n + 1)
    for k in range(1, n):
        if rise[k - 1] * rise[k] > 0:
            w1, w2 = 2 * h[k] + h[k - 1], h[k] + 2 * h[k - 1]
            slope[k] = (w1 + w2) / (w1 / rise[k - 1] + w2 / rise[k])
    for k, h0, h1, m0, m1 in (
        (0, h[0], h[1], rise[0], rise[1]),
        (n, h[n - 1], h[n - 2], rise[n - 1], rise[n - 2]),
    ):
        one = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
        if np.sign(one) != np.sign(m0):
            one = 0.0
        elif np.sign(m0) != np.sign(m1) and abs(one) > 3 * abs(m0):
            one = 3 * m0
        slope[k] = one
    out = np.empty(len(fine))
    for j in range(len(fine)):
        k = min(j // _FINE, n - 1)
        s, bend = fine[j] - x[k], (slope[k] + slope[k + 1] - 2 * rise[k]) / h[k]
        curve = (rise[k] - slope[k]) / h[k] - bend
        out[j] = y[k] + s * (slope[k] + s * (curve + s * bend / h[k]))
    return out


@compiled()
def _lagged(time, warm, lag):
    out = np.empty_like(warm)
    out[0] = warm[0]
    for k in range(1, len(time)):
        # Exact for a straight piece.
        step = time[k] - time[k - 1]
        rate = (warm[k] - warm[k - 1]) / step
        left = np.exp(-step / lag)
        out[k] = warm[k] - rate * lag + (out[k - 1] - warm[k - 1] + rate * lag) * left
    return out


def turns(time_s: np.ndarray, temperature_c: np.ndarray) -> float:
    """Share of the temperature range (0 to 1) that is gone through upwards and downwards.

    A lag shows where the same temperature is met while warming and while cooling; from warming
    alone it cannot be told from a bent dependence on temperature.
    """
    order = np.argsort(time_s, kind="stable")
    warm = np.asarray(temperature_c, dtype=float)[order]
    warm = warm[np.isfinite(warm)]
    span = float(np.ptp(warm)) if len(warm) else 0.0
    if span == 0:
        return 0.0
    place = (warm - warm.min()) / span
    # What goes back by less than a tenth of the range is noise or rounding.
    ends = [find_peaks(side * place, prominence=_WANDERS)[0] for side in (1.0, -1.0)]
    extremes = place[np.unique([0, *np.concatenate(ends), len(place) - 1])]
    levels, met = np.linspace(0, 1, 201), {True: False, False: False}
    for start, end in pairwise(extremes):
        if abs(end - start) >= _WANDERS:
            inside = (levels >= min(start, end)) & (levels <= max(start, end))
            met[bool(end > start)] |= inside
    return float(np.mean(met[True] & met[False]))
