"""One statistic, and the fit that it is formed of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np


@dataclass
class Fit:
    """One adjustment: its state and residuals, measured minus modelled, in the problem's order.

    pixels (n, 2) px, gnss (k, 3) m, control (c, 3) m; check (c, 3): adjusted minus given, m.
    """

    state: object
    pixels: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    check: np.ndarray


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
