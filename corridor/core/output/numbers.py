"""Numbers as a report says them: no digit more than is known."""

import math
import re

import numpy as np

DASH = "\u2013"
# Unit of an effect's file -> factor and unit for people.
_UNITS = {
    "s": (1e3, "ms"),
    "m": (1e3, "mm"),
    "px/s": (600.0, "px per 10 min"),
    "px/s^2": (600.0**2, "px per (10 min)\u00b2"),
    "m/s": (6e5, "mm per 10 min"),
    "px/C": (1.0, "px/\u00b0C"),
    "rad": (math.degrees(3600.0), "arc seconds"),
}
# Without a unit, numbers below this are told in parts per million; coefficients of a lens are not.
_SMALL = 0.01
# From here on metres are told as metres.
_FAR = 10.0
_OF_A_LENS = re.compile(r"[kpb]\d+")


def scaled(unit: str, *values: float | None, name: str = "") -> tuple[float, str]:
    """Factor and unit in which values of a parameter are told; the unit is "" for plain numbers.

    name: of the parameter; k1, p1, b1 and so on are told as every camera model writes them.
    """
    most = max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)
    if unit == "m" and most >= _FAR:
        return 1.0, "m"
    if unit == "1":
        small = most < _SMALL and not _OF_A_LENS.fullmatch(name)
        return (1e6, "ppm") if small else (1.0, "")
    return _UNITS.get(unit, (1.0, unit))


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Value and standard deviation as text, the last digit being the second of the sigma.

    (8187.1432, 2.876) -> ("8187.1", "2.9"). A sigma of zero is a value held fixed; where sigma is
    unknown (NaN) the value has six digits.
    """
    value, sigma = float(value), float(sigma)
    if not math.isfinite(value):
        return DASH, DASH
    if not math.isfinite(sigma):
        return f"{value:.6g}", "unknown"
    if sigma <= 0:
        return f"{value:.6g}", "held"
    power = math.floor(math.log10(float(f"{sigma:.1e}")))
    if power < -7 or power > 6:
        leading = math.floor(math.log10(abs(value))) if value else power
        return f"{value:.{max(leading - power + 1, 1)}e}", f"{sigma:.1e}"
    digits = max(1 - power, 0)
    return _unsigned_zero(f"{value:.{digits}f}"), f"{sigma:.{digits}f}"


def _unsigned_zero(text: str) -> str:
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def fixed(value: float, digits: int) -> str:
    """A number with so many decimals, a dash where it is not finite."""
    value = float(value)
    return _unsigned_zero(f"{value:.{digits}f}") if math.isfinite(value) else DASH


def metre_digits(values) -> int:
    """Decimals for differences in metres: to the millimetre, finer only where all are finer."""
    sizes = np.abs(np.asarray(values, dtype=float))
    sizes = sizes[np.isfinite(sizes)]
    if not len(sizes) or sizes.max() >= 0.001 or sizes.max() == 0:
        return 3
    return int(min(9, 1 - math.floor(math.log10(sizes.max()))))


def millimetres(value: float) -> str:
    """A length in metres as a survey says it: 10 mm, 0.84 mm, 1.51 m."""
    size = abs(value)
    if not math.isfinite(size):
        return DASH
    if size >= 0.9995:
        return f"{value:,.2f} m"
    if size >= 0.00195 or size == 0:
        return f"{1e3 * value:.0f} mm"
    return f"{significant(1e3 * size)} mm"


def nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `value` (1 for zero)."""
    if not (value > 0 and math.isfinite(value)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value) + 1e-12)
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1 + 1e-9))


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number with its noun: 1 image, 1,200 images."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def readable(value: float) -> str:
    """A number as a person writes it: 2,000, 0.05, 12."""
    if value and not 1e-6 <= abs(value) < 1e12:
        return f"{value:.3g}"
    return f"{value:,.10f}".rstrip("0").rstrip(".") or "0"


def short(name: object, most: int = 24) -> str:
    """A name of at most so many letters, the middle left out."""
    text = str(name)
    if len(text) <= most:
        return text
    tail = (most - 1) // 2
    return text[: most - 1 - tail] + "\u2026" + text[len(text) - tail :]


def coefficient(value: float) -> str:
    """Three decimals; more where the coefficient is so near to one that three would hide it."""
    value = float(value)
    if not math.isfinite(value):
        return DASH
    rest = 1 - abs(value)
    digits = 3 if rest >= 0.0005 else min(6, 1 - math.floor(math.log10(max(rest, 1e-6))))
    return _unsigned_zero(f"{value:.{digits}f}")


def significant(value: float) -> str:
    """Two significant digits, as for a standard deviation."""
    value = float(value)
    if not math.isfinite(value) or value <= 0:
        return DASH
    power = math.floor(math.log10(float(f"{value:.1e}")))
    return f"{value:.1e}" if not -6 <= power <= 5 else f"{value:.{max(1 - power, 0)}f}"


def times(ratio: float) -> str:
    """A ratio: to a tenth, or whole where it is large."""
    if not math.isfinite(ratio):
        return DASH
    return f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}"
