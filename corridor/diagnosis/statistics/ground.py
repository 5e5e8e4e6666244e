"""Statistics of control and check points."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from corridor.diagnosis.statistics.bins import Curve, corridor_frame
from corridor.diagnosis.statistics.statistic import Form, named
from corridor.diagnosis.statistics.ties import MANY_POINTS, PLACES


def ground_forms(system, kind: str, rows: np.ndarray, of: Callable) -> Iterator[Form]:
    """Residuals `of` a fit at ground points (rows of ground.csv); kind: `control` or `check`."""
    ground = system.block.ground
    names = tuple(map(str, ground["point"].iloc[rows]))
    if len(rows) <= MANY_POINTS:
        for k, axis in enumerate("xyz"):
            statistic = named(f"{kind} {axis} by point", kind, "m", f"{kind} point", names)
            yield Form(statistic, lambda r, k=k: of(r)[:, k])
    else:
        origin, axes = corridor_frame(system.images.centre)
        at = (ground[["x", "y"]].to_numpy(float)[rows] - origin) @ axes[0]
        curve = Curve.even(at, PLACES, np.ones(len(rows)), 3)
        what = "along the corridor (m)"
        for k, axis in enumerate("xyz"):
            statistic = curve.statistic(f"{kind} {axis} along the corridor", kind, "m", what)
            yield Form(statistic, lambda r, k=k: curve.mean(of(r)[:, k]))
    if kind == "check":
        yield Form(
            named("check-point error, RMS", kind, "m", "axis", tuple("xyz")),
            lambda r: np.sqrt(np.mean(of(r) ** 2, axis=0)),
        )
