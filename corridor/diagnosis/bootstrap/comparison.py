"""What leaves the band, and the gap: one number that has to shrink when an effect is added."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from corridor.core.brief import brief
from corridor.diagnosis.bootstrap.counterparts import Counterparts
from corridor.diagnosis.bootstrap.statistics import Statistic

LEVEL = 0.95
# Spread below which all counterparts are one: rounding.
STILL = 1e-12


@brief
@dataclass(frozen=True, eq=False)
class Compared:
    """One statistic of the measured block beside the band of its counterparts.

    measured, middle: (values,); low, high: the band that holds the whole curve of 95 % of the
    counterparts. z: measured minus middle in standard deviations of the counterparts; limit:
    where the band ends, in the same. excess: sum of squares of what sticks out, no unit; chance:
    (counterparts,) the excess of each among the others.
    """

    statistic: Statistic
    measured: np.ndarray
    middle: np.ndarray
    low: np.ndarray
    high: np.ndarray
    z: np.ndarray
    limit: float
    excess: float
    chance: np.ndarray

    @property
    def leaves(self) -> bool:
        """Whether the measured curve leaves the band anywhere."""
        return bool(np.abs(self.z).max(initial=0.0) > self.limit)

    @property
    def outside(self) -> np.ndarray:
        """(values,) bool: which values are beyond the band."""
        return np.abs(self.z) > self.limit


class Comparison:
    """Every statistic of a measured block beside its band; `print` it for a table.

    count: of counterparts. missing: what could not be formed, and the column to add. unseen:
    effects whose signatures poses, points and the model hide.

    The band is simultaneous: each counterpart's largest distance from the others, over the whole
    curve, is ranked, and the band ends at the distance that one in twenty exceeds. That holds for
    any distribution and any correlation along the curve.
    Source: Vovk, Gammerman and Shafer 2005 (conformal prediction).
    """

    def __init__(self, counterparts: Counterparts):
        self.count = len(counterparts.simulated)
        self.name = counterparts.replicator.system.block.name
        self.missing, self.unseen = counterparts.missing, counterparts.unseen
        self.statistics: list[Compared] = []
        first = 0
        for statistic in counterparts.statistics:
            span = slice(first, first + len(statistic))
            first += len(statistic)
            self.statistics.append(
                _beside(
                    statistic,
                    counterparts.measured[span],
                    counterparts.simulated[:, span],
                    counterparts.absorbed[span],
                )
            )

    def __getitem__(self, name: str) -> Compared:
        return next(one for one in self.statistics if one.statistic.name == name)

    @cached_property
    def leaving(self) -> list[Compared]:
        """The statistics that leave their band, farthest first."""
        return sorted((s for s in self.statistics if s.leaves), key=lambda s: -s.excess)

    @cached_property
    def share(self) -> float:
        """Share of the statistics that leave; one in twenty does where nothing is missing."""
        return len(self.leaving) / max(len(self.statistics), 1)

    @cached_property
    def chance(self) -> float:
        """Median over the counterparts of what sticks out of the bands of the others."""
        return float(np.median(sum((one.chance for one in self.statistics), np.zeros(1))))

    @cached_property
    def gap(self) -> float:
        """Sum of squares of all that sticks out of the bands, in counterparts' deviations.

        Less what sticks out of them by chance, and not below zero.
        """
        return max(float(sum(one.excess for one in self.statistics)) - self.chance, 0.0)

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row a statistic: leaves, farthest (deviations), limit, excess, and where."""
        rows = []
        for one in self.statistics:
            worst = int(np.argmax(np.abs(one.z)))
            rows.append(
                (
                    one.statistic.name,
                    one.statistic.kind,
                    one.leaves,
                    float(one.z[worst]),
                    one.limit,
                    one.excess,
                    place_of(one.statistic, worst),
                )
            )
        columns = ["statistic", "kind", "leaves", "farthest", "limit", "excess", "where"]
        return pd.DataFrame(rows, columns=columns)

    def __str__(self) -> str:
        count = len(self.statistics)
        lines = [
            f"{len(self.leaving)} of {count} statistics leave the 95 % band of "
            f"{self.count} simulated counterparts "
            f"({0.05 * count:.0f} would by chance); gap {self.gap:.3g}"
        ]
        for one in self.leaving[:12]:
            worst = int(np.argmax(np.abs(one.z)))
            lines.append(
                f"  {one.statistic.name}: {one.z[worst]:+.1f} deviations at "
                f"{place_of(one.statistic, worst)}, band {one.limit:.1f}"
            )
        if self.unseen:
            lines.append(f"  hidden by poses, points and the model: {', '.join(self.unseen)}")
        lines += [f"  not formed: {what} (add {column})" for what, column in self.missing.items()]
        return "\n".join(lines)


