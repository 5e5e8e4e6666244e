"""Numbers as a report says them: no digit more than is known."""

import math

import numpy as np

DASH = "\u2013"


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
    if not len(sizes) or sizes.max() >= 0.01 or sizes.max() == 0:
        return 3
    return int(min(9, 2 - math.floor(math.log10(sizes.max()))))


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
