"""The four surveys of Viabon (Zhou 2019, chapter 7): flown again, with a cause added, and judged.

The published RMS of check points are the measurement. Each candidate cause has one amount. Many
simulated surveys say how the RMS spread at every amount, and from that follows how likely the
published values are (synthetic likelihood, Wood 2010). `notebooks/viabon.csv` holds the draws;
`python -m kit.viabon` makes them again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import nnls

import corridor
from corridor.block import Block
from corridor.errors import InputError
from corridor.simulation import read_plan
from kit import published
from kit.table_7_3 import Configurations, configurations

TABLE = Path(__file__).resolve().parents[1] / "viabon.csv"
READOUT_S = 0.0564  # section 7.4.2.1
TIES = 150
_N30, _O60, _N90, _N40 = (f"thesis_viabon_{name}" for name in ("n30", "o60", "n90", "n40"))
SURVEYS = {
    "d1": (_N30, "30 m"),
    "d2": (_N90, "90 m"),
    "d3": (f"{_N30}+{_O60}+{_N90}", "30 m + 60 m oblique + 90 m"),
    "d4": (_N40, "40 m, corridor"),
}
# Read from time stamps in whole seconds: the drone's files have neither velocity nor rate.
_UNWRITTEN = ("vx", "vy", "vz", "wx", "wy", "wz")
CONFIGURATIONS = [
    f"{kind}-{camera}-GCP{k}" for camera in ("8p", "10p") for kind in "oc" for k in (1, 2)
]
PARTS = {"xy": "rms_xy", "z": "rms_z"}
STATISTICS = [f"{row} {part}" for row in CONFIGURATIONS for part in PARTS]
# The plans' speeds were chosen with the horizontal RMS of `o-8p`: that one judges nothing.
FITTED = [s for s in STATISTICS if "-8p" in s and not (s[0] == "o" and s.endswith("xy"))]
HELD_OUT = [s for s in STATISTICS if "-10p" in s]


@dataclass(frozen=True)
class Cause:
    """What else the survey may have had, with an amount.

    amounts: that are simulated, beside none of it. plan: the plan with so much of it; block: the
    simulated block with it; both from what was there, the amount and a generator of random numbers.
    """

    words: str
    unit: str
    amounts: tuple[float, ...]
    plan: Callable | None = None
    block: Callable | None = None
    effects: Callable | None = None


def _noise(**amounts):
    return lambda plan, a: replace(plan, noise=replace(plan.noise, **{name: a for name in amounts}))


def _turning(axis):
    """About one axis of the camera: x lies across the flight (pitch), y along it, z looks down."""
    return lambda plan, a: plan.with_flights(
        angular_rate_deg_s=tuple(a if k == axis else 0.0 for k in range(3))
    )


def _late(block, amount, draw):
    """Time stamps off by chance, before they are cut to whole seconds."""
    block.images["time_s"] += amount * draw.standard_normal(len(block.images))


def _misplaced(block, amount, draw):
    """Ground points surveyed with an error that the stated sigma does not know."""
    block.ground[["x", "y", "z"]] += amount / 100 * draw.standard_normal((len(block.ground), 3))


def _mispointed(block, amount, draw):
    """Marks of ground points measured beside them."""
    block.marks[["x", "y"]] += amount * draw.standard_normal((len(block.marks), 2))


CAUSES = {
    "rotation": Cause(
        "the camera turns while it is read", "deg/s", (0.5, 1.0, 1.5, 2.0, 3.0),
        plan=lambda plan, a: plan.with_flights(angular_rate_deg_s=a),
    ),
    **{
        name: Cause(
            f"it turns in {name} alone", "deg/s", (0.5, 1.0, 2.0, 3.0), plan=_turning(axis)
        )
        for axis, name in enumerate(("pitch", "roll", "yaw"))
    },
    "velocity": Cause(
        "velocity changes from image to image", "m/s", (0.5, 1.0, 2.0),
        plan=lambda plan, a: plan.with_flights(velocity_jitter_m_s=a),
    ),
    "stamps": Cause("time stamps off by chance", "s", (0.5, 1.0, 2.0), block=_late),
    "affinity": Cause(
        "pixels are not square (b1)", "px", (1.0, 3.0, 10.0),
        # b1 as it stretches a picture of 5472 px.
        effects=lambda a: {"affine_distortion": {"b1": a / 4300.0}},
    ),
    "readout": Cause(
        "another readout than 56.4 ms", "ms", (3.0, 6.2, 12.0),
        effects=lambda a: {"rolling_shutter": {"readout": READOUT_S - a / 1000}},
    ),
    "control": Cause("ground points off by chance", "cm", (1.0, 2.0, 4.0), block=_misplaced),
    "marks": Cause("ground points marked beside", "px", (1.0, 2.0, 4.0), block=_mispointed),
    "ties": Cause(
        "tie points noisier than 0.4 px", "px", (0.8, 1.6, 3.2),
        plan=lambda plan, a: replace(plan, noise=replace(plan.noise, tie_px=a)),
    ),
    "heading": Cause(
        "heading kept at the strips' ends", "", (1.0,),
        plan=lambda plan, a: plan.with_flights(heading="kept"),
    ),
}  # fmt: skip


def flown(
    survey: str, seed: int, ties: int = TIES, cause: str | None = None, amount: float = 0.0
) -> Block:
    """A survey as recorded in the drone's files, with so much of a cause.

    survey: key of `SURVEYS` or name of a plan. Time stamps are cut to whole seconds, velocities and
    angular rates are not recorded.
    """
    plan = read_plan(SURVEYS.get(survey, (survey,))[0])
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=ties))
    one = CAUSES[cause] if cause else None
    if one and one.plan:
        plan = one.plan(plan, amount)
    effects = {slug: dict(values) for slug, values in plan.effects.items()}
    if one and one.effects:
        effects |= one.effects(amount)
    block = corridor.simulate(plan, effects, seed=seed).copy()
    block.images = block.images.drop(columns=[c for c in _UNWRITTEN if c in block.images])
    if one and one.block:
        one.block(block, amount, np.random.default_rng([seed, 4207]))
    block.images["time_s"] = np.floor(block.images["time_s"])
    return block


def processed(block: Block, **options) -> Configurations:
    """The survey in the thesis's eight configurations: original and corrected."""
    return configurations(block, {"rolling_shutter": {"readout": READOUT_S}}, **options)


