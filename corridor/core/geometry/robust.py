"""The usual size of residuals, whatever a few of them do, and which of them are outliers.

An outlier is further from zero than a limit times that size. The limits differ by what becomes of
the residual; they are stated here and nowhere else.

Source: Rousseeuw and Croux 1993 (median absolute deviation, 1.4826 = 1 / 0.6745).
"""

import numpy as np

# Reported: of a million good residuals along an axis one is taken for an outlier, of lengths four.
OUTLIER = 5.0
# Not counted in the RMS that is printed.
GROSS = 15.0
# Not counted where two models, or a model and its replicate, are compared by their residuals.
UNUSABLE = 6.0
# From here on a residual counts as if it lay at the limit: it weighs, but cannot rule.
CLIPPED = 4.0
# A group of measurements whose usual size is so many times the stated one contradicts what is
# stated; small faults of any model reach less.
CONTRADICTING_FACTOR = 2.0

_OF_MEDIAN = 1.4826
_RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))


def robust_scale(
    residuals: np.ndarray, centred: bool = False, axis: int | None = None, least: float = 0.0
) -> float | np.ndarray:
    """Standard deviation of the bulk of residuals: 1.4826 times the median of their size.

    residuals: any shape; NaN do not count. centred: about their median, else about zero.
    axis: along which to look, None for all of them together. least: what it is at the least, and
    where there is no residual at all.
    """
    size = np.asarray(residuals, dtype=float)
    if not size.size:
        return least
    if centred:
        size = size - np.nanmedian(size, axis=axis, keepdims=True)
    return np.maximum(_OF_MEDIAN * np.nanmedian(np.abs(size), axis=axis), least)[()]


def robust_scale_of_lengths(
    lengths: np.ndarray, least: float = 0.0, overwrite: bool = False
) -> float:
    """Standard deviation of a coordinate from lengths of residuals in the plane; NaN do not count.

    Such lengths are Rayleigh distributed: their median is sigma sqrt(2 ln 2). overwrite: lengths
    may be put into another order, which saves as much room as they take.
    """
    lengths = np.asarray(lengths, dtype=float)
    if np.isnan(lengths).all():
        return least
    return max(float(np.nanmedian(lengths, overwrite_input=overwrite) / _RAYLEIGH_MEDIAN), least)


def is_outlier(
    sizes: np.ndarray, scale: float | np.ndarray = 1.0, limit: float = OUTLIER
) -> np.ndarray:
    """Which residuals lie beyond the limit: their sizes (>= 0), the usual one, both in one unit."""
    return np.asarray(sizes) > limit * scale
