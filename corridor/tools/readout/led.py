"""Readout time from one photograph of something lit by a LED that blinks at a known frequency.

Every period of the light is a bright and a dark stripe, so readout = (L - 1) / (rows a period x
frequency). The rows' mean light is modelled as

    background(y) + sum over h of envelope_h(y) cos(h 2 pi y / period + phase_h)

with smooth background and envelopes. Symmetric stripes keep their phases whatever the envelope
does to their shape: over-exposure, gamma and duty cycle change the harmonics, not their period.

What OpenDroneMap's users do by counting stripes.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from corridor.core.camera import SLOWEST_READOUT_S
from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.tools.readout.fitting import sigmas_of, vertex
from corridor.tools.readout.photograph import CannotMeasure, Photo, read
from corridor.tools.readout.result import Readout, StripesDrawing, sigma_with_speed

_BLOCKS = 32  # strips of the picture across the stripes
_HARMONICS = 15
# Degrees of the smooth background and of the envelopes, as shares of the stripes, and at most: a
# polynomial of degree n has n / 2 waves, which must stay apart from the stripes.
_BACKGROUND, _ENVELOPE = (1.0, 16), (0.5, 8)
# Few stripes that are free to have any shape are in every picture: half of all that for them.
_FEW = 10.0
_EDGES = 40  # harmonics of the stripes' edges, beyond which they drown in noise
_HIGH = 5  # harmonics whose envelopes are free; those of higher ones are stiffer
_FEWEST_STRIPES, _FEWEST_ROWS = 3.0, 3.0
_SATURATED, _WHITE = 250, 0.93  # grey value; share of the picture above which nothing is left
_ONE_PHASE = 0.8  # stripes go straight across the picture
# A quartz, of the light or of the camera, keeps its frequency so well, as a share.
_QUARTZ = 1e-5
# Shares of a period: 60 simulated photographs reach 0.016, but where the exposure is one period.
_UNEVEN = 0.04
# A row of a rolling shutter: 15 to 60 ms for 3,000 rows (published readout times).
_ROW_S = 5e-6, 20e-6
# Cameras of a thousand pictures a second need a millisecond; a frequency in mHz leaves a thousandth
# of the 15 to 60 ms.
_FASTEST_MS = 0.1
_GAIN = 3.0  # by which the stripes must shrink what a smooth light leaves over
_METHOD = (
    "frequency of the stripes in the mean light of the rows: up to 15 harmonics with smooth "
    "envelopes by least squares"
)


@one_thread()
def measure_led(
    photo: Photo,
    frequency_hz: float,
    *,
    frequency_sigma_percent: float = 0.0,
    row_direction: str | None = None,
) -> Readout:
    """Readout time from the stripes of a LED that blinks `frequency_hz` times a second.

    photo: a file, or a photograph that has been read. frequency_sigma_percent: standard error of
    the frequency. row_direction: what is known of it; one picture of a LED tells the axis of the
    rows only.
    Raises CannotMeasure where there are no stripes to measure, saying why when it can be told;
    InputError where row_direction contradicts the stripes.
    """
    photo = read(photo)
    light = photo.light()
    bright = float((photo.grey >= _SATURATED).mean())
    if bright > _WHITE:
        raise CannotMeasure(_why_not(photo, frequency_hz, bright))
    seen = [one for axis in ("y", "x") for one in _search(light, axis)]
    found = [_fit(one) for one in seen]
    fitted = max((one for one in found if one), key=lambda one: one.gain, default=None)
    if fitted is None or fitted.gain < _least_gain(fitted.stripes):
        few = [s for one in seen if (s := one.cycles * len(one.signal)) < _FEWEST_STRIPES]
        raise CannotMeasure(_why_not(photo, frequency_hz, bright, max(few, default=None)))
    cycles, axis, rows = fitted.cycles, fitted.axis, len(fitted.signal)
    stripes = cycles * rows
    if 1 / cycles < _FEWEST_ROWS:
        raise CannotMeasure(
            f"{photo.name}: a period of the light is {1 / cycles:.1f} rows, which is too short to "
            "measure: use a lower frequency"
        )
    if row_direction is not None and (row_direction in ("down", "up")) != (axis == "y"):
        raise InputError(
            f"--row-direction {row_direction} contradicts {photo.name}: its stripes say that rows "
            f"follow each other along {axis}"
        )
    warnings = []
    if row_direction is None:
        warnings.append(
            "a LED shows the axis of the rows, not the direction in which they are read"
        )
    if stripes < 10:
        warnings.append(f"{stripes:.1f} stripes: with ten or more the result is better")
    if _broken(light if axis == "y" else light.T, cycles):
        warnings.append(
            "strips of the picture show stripes twice as wide, which do not go straight across: is "
            "the file damaged?"
        )
    uneven = _uneven(fitted)
    if uneven > _UNEVEN:
        warnings.append(
            f"the stripes do not follow each other evenly, they are off by {uneven:.2f} of a "
            "period (RMS): is the file damaged, or the light not steady?"
        )
    if photo.exposure_s and abs(photo.exposure_s * frequency_hz - 1) < 0.05:
        warnings.append("the exposure is close to one period of the light: the stripes are weak")
    readout = 1e3 * (rows - 1) * cycles / frequency_hz
    slow = readout > 1e3 * SLOWEST_READOUT_S
    if slow or readout < _FASTEST_MS:
        raise InputError(
            f"--frequency {frequency_hz:g}: the readout time would be {readout:,.4g} ms, "
            f"{'longer' if slow else 'shorter'} than that of any camera; give the frequency in Hz "
            "(0.5 kHz is 500)"
        )
    own = 1e3 * (rows - 1) * fitted.sigma / frequency_hz
    found = Readout(
        target="led",
        method=_METHOD,
        readout_ms=readout,
        sigma_ms=sigma_with_speed(readout, own, frequency_sigma_percent),
        row_axis=axis,
        row_direction=row_direction,
        rows=rows,
        frequency_hz=frequency_hz,
        warnings=tuple(warnings),
        extra={"stripes": stripes, "rows_per_period": 1 / cycles, "saturated_share": bright},
        drawing=StripesDrawing(photo, fitted.signal, fitted.model),
    )
    return found.beside_published(photo)


def _broken(light, cycles) -> bool:
    """Whether light (rows, columns) has stripes of half as many cycles in its strips, which
    cancel in the picture as a whole."""
    strips = np.array_split(light, _BLOCKS, axis=1)
    rows = np.stack([strip.mean(axis=1) for strip in strips])
    flat = (rows - rows.mean(axis=1)[:, None]) * np.hanning(rows.shape[1])
    turns = np.exp(-2j * np.pi * np.outer(np.arange(rows.shape[1]), [0.5, 1.0]) * cycles)
    half, found = np.abs(flat @ turns).mean(axis=0)
    return bool(half > found)


def _uneven(found) -> float:
    """By how much stripes lie beside even spacing, RMS, as a share of a period: their phase in
    windows of four periods, where they are seen."""
    signal, row = found.signal, np.arange(len(found.signal))
    size = min(round(4 / found.cycles), len(signal) // 3)
    flat = signal - np.convolve(signal, np.full(size, 1 / size), "same")
    turning = flat * np.exp(-2j * np.pi * found.cycles * row)
    seen = np.convolve(turning, np.hanning(size + 2)[1:-1], "valid")
    seen = seen[np.abs(seen) > 0.3 * np.median(np.abs(seen))]
    return float(np.sqrt(np.mean(np.angle(seen * np.conj(seen.sum())) ** 2))) / (2 * math.pi)


def _least_gain(stripes: float) -> float:
    """By how much stripes must shrink the squares: more of them where few are."""
    lacking = np.clip((_FEW - stripes) / (_FEW - _FEWEST_STRIPES), 0.0, 1.0)
    return _GAIN * (1 + 9 * float(lacking))


def _why_not(photo, frequency, bright, few=None):
    if bright > 0.5:
        return (
            f"{photo.name} is overexposed ({100 * bright:.0f} % of it is white), so its stripes "
            "cannot be seen: expose for a shorter time or dim the light"
        )
    periods = (photo.exposure_s or 0.0) * frequency
    if periods > 0.5 and abs(periods - round(periods)) < 0.03:
        return (
            f"{photo.name} shows no stripes: its exposure of {1e3 * photo.exposure_s:.3g} ms is "
            f"{round(periods)} periods of the light, over which it averages out; use another"
        )
    if few is not None:
        return (
            f"{photo.name} shows no stripes that can be measured: its light has about {few:.1f} "
            f"periods along the rows, and {_FEWEST_STRIPES:g} are the fewest; let it blink faster "
            f"than {frequency:g} Hz, or expose for less than a period"
        )
    if frequency > 1 / (_FEWEST_ROWS * _ROW_S[1]):
        return (
            f"{photo.name} shows no stripes: a period of {frequency:g} Hz lasts "
            f"{1e6 / frequency:.3g} us, and cameras read a row in {1e6 * _ROW_S[0]:g} to "
            f"{1e6 * _ROW_S[1]:g} us, so that its stripes are a few rows wide or less: use a lower "
            "frequency"
        )
    return (
        f"{photo.name} shows no stripes: the light does not blink, there are fewer than "
        f"{_FEWEST_STRIPES:g} of them (blink faster), or the exposure is a multiple of the period, "
        "at which stripes vanish (expose for a shorter time)"
    )


@dataclass(frozen=True)
class _Stripes:
    """Stripes across the rows' light (rows,): axis of the rows, cycles a row."""

    axis: str
    signal: np.ndarray
    cycles: float


