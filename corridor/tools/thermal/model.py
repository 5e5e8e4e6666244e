"""How far heat moves an image point: a polynomial in the picture and in temperature.

    X = (x - x0) / scale_px, Y alike, t = (T - t0) / scale_c
    dx = sum over m >= 1, i, j of a[m, i, j] t^m X^i Y^j px, dy alike

Whatever kind was fitted (similarity, radial, decentring, full polynomial) is written so. The model
is zero at t0, the temperature of the reference.
Source: Zhou 2019, eq. 6.2 and 6.3; printed with i, j from 1, which can hold no shift and no scale.
"""

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.polynomial import polynomial

from corridor.core.brief import brief
from corridor.core.errors import InputError
from corridor.core.options import options
from corridor.core.output import whole_file
from corridor.tools.thermal.shapes import terms_of

KINDS = ("similarity", "radial", "decentring", "polynomial")
_ROUNDS = 60
# What a MODEL.json holds; what else is in it is kept.
_NEEDED = ("kind", "width", "height", "t0_c", "range_c", "normalisation", "coefficients")
_NUMBERS = ("residual_px", "misfit_px", "lag_s", "lag_sigma_s")
_ARRAYS = ("terms", "covariance", "beyond_px_c")
_OPTIONAL = (*_NUMBERS, *_ARRAYS, "warnings")