def statistics(found: Configurations) -> dict[str, float]:
    """RMS of the check points, cm: one number a configuration and part, as `STATISTICS`."""
    return {
        f"{row} {part}": float(found.table.loc[row, column])
        for row in CONFIGURATIONS
        for part, column in PARTS.items()
    }


# --- the draws, kept -----------------------------------------------------------------------------

MEASURES = [f"{what}_{part}" for part in ("xy", "z", "3d") for what in ("rms", "mean", "std")]
COLUMNS = ["survey", "ties", "cause", "amount", "seed"]
NOTHING = "nothing"


def read(table: Path = TABLE) -> pd.DataFrame:
    """All draws: survey, ties, cause, amount, seed, and `c-8p-GCP1 rms_z` ... in cm."""
    return pd.read_csv(table, compression="infer")


def draw(survey: str, cause: str, amount: float, seed: int, ties: int = TIES) -> dict[str, float]:
    """One row of the table, made now."""
    found = processed(flown(survey, seed, ties, None if cause == NOTHING else cause, amount))
    return {
        f"{row} {measure}": round(float(found.table.loc[row, measure]), 2)
        for row in CONFIGURATIONS
        for measure in MEASURES
    }


# --- how likely the published values are ---------------------------------------------------------


def published_values(survey: str, statistics: Sequence[str]) -> np.ndarray:
    """RMS as printed in tables 7.4 to 7.7, cm."""
    register = published.read()
    return np.array([register[_entry(survey, name)].values[0] for name in statistics])


