"""RMS, mean and standard deviation of check-point differences.

Source: Zhou 2019, tables 4.2, 4.3, 5.3 and 7.4 to 7.15.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd


class Parts(NamedTuple):
    """One statistic in planimetry, altimetry and space, metres."""

    xy: float
    z: float
    d3: float


class CheckStatistics(NamedTuple):
    """RMS, mean and STD of check-point differences, each a Parts."""

    rms: Parts
    mean: Parts
    std: Parts


def check_table(differences: np.ndarray) -> CheckStatistics:
    """RMS, mean and STD of check-point differences, as the tables of Zhou 2019 have them.

    differences: (n, 3), adjusted minus given, metres; rows with NaN do not count.

    xy and 3D are statistics of the *lengths* sqrt(dx^2 + dy^2) and sqrt(dx^2 + dy^2 + dz^2), z of
    the signed dz. RMS is about zero, STD unbiased about the mean (NaN for fewer than two points).
    The mean in xy and 3D is therefore a mean length and never negative; it is not the length of the
    mean vector. Zhou 2019 does not write this definition down; its figures leave no other: in
    table 4.3 (translation, case a) the STD are 0.62 (xy), 2.50 (z) and 1.51 cm (3D), and 3D could
    not be below z if it were summed over components; in tables 7.4 to 7.7 only z has negative
    means, and RMS^2 = mean^2 + (n - 1)/n STD^2 holds within the rounding for all three.
    """
    differences = np.asarray(differences, dtype=float).reshape(-1, 3)
    differences = differences[np.isfinite(differences).all(1)]
    if len(differences) == 0:
        nothing = Parts(np.nan, np.nan, np.nan)
        return CheckStatistics(nothing, nothing, nothing)
    x, y, z = differences.T
    values = np.column_stack([np.hypot(x, y), z, np.linalg.norm(differences, axis=1)])
    rms = np.sqrt(np.mean(values**2, axis=0))
    mean = values.mean(axis=0)
    std = values.std(axis=0, ddof=1) if len(values) > 1 else np.full(3, np.nan)
    return CheckStatistics(*(Parts(*map(float, row)) for row in (rms, mean, std)))


class Checked:
    """Statistics of `check_points`, a table with dx, dy, dz (adjusted minus given, metres)."""

    check_points: pd.DataFrame

    @cached_property
    def check_statistics(self) -> CheckStatistics:
        """RMS, mean and STD of the check points together; see `check_table`."""
        return check_table(self.check_points[["dx", "dy", "dz"]].to_numpy(float))

    @property
    def check_rms(self) -> Parts:
        """RMS about zero of the check points: xy, z, d3, metres."""
        return self.check_statistics.rms

    @property
    def check_mean(self) -> Parts:
        """Mean of the check points: xy, z, d3, metres."""
        return self.check_statistics.mean

    @property
    def check_std(self) -> Parts:
        """Unbiased standard deviation of the check points about their mean: xy, z, d3, metres."""
        return self.check_statistics.std
