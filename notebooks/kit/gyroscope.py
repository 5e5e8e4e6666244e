"""A readout time from a strip with a gyroscope, with what the focal length leaves uncertain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Adjustment, Model, Run, refit
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.errors import AdjustmentFailed, InputError

# Relative step of the focal length by which its influence is found.
_STEP = 0.01
_ANYWHERE_M = 1e4


@brief
@dataclass
class GyroscopeReadout:
    """Parameters of an effect of motion from a flight.

    adjustment: with the camera as stated. value, formal: by parameter, and their standard
    deviations there. by_focal: change of each for one sigma of the focal length; sigma: both
    together. focal_sigma: relative. median_px: median length of the tie residuals.
    """

    adjustment: Adjustment
    value: dict[str, float]
    formal: dict[str, float]
    by_focal: dict[str, float]
    focal_sigma: float

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each parameter, the focal length's part included."""
        return {k: float(np.hypot(self.formal[k], self.by_focal[k])) for k in self.value}

    @property
    def median_px(self) -> float:
        """Median length of the tie residuals, px."""
        return median_residual(self.adjustment)

    def __str__(self) -> str:
        lines = [
            f"{name}: {1000 * self.value[name]:.2f} +- {1000 * self.sigma[name]:.2f} ms "
            f"({1000 * self.formal[name]:.2f} of it from the measurements, "
            f"{1000 * abs(self.by_focal[name]):.2f} from {100 * self.focal_sigma:g} % of f)"
            for name in self.value
        ]
        return "\n".join([*lines, f"median tie residual {self.median_px:.2f} px"])


def readout_from_gyroscope(
    block: Block, effect: str, focal_sigma: float = 0.03, loss: str = "huber:4"
) -> GyroscopeReadout:
    """Readout (and delay) that a flight's own pictures show, with a sigma that carries f.

    block: one camera; its calibration is held. effect: slug of an effect of motion whose
    parameters are seconds, shared by the block. focal_sigma: what the stated focal length may be
    off by, relative. A short strip over flat ground cannot tell its focal length, and estimated
    freely f takes up what the model lacks: it is varied by its sigma instead, as one would a
    constant of known uncertainty (a consider parameter).
    Raises InputError for several cameras, AdjustmentFailed where the pictures do not fit.
    """
    if len(block.cameras) != 1:
        raise InputError("the readout from a flight is that of one camera: select its images")
    (name, camera), *_ = block.cameras.items()
    options = {"effects": [effect], "loss": loss, "lever_arm": "fixed", "max_iterations": 200}
    middle = least_squares.adjust(block, camera="fixed", **options)
    ends = []
    for sign in (-1, 1):
        other = middle.block.copy()
        other.cameras[name] = camera.with_values(f=camera["f"] * (1 + sign * _STEP))
        ends.append(_values(least_squares.adjust(other, camera="fixed", **options)))
    value = _values(middle)
    table = middle.effects.set_index("parameter")["sigma"]
    return GyroscopeReadout(
        adjustment=middle,
        value=value,
        formal={k: float(table[k]) for k in value},
        by_focal={k: (ends[1][k] - ends[0][k]) / 2 * focal_sigma / _STEP for k in value},
        focal_sigma=focal_sigma,
    )


def _values(adjustment: Adjustment) -> dict[str, float]:
    table = adjustment.effects
    if len(table) != table["parameter"].nunique():
        raise InputError(
            f"effect {table['slug'].iloc[0]} has values of its own for each {len(table)} groups: "
            "a flight tells of a readout that the block shares"
        )
    return dict(zip(table["parameter"], table["value"].tolist(), strict=True))


def median_residual(adjustment: Adjustment) -> float:
    """Median length of the tie residuals of an adjustment, px."""
    ties = adjustment.residuals["tie"]
    return float(np.median(np.hypot(ties["vx"], ties["vy"])))


def level_ground(block: Block, height_m: float, sigma_m: float, points: int = 60) -> Block:
    """An adjusted block with the heights of some tie points given as control, good to sigma_m.

    What is known of fields without any survey: they are level. It holds the roll of a single
    strip, which positions on a line leave free. points: how many of those that three images show.
    Raises InputError where the block has no coordinates of them.
    """
    ties = block.tie_points
    rays = ties["point"].cat.codes.value_counts()
    fit = np.sort(rays.index[rays >= 3])
    names = ties["point"].cat.categories[fit[:: max(1, len(fit) // points)]].astype(str)
    mine = ties["point"].isin(names).to_numpy()
    marks = ties[mine].assign(
        point=ties["point"][mine].astype(str), image=ties["image"][mine].astype(str)
    )
    marks["sigma"] = block.tie_sigma()[mine]
    rest = ties[~mine].reset_index(drop=True)
    rest["point"] = rest["point"].cat.remove_unused_categories()
    known = block.points.set_index("point").reindex(names)
    if known[["x", "y", "z"]].isna().any(axis=None):
        raise InputError("points.csv lacks tie points of three images: run `corridor adjust` first")
    ground = pd.DataFrame(
        {
            "point": names,
            "x": known["x"].to_numpy(),
            "y": known["y"].to_numpy(),
            "z": height_m,
            # Nothing is said about where they are in plan.
            "sx": _ANYWHERE_M,
            "sy": _ANYWHERE_M,
            "sz": sigma_m,
            "role": "control",
        }
    )
    block = replace(block.copy(), tie_points=rest, marks=marks, ground=ground)
    block.points = block.points[~block.points["point"].isin(names)].reset_index(drop=True)
    return block


def axis_assignments() -> list[np.ndarray]:
    """All 24 right-handed ways (3, 3) in which a gyroscope's axes can lie along the camera's."""
    return list(np.rint(Rotation.create_group("O").as_matrix()))


def cost_of(
    block: Block, effect: str, delays: Sequence[float] = (0.0,), loss: str = "huber:4",
    iterations: int = 40,
) -> float:  # fmt: skip
    """Lowest cost of an adjustment with an effect of motion, camera held, over start delays (s).

    For comparing what is believed of a gyroscope's axes or of the row direction: wrong beliefs
    have many shallow minima, so the delay starts from several values. Costs are of the
    same measurements, as they are stated. iterations: at most, of each.
    """
    costs, model = [], Model(camera="fixed", effects=[effect], loss=loss, lever_arm="fixed")
    for delay in delays:
        shifted = block.copy()
        shifted.rates = block.rates.assign(time_s=block.rates["time_s"] - delay)
        try:
            found = refit(shifted, model, Run(max_iterations=iterations))
        except (AdjustmentFailed, InputError):
            # Without a readout a delay cannot be determined: that belief explains nothing.
            continue
        costs.append(found.cost)
    return min(costs, default=float("inf"))
