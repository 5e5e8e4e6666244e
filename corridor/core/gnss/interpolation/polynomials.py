"""Curves through the epochs: what other programs do, for comparison.

None of them smooths, and none knows how the antenna moves between epochs: the standard deviation
that can be propagated is that of the positions' noise alone. In a turn the error is larger, with
the parabola up to four times.
"""

from collections.abc import Callable

import numpy as np

# Epochs on each side that can reach a moment; a spline's weights fall to 0.27 an epoch.
_REACH = {"linear": 1, "parabola": 2, "pchip": 2, "spline": 6}


Curve = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def _of_scipy(name: str, **options) -> Curve:
    """A curve through all epochs: value and rate of change, (m, k).

    Of time (n,) s, rising, values (n, k), and the moments (m,) s.
    """

    def curve(time, values, at):
        from scipy import interpolate  # at first use: only a comparison needs it

        made = getattr(interpolate, name)(time, values, **options)
        return made(at), made(at, 1)

    return curve


linear = _of_scipy("make_interp_spline", k=1)


def parabola(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value and rate of change, (m, k), on the parabola through the three nearest epochs.

    As MicMac does. Two epochs make a line. Shapes as in `_of_scipy`.
    """
    if len(time) < 3:
        return linear(time, values, at)
    # The centre of the three is the nearest epoch; at the ends the nearest that has neighbours.
    right = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    centre = np.where(at - time[right - 1] <= time[right] - at, right - 1, right)
    centre = np.clip(centre, 1, len(time) - 2)
    before, here, after = (time[centre + k] for k in (-1, 0, 1))
    first = (values[centre] - values[centre - 1]) / (here - before)[:, None]
    second = (values[centre + 1] - values[centre]) / (after - here)[:, None]
    bend = (second - first) / (after - before)[:, None]
    since, past = (at - before)[:, None], (at - here)[:, None]
    return values[centre - 1] + since * (first + past * bend), first + (since + past) * bend


# The spline is cubic (not-a-knot); pchip is the monotone cubic of Fritsch and Carlson 1980.
CURVES: dict[str, Curve] = {
    "linear": linear,
    "parabola": parabola,
    "spline": _of_scipy("CubicSpline"),
    "pchip": _of_scipy("PchipInterpolator"),
}


def propagated(
    method: str, time: np.ndarray, values: np.ndarray, sigma: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Standard deviation (m, 3) from independent noise of the epochs, sigma (n, 3).

    Each epoch in reach is moved by its sigma and the change of the curve is summed in squares.
    """
    reach, curve = _REACH[method], CURVES[method]
    result = np.zeros((len(at), values.shape[1]))
    first = np.searchsorted(time, at) - reach
    first = np.clip(first, 0, max(len(time) - 2 * reach, 0))
    for start in np.unique(first):
        rows = slice(start, start + 2 * reach)
        these = first == start
        t, z, s = time[rows], values[rows], sigma[rows]
        moved = np.repeat(z[:, None, :], len(t) + 1, axis=1)
        moved[range(len(t)), range(1, len(t) + 1)] += s
        got = curve(t, moved.reshape(len(t), -1), at[these])[0].reshape(-1, len(t) + 1, z.shape[1])
        result[these] = np.sqrt(((got[:, 1:] - got[:, :1]) ** 2).sum(axis=1))
    return result