@dataclass(frozen=True)
class _Fitted(_Stripes):
    """Stripes as fitted: sigma of the cycles, model (rows,), stripes they were looked for with, and
    gain: by how much the squares that the background leaves are larger than what all leaves."""

    sigma: float
    model: np.ndarray
    stripes: float
    gain: float


def _search(light, axis):
    """Candidates for the stripes: the rows' light, weighted to show them best, and a frequency."""
    if axis == "x":
        light = light.T
    rows, columns = light.shape
    cuts = np.linspace(0, columns, _BLOCKS + 1).astype(int)
    blocks = np.stack(
        [light[:, a:b].mean(axis=1) for a, b in zip(cuts[:-1], cuts[1:], strict=True)], axis=1
    ).astype(float)
    position = np.linspace(-1, 1, rows)
    smooth = chebyshev.chebvander(position, 5)
    flat = blocks - smooth @ np.linalg.lstsq(smooth, blocks, rcond=None)[0]
    size = 4 * rows
    spectrum = np.fft.rfft(flat * np.hanning(rows)[:, None], size, axis=0)
    low, high = int(_FEWEST_STRIPES * size / rows), int(0.45 * size)
    coherent = np.abs(spectrum.mean(axis=1)) ** 2
    candidates = []
    for peak in (_line(coherent, low, high), low + int(np.argmax(coherent[low:high]))):
        at = spectrum[peak]
        total = np.abs(at.sum()) + 1e-30
        # In phase with the stripes, against what else varies along the rows.
        along = np.maximum((at * np.conj(at.sum())).real / total, 0)
        rest = (np.abs(spectrum[low:]) ** 2).sum(axis=0) - (
            np.abs(spectrum[max(peak - 8, low) : peak + 9]) ** 2
        ).sum(axis=0)
        weight = along / (np.maximum(rest, 0) + 1e-3 * (np.abs(at) ** 2).max() + 1e-12)
        if weight.sum() <= 0:
            continue
        weight /= weight.sum()
        power = np.abs(spectrum @ weight) ** 2
        near = slice(max(peak - 3, low), min(peak + 4, high))
        best = near.start + int(np.argmax(power[near]))
        # Quantisation alone leaves something on a picture without any light at all.
        if 4 * math.sqrt(power[best]) / rows < 2e-4:
            continue
        lit = np.abs(at) > 0.2 * np.abs(at).max()
        if abs(at[lit].sum()) < _ONE_PHASE * np.abs(at[lit]).sum():
            continue
        place = best + vertex(*np.log(power[best - 1 : best + 2] + 1e-30))
        candidates.append(_Stripes(axis, blocks @ weight, float(place) / size))
    return candidates


