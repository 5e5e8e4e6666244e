"""Statistics of control and check points."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from corridor.diagnosis.statistics.bins import Curve, corridor_frame
from corridor.diagnosis.statistics.statistic import Statistic
from corridor.diagnosis.statistics.ties import MANY_POINTS, PLACES

if TYPE_CHECKING:
    from corridor.diagnosis.statistics.ruler import Ruler


def add_ground(ruler: Ruler, kind: str, rows: np.ndarray, name: str, of: Callable) -> None:
    """Residuals `of` a fit at ground points (rows of ground.csv); kind: `control` or `check`."""
    ground = ruler.believed.system.block.ground
    names = tuple(map(str, ground["point"].iloc[rows]))
    if len(rows) <= MANY_POINTS:
        for k, axis in enumerate("xyz"):
            ruler.add(
                Statistic(
                    f"{name} {axis} by point", kind, "m", f"{name} point",
                    np.arange(len(rows), dtype=float), names,
                ),
                lambda seen, k=k: of(seen)[:, k],
            )  # fmt: skip
    else:
        origin, axes = corridor_frame(ruler.images.centre)
        at = (ground[["x", "y"]].to_numpy(float)[rows] - origin) @ axes[0]
        curve = Curve.even(at, PLACES, np.ones(len(rows)), 3)
        for k, axis in enumerate("xyz"):
            ruler.add(
                curve.statistic(
                    f"{name} {axis} along the corridor", kind, "m", "along the corridor (m)"
                ),
                lambda seen, k=k: curve.mean(of(seen)[:, k]),
            )
    if kind == "check":
        ruler.add(
            Statistic("check-point error, RMS", kind, "m", "axis", np.arange(3.0), tuple("xyz")),
            lambda seen: np.sqrt(np.mean(of(seen) ** 2, axis=0)),
        )
