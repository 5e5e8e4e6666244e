"""One statistic, the fit that it is formed of, and the bins and cells in which it is formed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np


@dataclass
class Fit:
    """One adjustment: its state and residuals, measured minus modelled, in the problem's order.

    pixels (n, 2) px, gnss (k, 3) m, control (c, 3) m; check (c, 3): adjusted minus given, m;
    posed (a, 3): of `system.posed`; distance (b, 1): of `system.distance`.
    """

    state: object
    pixels: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    check: np.ndarray
    posed: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    distance: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))


@dataclass(frozen=True, eq=False)
class Statistic:
    """One curve or map.

    name: what it is. kind: `tie`, `held_out`, `mark`, `gnss`, `control`, `check` or `signature`.
    axis: what it is drawn over, with unit. at: (values,) or, on a map, (values, 2). labels: names
    of the values where they are not numbers. shape: columns and rows of a map, and cells: which
    of them, row by row, the values are of.
    """

    name: str
    kind: str
    unit: str
    axis: str
    at: np.ndarray
    labels: tuple[str, ...] = ()
    shape: tuple[int, int] | None = None
    cells: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.at)


class Form(NamedTuple):
    """A statistic, and how its values (values,) are formed of residuals (see `residuals`)."""

    statistic: Statistic
    of: Callable[[Any], np.ndarray]


def named(name: str, kind: str, unit: str, axis: str, labels) -> Statistic:
    """A statistic whose values have names and no places."""
    return Statistic(name, kind, unit, axis, np.arange(len(labels), dtype=float), tuple(labels))


# Observations that a bin must have.
FEWEST = 30
SECTORS = 8
COMPASS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")


class Curve:
    """Bins along one axis. code: (n,) bin of each row, -1 for none; at: (bins,)."""

    def __init__(self, code, at, weight, labels=()):
        inside = code >= 0
        # All rows in order is the usual case and needs no copies.
        self.rows = slice(None) if inside.all() else np.flatnonzero(inside)
        self.code, self.at, self.labels = code[self.rows], at, tuple(labels)
        self.weight = weight[self.rows]
        self.total = np.bincount(self.code, self.weight, len(at))

    @classmethod
    def of(cls, code, values, weight, least=FEWEST, labels=()):
        """Bins with at least so many rows, each at the mean of its values."""
        number, full, count = _kept(np.where(np.isfinite(values), code, -1), least)
        inside = number >= 0
        at = np.bincount(number[inside], values[inside], len(full)) / count
        return cls(number, at, weight, tuple(labels[k] for k in full) if labels else ())

    @classmethod
    def even(cls, values, bins, weight, least=FEWEST):
        """Bins of one width, between the first and the last per cent."""
        low, high = np.nanpercentile(values, [1, 99])
        share = (np.nan_to_num(values, nan=low) - low) / max(high - low, 1e-12)
        code = np.clip((share * bins).astype(int), 0, bins - 1)
        return cls.of(code, values, weight, least)

    @classmethod
    def equal(cls, values, bins, weight, least=FEWEST):
        """Bins of one count; few different values are bins of their own."""
        known = np.isfinite(values)
        different = np.unique(values[known])
        if len(different) <= bins:
            code = np.searchsorted(different, np.nan_to_num(values))
            return cls.of(np.minimum(code, len(different) - 1), values, weight, least)
        edges = np.unique(np.quantile(values[known], np.linspace(0, 1, bins + 1)[1:-1]))
        return cls.of(np.searchsorted(edges, values), values, weight, least)

    @classmethod
    def codes(cls, code, weight, labels, least=FEWEST):
        """One bin for each name."""
        return cls.of(code.astype(int), code, weight, least, labels)

    @classmethod
    def sectors(cls, velocity, moving, image, weight, least=FEWEST):
        """Eight directions of the velocity of each row's image, from east anticlockwise."""
        angle = np.arctan2(velocity[:, 1], velocity[:, 0])
        sector = np.where(moving, np.round(np.nan_to_num(angle) / (np.pi / 4)) % SECTORS, np.nan)
        code = np.nan_to_num(sector[image]).astype(int)
        return cls.of(code, sector[image], weight, least, COMPASS)

    def mean(self, values):
        """Weighted mean of each bin."""
        mine = self.weight * values[self.rows]
        return np.bincount(self.code, mine, len(self.at)) / self.total

    def size(self, squares):
        """Root of the weighted mean square of each bin."""
        return np.sqrt(self.mean(squares))

    def ratio(self, numerator, denominator):
        """Sum over sum of each bin."""
        sums = [
            np.bincount(self.code, v[self.rows], len(self.at)) for v in (numerator, denominator)
        ]
        return sums[0] / np.maximum(sums[1], 1e-12)

    def statistic(self, name, kind, unit, axis) -> Statistic:
        """What the values of this curve are."""
        return Statistic(name, kind, unit, axis, self.at, self.labels)


class Grid(Curve):
    """Cells of a map. share: (n, 2) in 0..1; size: what 1 means; shape: columns, rows."""

    def __init__(self, share, shape, weight, size, least=FEWEST, origin=(0.0, 0.0)):
        cell = np.clip((share * shape).astype(int), 0, np.array(shape) - 1)
        code = cell[:, 1] * shape[0] + cell[:, 0]
        number, full, _ = _kept(code, least)
        middle = np.column_stack([full % shape[0] + 0.5, full // shape[0] + 0.5]) / shape
        super().__init__(number, middle * size + np.asarray(origin), weight)
        self.shape, self.cells = tuple(shape), full

    @classmethod
    def of_places(cls, place, weight):
        """Cells on the ground along and across the corridor, about as long as wide."""
        low, high = np.percentile(place, [1, 99], axis=0)
        span = np.maximum(high - low, 1e-6)
        side = max(span[0] / 16, np.sqrt(np.prod(span) / 60))
        shape = tuple(int(n) for n in np.clip(np.round(span / side), 1, 40))
        return cls((place - low) / span, shape, weight, span, origin=low)

    def statistic(self, name, kind, unit, axis) -> Statistic:
        """What the values of this map are."""
        return Statistic(name, kind, unit, axis, self.at, (), self.shape, self.cells)


def _kept(code, least):
    """Codes (n,) numbered anew, -1 outside bins of `least` rows; which are kept, and their rows."""
    count = np.bincount(code[code >= 0], minlength=code.max(initial=-1) + 1)
    full = np.flatnonzero(count >= least)
    renumber = np.full(len(count) + 1, -1)
    renumber[full] = np.arange(len(full))
    return renumber[code], full, count[full]


def corridor_frame(centre: np.ndarray):
    """Origin (2,) and axes (2, 2), along and across, of the line of the camera centres."""
    middle = centre[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(centre[:, :2] - middle, full_matrices=False)
    first = axes[0] if axes[0][np.argmax(np.abs(axes[0]))] > 0 else -axes[0]
    frame = np.array([first, [-first[1], first[0]]])
    return middle + ((centre[:, :2] - middle) @ first).min() * first, frame