@brief
@dataclass(frozen=True, eq=False)
class Closing:
    """The gap before an effect is added to the model, and after."""

    before: Comparison
    after: Comparison

    @property
    def closed(self) -> float:
        """Share of the gap that is gone; 0 where there was none."""
        if self.before.gap == 0:
            return 0.0
        return 1.0 - self.after.gap / self.before.gap

    @property
    def table(self) -> pd.DataFrame:
        """A row a statistic of either: excess and whether it leaves, before and after."""
        columns = ["statistic", "kind", "leaves", "excess"]
        return self.before.table[columns].merge(
            self.after.table[columns],
            on=["statistic", "kind"],
            how="outer",
            sort=False,
            suffixes=("_before", "_after"),
        )

    def __str__(self) -> str:
        before, after = self.before, self.after
        return (
            f"{len(before.leaving)} of {len(before.statistics)} statistics leave the band before, "
            f"{len(after.leaving)} of {len(after.statistics)} after; "
            f"the gap falls from {before.gap:.3g} to {after.gap:.3g}"
        )


def compare(counterparts: Counterparts) -> Comparison:
    """The measured block beside the bands of its counterparts."""
    return Comparison(counterparts)


def place_of(statistic: Statistic, number: int) -> str:
    """In words where on its axis a value of a statistic lies."""
    if statistic.labels:
        return f"{statistic.axis} {statistic.labels[number]}".strip()
    at = statistic.at[number]
    if statistic.at.ndim == 2:
        return f"{statistic.axis} {at[0]:.0f}, {at[1]:.0f}"
    return f"{statistic.axis} {at:.4g}"


def _beside(statistic, measured, simulated, absorbed) -> Compared:
    n = len(simulated)
    middle = simulated.mean(axis=0)
    # A new value misses the mean of n others by a little more than one of them.
    spread = simulated.std(axis=0, ddof=1) * np.sqrt(1 + 1 / n)
    still = absorbed | (spread <= STILL * np.maximum(np.abs(middle), 1e-6))
    spread = np.where(still, np.inf, spread)
    z = (measured - middle) / spread
    apart = _apart(simulated[:, ~still])
    farthest = np.sort(apart.max(axis=1, initial=0.0))
    limit = float(farthest[min(int(np.ceil(LEVEL * (n + 1))), n) - 1]) if apart.size else np.inf
    width = np.where(still, 0.0, limit * spread)
    beyond = np.maximum(np.abs(z) - limit, 0.0)
    # What no draw has below zero is a size: its band begins at zero at the least.
    least = 0.0 if min(simulated.min(initial=0.0), measured.min(initial=0.0)) >= 0 else -np.inf
    chance = np.maximum(apart - limit, 0.0) if apart.size else np.zeros((n, 1))
    return Compared(
        statistic,
        measured,
        middle,
        np.maximum(middle - width, least),
        middle + width,
        z,
        limit,
        float(np.sum(beyond**2)),
        np.sum(chance**2, axis=1),
    )


def _apart(values: np.ndarray) -> np.ndarray:
    """Distance (n, k) of each counterpart from the others, in their standard deviations."""
    n = len(values)
    mean = (values.sum(axis=0) - values) / (n - 1)
    square = (values - values.mean(axis=0)) ** 2
    # Variance without one: from the sum of squares about the mean of all.
    variance = (square.sum(axis=0) - square * n / (n - 1)) / (n - 2)
    spread = np.sqrt(np.maximum(variance, 1e-300) * (1 + 1 / (n - 1)))
    return np.abs((values - mean) / spread)