def _entry(survey, statistic):
    row, part = statistic.split()
    kind, camera, control = row.split("-")
    return f"shutter.{survey}.{kind}_{camera}_{control[-1]}.{part}"


def rms(draws: pd.DataFrame, statistics: Sequence[str]) -> np.ndarray:
    """(draws, statistics) RMS, cm."""
    return draws[[f"{s.split()[0]} {PARTS[s.split()[1]]}" for s in statistics]].to_numpy(float)


@dataclass(frozen=True, eq=False)
class Judged:
    """One cause beside the published values.

    amount, low, high: most likely and 95 % interval (likelihood ratio); better: log likelihood
    there less that of none of it. amounts, likelihood: the whole curve, none of it at 0. factor:
    typical factor between published and expected RMS at the amount.
    """

    cause: str
    amount: float
    low: float
    high: float
    better: float
    factor: float
    amounts: np.ndarray
    likelihood: np.ndarray
    squares: np.ndarray

    def expected(self, amount: float) -> np.ndarray:
        """RMS expected with so much of the cause, cm, in the order of the statistics."""
        return np.sqrt(self.squares[0] + self.squares[1] * amount**2)


def judge(
    draws: pd.DataFrame, survey: str, cause: str, statistics: Sequence[str] = tuple(FITTED)
) -> Judged:
    """How much of a cause the published RMS values speak for.

    Independent causes add in squares, so the geometric mean square of each RMS is u + w a^2, u and
    w of all simulated amounts by least squares, w >= 0. About it the logarithms of the RMS
    scatter together, alike at every amount: their covariance is that of all draws of the cause
    about their means (synthetic likelihood, Wood 2010), and as it comes from N draws the density is
    a t (Sellentin and Heavens 2016).
    Raises InputError where the table has no draws of the cause.
    """
    mine = draws[(draws["survey"] == survey) & draws["cause"].isin([NOTHING, cause])]
    if not (mine["cause"] == cause).any():
        raise InputError(f"viabon.csv has no draw of {cause} in {survey}: python -m kit.viabon")
    amounts, means, left, weight = [], [], [], []
    for amount, group in mine.groupby("amount"):
        logs = np.log(rms(group, statistics))
        amounts.append(amount)
        means.append(np.exp(2 * logs.mean(axis=0)))
        weight.append(np.sqrt(len(logs)))
        left.append(logs - logs.mean(axis=0))
    amounts, means = np.array(amounts), np.array(means)
    design = np.column_stack([np.ones(len(amounts)), amounts**2])
    squares = np.array(
        [nnls(design * w[:, None], column * w)[0] for column in means.T
         for w in [np.array(weight) / column]]
    ).T  # fmt: skip
    scatter = np.concatenate(left)
    count = len(scatter)
    covariance = scatter.T @ scatter / (count - len(amounts))
    grid = np.linspace(0, 1.25 * amounts.max(), 501)
    target = np.log(published_values(survey, statistics))
    off = target - 0.5 * np.log(squares[0] + squares[1] * grid[:, None] ** 2)
    distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    # Without what is alike for all causes of as many statistics and draws.
    likelihood = -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * count * np.log1p(
        distance / (count - 1)
    )
    best = int(np.argmax(likelihood))
    # Twice the logarithm of the likelihood ratio is chi-square with one degree of freedom.
    inside = np.flatnonzero(2 * (likelihood[best] - likelihood) <= 3.84)
    return Judged(
        cause, float(grid[best]), float(grid[inside[0]]), float(grid[inside[-1]]),
        float(likelihood[best] - likelihood[0]), float(np.exp(np.sqrt(np.mean(off[best] ** 2)))),
        grid, likelihood, squares,
    )  # fmt: skip