@brief
@dataclass(frozen=True, eq=False)
class ThermalModel:
    """A thermal model of one camera.

    kind: one of `KINDS`. width, height: px of its pictures. t0_c: where it is zero, C.
    range_c: temperatures of the optics that it was fitted to, C.
    middle: x0, y0, px. scale_px, scale_c: units of X, Y and t.
    dx, dy: coefficients (powers, columns, rows), px.
    residual_px: what the model leaves of a measured deformation, RMS an axis, noise included.
    misfit_px: the share of it that is not noise.
    lag_s, lag_sigma_s: the optics follow the thermometer through a first-order lag; None: unknown.
    terms: (k, 2, columns, rows) spatial shapes whose amplitudes were fitted, covariance
        (powers * k, powers * k) px^2 of the amplitudes, power by power; None: not known.
    beyond_px_c: (2, 2, columns, rows), below and above the range: px a degree by which models
        that fit almost as well part from this one.
    """

    kind: str
    width: int
    height: int
    t0_c: float
    range_c: tuple[float, float]
    dx: np.ndarray
    dy: np.ndarray
    middle: tuple[float, float]
    scale_px: float
    scale_c: float = 10.0
    residual_px: float = 0.0
    misfit_px: float = 0.0
    lag_s: float | None = None
    lag_sigma_s: float | None = None
    warnings: tuple[str, ...] = ()
    terms: np.ndarray | None = field(default=None, repr=False)
    covariance: np.ndarray | None = field(default=None, repr=False)
    beyond_px_c: np.ndarray | None = field(default=None, repr=False)
    extra: Mapping = field(default_factory=dict, repr=False)

    def displacement(self, x, y, temperature_c) -> tuple[np.ndarray, np.ndarray]:
        """Shift dx, dy, px, of points seen at x, y (px) at t0, once the optics are so warm.

        The three arguments are broadcast against each other.
        """
        X, Y, t = self._normalised(x, y, temperature_c)
        return _sum(self.dx, X, Y, t), _sum(self.dy, X, Y, t)

    def undo(self, x, y, temperature_c) -> tuple[np.ndarray, np.ndarray]:
        """Shift dx, dy, px, that leads points seen at x, y at a temperature back to t0.

        Raises InputError where the model folds the picture, so that there is no way back.
        """
        x, y, temperature_c = np.broadcast_arrays(
            np.asarray(x, float), np.asarray(y, float), np.asarray(temperature_c, float)
        )
        back_x, back_y = np.zeros(x.shape), np.zeros(x.shape)
        for _ in range(_ROUNDS):
            dx, dy = self.displacement(x + back_x, y + back_y, temperature_c)
            step = max(
                np.max(np.abs(dx + back_x), initial=0.0), np.max(np.abs(dy + back_y), initial=0.0)
            )
            back_x, back_y = -dx, -dy
            if step < 1e-11:
                return back_x, back_y
        raise InputError(
            "the thermal model cannot be inverted there: points or temperatures are far outside "
            f"what it was fitted to ({self.range_c[0]:.1f} to {self.range_c[1]:.1f} C)"
        )

    def sigma(self, x, y, temperature_c) -> np.ndarray:
        """Standard deviation of the predicted shift, px an axis, lack of fit included.

        Outside `range_c` it grows with the distance.
        """
        X, Y, t = self._normalised(x, y, temperature_c)
        X, Y, t = np.broadcast_arrays(X, Y, t)
        variance = np.full(X.shape, self.misfit_px**2)
        if self.terms is not None and self.covariance is not None:
            powers = len(self.dx)
            shapes = np.stack(
                [[_sum(one[None], X, Y, 1.0) for one in term] for term in self.terms], axis=-1
            )  # (2, ..., k)
            full = np.concatenate([shapes * (t**m)[..., None] for m in range(1, powers + 1)], -1)
            each = np.einsum("a...i,ij,a...j->a...", full, self.covariance, full)
            variance = variance + np.maximum(each, 0.0).mean(axis=0)
        below = np.maximum(self.range_c[0] - self.t0_c - t * self.scale_c, 0.0)
        above = np.maximum(t * self.scale_c + self.t0_c - self.range_c[1], 0.0)
        span = max(self.range_c[1] - self.range_c[0], 1e-9)
        least = max(self.residual_px, self.misfit_px) / span
        for k, away in enumerate((below, above)):
            slope = least**2
            if self.beyond_px_c is not None:
                parting = [_sum(one[None], X, Y, 1.0) for one in self.beyond_px_c[k]]
                slope = slope + np.mean(np.square(parting), axis=0)
            variance = variance + slope * away**2
        return np.sqrt(variance)

    def outside(self, temperature_c) -> np.ndarray:
        """Where a temperature, C, lies outside the range that the model was fitted to."""
        # A temperature written with three decimals is not outside for its rounding.
        low, high = self.range_c
        return (np.asarray(temperature_c) < low - 1e-3) | (np.asarray(temperature_c) > high + 1e-3)

    def concern(self, temperatures_c) -> str | None:
        """One sentence if any temperature lies outside the range."""
        values = np.asarray(temperatures_c, dtype=float).ravel()
        out = self.outside(values)
        if not out.any():
            return None
        return (
            f"{np.count_nonzero(out)} of {out.size} temperatures ({values[out].min():.1f} to "
            f"{values[out].max():.1f} C) are outside the {self.range_c[0]:.1f} to "
            f"{self.range_c[1]:.1f} C that the model was fitted to: it is extrapolated there and "
            "its sigma grows"
        )

    def parameters(self, temperature_c) -> dict[str, np.ndarray]:
        """Eq. 6.2 of Zhou 2019 at temperatures (n,): the similarity nearest to the model.

        shift_x, shift_y: px, of the picture's middle; scale: parts per million; rotation:
        microradians, from x to y.
        """
        x, y = (v.ravel() for v in np.meshgrid(
            np.linspace(0, self.width - 1, 33), np.linspace(0, self.height - 1, 25)
        ))  # fmt: skip
        warm = np.atleast_1d(np.asarray(temperature_c, dtype=float))
        dx, dy = self.displacement(x, y, warm[:, None])
        X, Y, _ = self._normalised(x, y, 0.0)
        X, Y = X - X.mean(), Y - Y.mean()
        across = np.sum(X**2 + Y**2) * self.scale_px / 1e6
        return {
            "shift_x": dx.mean(axis=1),
            "shift_y": dy.mean(axis=1),
            "scale": (dx @ X + dy @ Y) / across,
            "rotation": (dy @ X - dx @ Y) / across,
        }

    def _normalised(self, x, y, temperature_c):
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        return (
            (x - self.middle[0]) / self.scale_px,
            (y - self.middle[1]) / self.scale_px,
            (np.asarray(temperature_c, dtype=float) - self.t0_c) / self.scale_c,
        )

    # --- files ---------------------------------------------------------------------------

    def to_dict(self) -> dict:
        """The content of MODEL.json."""

        def these(*names):
            values = ((name, getattr(self, name)) for name in names)
            listed = tuple | np.ndarray
            return {n: np.array(v).tolist() if isinstance(v, listed) else v for n, v in values}

        return {
            **these("kind", "width", "height", "t0_c", "range_c"),
            "normalisation": {
                "x0": self.middle[0],
                "y0": self.middle[1],
                "scale_px": self.scale_px,
                "scale_c": self.scale_c,
            },
            "coefficients": these("dx", "dy"),
            **these(*_NUMBERS, "warnings"),
            **self.extra,
            **these(*_ARRAYS),
        }

    def write(self, path: str | os.PathLike) -> None:
        """Write MODEL.json, whole or not at all."""
        text = json.dumps(self.to_dict(), allow_nan=False, ensure_ascii=False)
        # One key a line: a person finds the numbers, and the file stays small.
        text = text.replace(', "', ',\n "')
        with whole_file(path) as part:
            part.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_model(path: str | os.PathLike) -> ThermalModel:
    """The thermal model of a MODEL.json.

    Raises InputError, one sentence, where the file is missing or is not such a model.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give a model") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON ({error}): give a thermal model") from error
    if not isinstance(content, dict):
        raise InputError(f"{path} is not a thermal model: it holds no table")
    missing = [key for key in _NEEDED if key not in content]
    if missing:
        raise InputError(
            f"{path} is not a thermal model, it has no {missing[0]}: give one that "
            "`corridor thermal fit` wrote"
        )
    try:
        model = _model(content)
        _check(model)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise InputError(
            f"{path} is not a valid thermal model ({error}): write it anew with "
            "`corridor thermal fit`"
        ) from error
    return model


def _model(content: dict) -> ThermalModel:
    """The model that `ThermalModel.to_dict` made the content of."""
    unit = content["normalisation"]
    given = {key: value for key, value in content.items() if value is not None}
    numbers = {key: float(given[key]) for key in _NUMBERS if key in given}
    numbers.setdefault("misfit_px", numbers.get("residual_px", 0.0))
    arrays = {key: np.array(given[key], dtype=float) for key in _ARRAYS if key in given}
    dx, dy = (np.array(content["coefficients"][key], dtype=float) for key in ("dx", "dy"))
    low, high = (float(v) for v in content["range_c"])
    return ThermalModel(
        kind=content["kind"], width=int(content["width"]), height=int(content["height"]),
        t0_c=float(content["t0_c"]), range_c=(low, high), dx=dx, dy=dy,
        middle=(float(unit["x0"]), float(unit["y0"])), scale_px=float(unit["scale_px"]),
        scale_c=float(unit["scale_c"]), **numbers, **arrays,
        warnings=tuple(str(w) for w in content.get("warnings", ())),
        extra={k: v for k, v in content.items() if k not in (*_NEEDED, *_OPTIONAL)},
    )  # fmt: skip


def _check(model: ThermalModel) -> None:
    """Raises ValueError where the numbers of a model make no sense."""
    dx, dy, (low, high) = model.dx, model.dy, model.range_c
    if dx.ndim != 3 or dy.ndim != 3 or dx.shape[0] != dy.shape[0]:
        raise ValueError("coefficients are not [power][column][row]")
    numbers = [low, high, model.t0_c, *model.middle, model.scale_px, model.scale_c]
    if not np.isfinite([*numbers, *dx.ravel(), *dy.ravel()]).all():
        raise ValueError("a number is not finite")
    if not (model.scale_px > 0 and model.scale_c > 0 and low <= high):
        raise ValueError("a scale is not positive, or range_c is upside down")
    if model.kind not in KINDS:
        raise ValueError(f"kind {model.kind!r} is not one of {', '.join(KINDS)}")
    if model.lag_s is not None and not (math.isfinite(model.lag_s) and model.lag_s >= 0):
        raise ValueError(f"lag_s = {model.lag_s:g} is negative")
    if model.terms is not None and model.covariance is not None:
        wanted = (len(model.terms) * len(dx),) * 2
        if model.terms.ndim != 4 or model.covariance.shape != wanted:
            raise ValueError(f"covariance has the shape {model.covariance.shape}, not {wanted}")


def _sum(coefficients: np.ndarray, X, Y, t):
    """sum a[m, i, j] t^(m+1) X^i Y^j; t = 1 for a purely spatial shape."""
    layers = [polynomial.polyval2d(X, Y, layer) for layer in coefficients]
    return t * polynomial.polyval(t, np.array(layers), tensor=False)


@dataclass(frozen=True)
class Slopes:
    """What a picture does with temperature; each a tuple of powers of T - t0.

    scale: share by which it grows, 1/C (13.7e-6: what Zhou 2019 found of f), then 1/C^2. radial:
    px/C at the corner that grow with the cube of the radius. decentring: px/C at the right edge.
    shift: x, y px/C of the whole picture. rotation: radians/C from x to y.
    """

    scale: tuple[float, ...] = (13.7e-6,)
    radial: tuple[float, ...] = ()
    decentring: tuple[float, ...] = ()
    shift: tuple[tuple[float, float], ...] = ()
    rotation: tuple[float, ...] = ()

    @property
    def kind(self) -> str:
        """Of the simplest model that has them."""
        return "decentring" if self.decentring else "radial" if self.radial else "similarity"

    def amplitudes(self, width: int, height: int) -> np.ndarray:
        """Of the terms of `decentring` (powers, 7), px for each power of ten degrees."""
        unit, half = math.hypot(width, height) / 2, (width - 1) / math.hypot(width, height)
        out = np.zeros((max(1, *(len(part) for part in vars(self).values())), 7))
        out[: len(self.shift), :2] = np.reshape(self.shift, (-1, 2))
        out[: len(self.scale), 2] = np.multiply(self.scale, unit)
        out[: len(self.rotation), 3] = np.multiply(self.rotation, unit)
        out[: len(self.radial), 4] = self.radial
        out[: len(self.decentring), 5] = np.divide(self.decentring, 3 * half**2)
        return out * 10.0 ** np.arange(1, len(out) + 1)[:, None]


@options(slopes=Slopes)
def simple_model(
    width: int,
    height: int,
    t0_c: float = 24.0,
    range_c: tuple[float, float] = (24.0, 50.0),
    *,
    slopes: Slopes,
) -> ThermalModel:
    """A thermal model from numbers a person knows.

    scale, radial, decentring, shift, rotation: see `Slopes`; slopes: one in their place.
    """
    terms = terms_of("decentring").reshape(7, 2, 4, 4)
    dx, dy = np.einsum("mk,kxij->xmij", slopes.amplitudes(width, height), terms)
    return ThermalModel(
        kind=slopes.kind,
        width=width, height=height, t0_c=t0_c, range_c=tuple(range_c), dx=dx, dy=dy,
        middle=((width - 1) / 2, (height - 1) / 2), scale_px=math.hypot(width, height) / 2,
    )  # fmt: skip