def _line(power, low, high):
    """The strongest line of a spectrum over what surrounds it: stripes, not a slow change."""
    index = np.arange(low, high)
    shape = np.log(power[low:high] + 1e-12)
    # The window spreads a line over 8 bins to either side; what lies beyond is its surroundings.
    nodes = np.unique(np.geomspace(low, high - 1, 60).astype(int))
    around = []
    for n in nodes - low:
        below = shape[max(int((n + low) / 1.7) - low, 0) : max(n - 10, 1)]
        above = shape[min(n + 10, len(shape) - 1) : max(int(1.7 * (n + low)) - low, n + 12)]
        around.append(np.median(np.concatenate([below, above])))
    over = shape - np.interp(index, nodes, around)
    strongest = shape.max()
    # A line in the noise may stand out of nothing: it must carry some of the light as well.
    over[shape < strongest - 7] = -np.inf
    return int(low + np.argmax(over))


def _fit(found: _Stripes) -> _Fitted | None:
    """The stripes by least squares, or None where the steps do not settle."""
    signal, cycles = found.signal, found.cycles
    rows = len(signal)
    row = np.arange(rows) - (rows - 1) / 2
    stripes = cycles * rows
    basis = _Basis(rows, cycles)
    if stripes < _FEWEST_STRIPES:
        return None
    background = basis.background
    flat = signal - background @ np.linalg.lstsq(background, signal, rcond=None)[0]
    window, turns = flat * np.hanning(rows), -2j * np.pi * (basis.orders * cycles)
    phase = np.angle([np.sum(window * np.exp(turn * row)) for turn in turns])
    weights = np.ones(rows)
    for step in range(25):
        root = np.sqrt(weights)
        base, slopes = basis.linearised(signal, root, row, cycles, phase)
        design = np.hstack([slopes, base]) * root[:, None]
        # Harmonics that are not there have no phase: a little of a prior holds them.
        scale = np.linalg.norm(design, axis=0) + 1e-15
        normal = (design / scale).T @ (design / scale) + 1e-9 * np.eye(len(scale))
        inverse = np.linalg.solve(normal, (design / scale).T) / scale[:, None]
        solved = inverse @ (signal * root)
        # The light itself is solved for anew; slopes lead from where the phases are.
        change = solved[0] * 2.0 / rows
        cycles += change
        if abs(cycles - found.cycles) > 0.7 / rows:
            return None
        phase = phase + np.clip(solved[1 : 1 + len(phase)], -0.5, 0.5)
        model = (design @ solved) / root
        residual = signal - model
        # Rows with a scratch or a lamp in them; edges of stripes are no outliers.
        weights = 1 / np.maximum(1, np.abs(residual) / (5 * robust_scale(residual) + 1e-9))
        if step > 3 and abs(change) < 1e-9:
            break
    influence = inverse[0] * root * 2.0 / rows
    cluster = np.floor((row - row[0]) * cycles).astype(int)
    noise, lines, edge = basis.without_edges(residual, row, cycles)
    # Where nearly every edge lies on a line that is fitted, the rest says little of its size: the
    # fitted harmonics count as one line more.
    fitted = basis.fitted_edge(solved[1 + len(phase) :])
    edge = math.sqrt((lines / 2 * edge**2 + fitted**2) / (lines / 2 + 1))
    # The larger of the two would be too large by what chance does to either.
    sigma = math.hypot(*sigmas_of(influence, noise, np.ones(rows), cluster)) / math.sqrt(2)
    # Squares that the fit took up, and those lines, are missing in what is left.
    sigma *= math.sqrt(rows / max(rows - len(solved) - lines, 1))
    sigma = math.hypot(sigma, basis.moved_by_edges(influence, row, cycles, edge))
    sigma = math.hypot(sigma, _QUARTZ * cycles)
    gain = float(flat @ flat) / float(residual @ residual + 1e-30)
    return _Fitted(found.axis, signal, float(cycles), sigma, model, stripes, gain)


class _Basis:
    """Smooth background and harmonics with smooth envelopes over the rows."""

    def __init__(self, rows, cycles):
        position, stripes = np.linspace(-1, 1, rows), cycles * rows
        freedom = 1.0 if stripes > _FEW else 0.5

        def degree(share, most):
            return int(np.clip(freedom * share * stripes, 1, most))

        orders = range(1, int(freedom * _HARMONICS) + 1)
        self.orders = np.array([h for h in orders if h * cycles < 0.45])
        self.background = chebyshev.chebvander(position, degree(*_BACKGROUND))
        free = chebyshev.chebvander(position, degree(*_ENVELOPE))
        self.envelopes = [free if h <= _HIGH else free[:, :3] for h in self.orders]

    def without_edges(self, residual, row, cycles):
        """What is left (rows,) without the harmonics of the stripes' edges that are not fitted, how
        many numbers those took, and the amplitude of an edge: a harmonic has 1 / its order of it.

        Sampled by rows, a harmonic above half a cycle a row is a line at another place of the
        spectrum. Away from those that are fitted it is no error.
        """
        apart, most = 2.0 / len(row), len(row) // 8
        taken, lines = [0.0, *self._place(self.orders, cycles)], []
        for order in range(1, _EDGES + 1):
            place = float(self._place(order, cycles))
            if len(lines) < most and np.min(np.abs(np.array(taken) - place)) > apart:
                taken.append(place)
                lines.append(order)
        if not lines:
            return residual, 0, 0.0
        argument = 2 * np.pi * np.outer(row, lines) * cycles
        waves = np.hstack([np.cos(argument), np.sin(argument)])
        size = np.linalg.lstsq(waves, residual, rcond=None)[0]
        edge = np.sqrt(2 * np.mean((np.array(lines * 2) * size) ** 2))
        return residual - waves @ size, 2 * len(lines), float(edge)

    def fitted_edge(self, base) -> float:
        """Amplitude of an edge as the fitted harmonics have it; base: what is solved for."""
        left, found = base[self.background.shape[1] :], []
        for order, shape in zip(self.orders, self.envelopes, strict=True):
            part, left = left[: shape.shape[1]], left[shape.shape[1] :]
            found.append(order * np.sqrt(np.mean((shape @ part) ** 2)))
        # The last two, an odd one and an even one: nearest to those that are not fitted.
        return float(np.sqrt(np.mean(np.square(found[-2:]))))

    def moved_by_edges(self, influence, row, cycles, edge):
        """Cycles by which unfitted harmonics of edges move the stripes, wherever rows show them;
        one sigma, their phases being unknown."""
        orders = np.setdiff1d(np.arange(1, _EDGES + 1), self.orders)
        waves = np.exp(2j * np.pi * np.outer(row, orders) * cycles)
        return float(edge * np.linalg.norm(np.abs(influence @ waves) / orders) / np.sqrt(2))

    @staticmethod
    def _place(order, cycles):
        """Where rows show a harmonic, cycles a row, 0 to 0.5."""
        return np.abs(order * cycles - np.round(order * cycles))

    def linearised(self, signal, root, row, cycles, phase):
        """Columns (rows, m) of the light at some cycles and phases, and its slopes (rows, 1 + h)
        by the cycles, times half the rows, and by the phases."""
        argument = 2 * np.pi * np.outer(row, self.orders) * cycles + phase
        waves = [shape * np.cos(argument[:, [k]]) for k, shape in enumerate(self.envelopes)]
        base = np.hstack([self.background, *waves])
        linear, *_ = np.linalg.lstsq(base * root[:, None], signal * root, rcond=None)
        ends = np.cumsum([self.background.shape[1], *(one.shape[1] for one in self.envelopes)])
        shapes = [
            shape @ linear[first:last]
            for shape, first, last in zip(self.envelopes, ends[:-1], ends[1:], strict=True)
        ]
        by_phase = -np.stack(shapes, axis=1) * np.sin(argument)
        by_cycles = by_phase @ (2 * np.pi * self.orders) * row * (2.0 / len(row))
        return base, np.hstack([by_cycles[:, None], by_phase])
