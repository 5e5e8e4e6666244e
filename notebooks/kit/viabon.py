"""The four surveys of Viabon (Zhou 2019, chapter 7): flown again, with a cause added, and judged.

The published RMS of check points are the measurement. Each candidate cause has one amount. Many
simulated surveys say how the RMS spread at every amount, and from that follows how likely the
published values are (synthetic likelihood, Wood 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd
from scipy.optimize import nnls

import corridor
from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.simulation import read_plan
from kit import published
from kit.draws import Table
from kit.published import Draws
from kit.table_7_3 import CAMERAS, Configurations, configurations, in_pairs

READOUT_S = 0.0564  # section 7.4.2.1
# Tie points an image: a choice of ours, since what MicMac's reduction leaves is not printed. Errors
# depend on it less than on the draw (chapter 4, appendix). Dataset 3 has fewer, for its 648 images.
TIES = 150
TIES_OF = {"d3": 50}
NOTHING = "nothing"
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
# What the survey at 90 m leaves as likely (chapter 5c), and is simulated for the others.
LEFT = ("rotation", "pitch", "roll", "yaw", "velocity", "control", "marks")
HELD_OUT = [s for s in STATISTICS if "-10p" in s]
# Of other programs: what no correction has touched.
ELSEWHERE = {
    "metashape": [s for s in STATISTICS if s[0] == "o" and ("-10p" in s or s.endswith(" z"))],
    "pix4d_rms": [s for s in STATISTICS if s.startswith("o-8p") and s.endswith(" z")],
}


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


def joined(block: Block) -> Block:
    """The block without images that share fewer than three tie points with others: strictly, an
    adjustment refuses them."""
    ties = block.tie_points
    shared = ties[ties.groupby("point", observed=True)["image"].transform("size") > 1]
    count = shared["image"].value_counts()
    return block.select(images=list(count.index[count >= 3]))


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
    survey: str, seed: int, ties: int | None = None, cause: str = NOTHING, amount: float = 0.0,
    **noise: float,
) -> Block:  # fmt: skip
    """A survey as recorded in the drone's files, with so much of a cause.

    survey: key of `SURVEYS` or name of a plan. noise: as in a plan. Time stamps are cut to whole
    seconds, velocities and angular rates are not recorded.
    """
    plan = read_plan(SURVEYS.get(survey, (survey,))[0])
    ties = TIES_OF.get(survey, TIES) if ties is None else ties
    plan = replace(
        plan, tie_points=replace(plan.tie_points, per_image=ties),
        noise=replace(plan.noise, **noise),
    )  # fmt: skip
    one = CAUSES.get(cause)
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


def draw(survey: str, cause: str, amount: float, seed: int) -> dict[str, float]:
    """One draw, cm; with a motion of each image where `PER_IMAGE` says so."""
    block = flown(survey, seed, None, cause, amount)
    tables = [processed(block).table]
    cameras = PER_IMAGE.get((survey, cause, amount))
    if cameras:
        moving = processed(block, per_image="motion_per_image", cameras=cameras, corrected={})
        tables.append(moving.table.filter(like="m-", axis=0))
    return {
        f"{row} {measure}": float(table.loc[row, measure])
        for table in tables
        for row in table.index
        for measure in MEASURES
    }


# --- how likely the published values are ---------------------------------------------------------


@cache
def _register():
    return published.read()


def published_values(survey: str, statistics: Sequence[str], program: str = "") -> np.ndarray:
    """RMS as printed, cm: MicMac's of tables 7.4 to 7.7, `metashape` or `pix4d_rms`."""
    register = _register()
    return np.array([_value(register, survey, name, program) for name in statistics])


def _value(register, survey, statistic, program):
    row, part = statistic.split()
    entry = identifier(survey, row, part)
    if not program:
        return register[entry].values[0]
    values = register[
        f"shutter.{program}.{entry.removeprefix('shutter.').rpartition('.')[0]}"
    ].values
    # Of eight parameters the height alone: the plans' speeds were chosen with the other.
    return values[-1] if part == "z" else values[0]


def rms(draws: pd.DataFrame, statistics: Sequence[str]) -> np.ndarray:
    """(draws, statistics) RMS, cm."""
    return draws[[f"{s.split()[0]} {PARTS[s.split()[1]]}" for s in statistics]].to_numpy(float)


@dataclass(frozen=True, eq=False)
class Judged:
    """One cause beside published values.

    amount, low, high: most likely and 95 % interval (likelihood ratio); better: log likelihood
    there less that of none of it. amounts, likelihood: the curve, its zero at none of it. factor:
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

    def in_words(self, unit: str) -> str:
        """Amount and its 95 % interval: `0.9 (0.5 to 1.4) deg/s`."""
        return f"{self.amount:.1f} ({self.low:.1f} to {self.high:.1f}) {unit}".strip()

    def at(self, amount: float) -> float:
        """Log likelihood of so much of the cause less that of none of it."""
        return float(np.interp(amount, self.amounts, self.likelihood))


def judge(
    draws: pd.DataFrame,
    survey: str,
    cause: str,
    statistics: Sequence[str] = tuple(FITTED),
    program: str = "",
) -> Judged:
    """How much of a cause published RMS values speak for.

    Independent causes add in squares, so the geometric mean square of each RMS is u + w a^2, u and
    w of all simulated amounts by least squares, w >= 0. About it the logarithms of the RMS scatter
    together: their covariance is that of all draws of the survey about the mean of their cause and
    amount (synthetic likelihood, Wood 2010), and as it comes from N draws the density is a t
    (Sellentin and Heavens 2016). program: whose values, see `published_values`.
    Raises InputError where the table has no draws of the cause.
    """
    mine = draws[draws["survey"] == survey]
    if not (mine["cause"] == cause).any():
        raise InputError(f"viabon.csv has no draw of {cause} in {survey}: python -m kit.draws")
    left, amounts, means, weight = [], [], [], []
    for (name, amount), group in mine.groupby(["cause", "amount"]):
        logs = np.log(rms(group, statistics))
        left.append(logs - logs.mean(axis=0))
        if name in (NOTHING, cause):
            amounts.append(amount)
            means.append(np.exp(2 * logs.mean(axis=0)))
            weight.append(np.sqrt(len(logs)))
    amounts, weight = np.array(amounts), np.array(weight)
    design = np.column_stack([np.ones(len(amounts)), amounts**2])
    squares = np.empty((2, len(statistics)))
    for k, column in enumerate(np.array(means).T):
        scale = weight / column
        squares[:, k] = nnls(design * scale[:, None], column * scale)[0]
    scatter = np.concatenate(left)
    count = len(scatter)
    covariance = scatter.T @ scatter / (count - len(left))
    grid = np.linspace(0, 1.25 * amounts.max(), 501)
    target = np.log(published_values(survey, statistics, program))
    off = target - 0.5 * np.log(squares[0] + squares[1] * grid[:, None] ** 2)
    distance = np.einsum("ni,ij,nj->n", off, np.linalg.inv(covariance), off)
    likelihood = -0.5 * count * np.log1p(distance / (count - 1))
    likelihood -= likelihood[0]
    best = int(np.argmax(likelihood))
    # Twice the logarithm of the likelihood ratio is chi-square with one degree of freedom.
    inside = np.flatnonzero(2 * (likelihood[best] - likelihood) <= 3.84)
    return Judged(
        cause, float(grid[best]), float(grid[inside[0]]), float(grid[inside[-1]]),
        float(likelihood[best]), float(np.exp(np.sqrt(np.mean(off[best] ** 2)))),
        grid, likelihood, squares,
    )  # fmt: skip


def asked(draws: pd.DataFrame, survey: str) -> list[str]:
    """Causes that the table has of a survey, in the order of `CAUSES`."""
    there = set(draws.loc[draws["survey"] == survey, "cause"])
    return [cause for cause in CAUSES if cause in there]


def likely(draws: pd.DataFrame, survey: str) -> dict[str, float]:
    """Of each cause of a survey the most likely amount, or the one simulated, if it is only one."""
    found = {}
    for cause in asked(draws, survey):
        mine = draws[(draws["survey"] == survey) & (draws["cause"] == cause)]["amount"].unique()
        found[cause] = mine[0] if len(mine) == 1 else judge(draws, survey, cause).amount
    return found


def held_as_text(draws: pd.DataFrame, survey: str, cause: str, amount: float) -> str:
    """How many predictions hold with all draws, and the range of single ones: `17 (9 to 18)`."""
    if cause != NOTHING:
        amount = nearest(draws, survey, cause, amount)
    rows = some(draws, survey, cause, amount)
    single = [holding(one, survey)[0] for _, one in rows.groupby("seed")]
    return f"{holding(rows, survey)[0]} ({min(single)} to {max(single)})"


def factor(known: Sequence[float], draws: np.ndarray) -> float:
    """Typical factor between published values and the medians of draws."""
    return float(np.exp(np.sqrt(np.mean(np.log(known / np.median(draws, axis=0)) ** 2))))


def identifier(survey: str, configuration: str, part: str) -> str:
    """Id in the register of a row of the survey's table: `shutter.d2.c_8p_1.xy`."""
    kind, camera, control = configuration.split("-")
    return f"shutter.{survey}.{kind}_{camera}_{control[-1]}.{part}"


def as_text(values: Sequence[float], digits: int = 1) -> str:
    """Median and range of draws: `4.1 (3.3 to 4.6)`."""
    values = np.asarray(values, float)
    middle, low, high = np.median(values), values.min(), values.max()
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def nearest(draws: pd.DataFrame, survey: str, cause: str, amount: float) -> float:
    """The simulated amount of a cause that is nearest to one."""
    of = draws.loc[(draws["survey"] == survey) & (draws["cause"] == cause), "amount"].unique()
    return float(of[np.argmin(np.abs(of - amount))])


def some(draws: pd.DataFrame, survey: str, cause: str = NOTHING, amount: float = 0.0):
    """Rows of a survey with so much of a cause, a seed each."""
    mine = draws[(draws["survey"] == survey) & (draws["cause"] == cause)]
    return mine[np.isclose(mine["amount"], amount)]


def gain(rows: pd.DataFrame, configuration: str) -> np.ndarray:
    """By how much the 3D RMS is smaller than that of the original observations, %, by draw."""
    original = f"o-{configuration.split('-', 1)[1]} rms_3d"
    return (100 * (1 - rows[f"{configuration} rms_3d"] / rows[original])).to_numpy(float)


def ours(rows: pd.DataFrame, survey: str) -> dict[str, Draws]:
    """Numbers of the draws for every row of a survey's table, by its id in the register."""
    found = {}
    for row in CONFIGURATIONS:
        for part, short in (("xy", "xy"), ("z", "z"), ("d3", "3d")):
            columns = [f"{row} {what}_{short}" for what in ("rms", "mean", "std")]
            found[identifier(survey, row, part)] = Draws(rows[columns].to_numpy(float))
        if row[0] == "c":
            found[identifier(survey, row, "gain")] = Draws(gain(rows, row))
    return found


def holding(rows: pd.DataFrame, survey: str, camera: str = "") -> tuple[int, int]:
    """How many predictions of a survey's table hold, and of how many."""
    words = [
        verdict.word
        for verdict in published.compare(ours(rows, survey), register=_register())
        if verdict.published.kind == "prediction" and camera in verdict.published.id
    ]
    return words.count(published.HOLDS), len(words)


def elsewhere(rows: pd.DataFrame, survey: str) -> dict[str, Draws]:
    """The same for what other programs print: original observations, and for Pix4D at 90 m those
    with a motion of each image."""
    found = {}
    for k in (1, 2):
        xy, z = f"o-10p-GCP{k} rms_xy", f"o-8p-GCP{k} rms_z"
        moving = [f"m-8p-GCP{k} rms_xy", f"m-8p-GCP{k} rms_z"]
        columns = {
            f"metashape.{survey}.o_8p_{k}": [z],
            f"metashape.{survey}.o_10p_{k}": [xy, xy[:-2] + "z"],
            f"pix4d_rms.{survey}.o_8p_{k}": [z],
        } | ({f"pix4d_rms.{survey}.c_8p_{k}": moving} if survey == "d2" else {})
        found |= {
            f"shutter.{name}": Draws(rows[of].to_numpy(float)) for name, of in columns.items()
        }
    return found


def reasons(
    draws: pd.DataFrame, survey: str, causes: Mapping[str, float], of: Callable = ours
) -> dict[str, str]:
    """For every row of a survey that does not hold as planned: with which cause it does.

    causes: the amount of each that is asked, or the nearest that is simulated. of: `ours` or
    `elsewhere`.
    """

    def compared(cause=NOTHING, amount=0.0):
        rows = some(draws, survey, cause, amount)
        return published.compare(of(rows, survey), register=_register())

    with_it = {}
    for cause, amount in causes.items():
        amount = nearest(draws, survey, cause, amount)
        with_it[f"{cause} {amount:g} {CAUSES[cause].unit}".strip()] = compared(cause, amount)
    return published.reasons(compared(), with_it, "(chapter 5c)")


# What is in the table: every cause at every amount over 90 m, those that are left over elsewhere.
SEEDS = 8
AMOUNTS = {
    "d1": {
        "rotation": (1.0, 2.0, 3.0), "pitch": (2.0, 4.0), "roll": (2.0, 4.0),
        "velocity": (1.0, 2.0), "control": (2.0, 4.0), "marks": (4.0, 8.0),
    },
    "d2": {name: cause.amounts for name, cause in CAUSES.items()},
    "d3": {"rotation": (1.0,)},
    "d4": {
        "rotation": (0.5, 1.0, 2.0), "pitch": (1.0, 2.0), "roll": (1.0, 2.0), "yaw": (1.0, 2.0),
        "velocity": (1.0, 2.0), "control": (2.0, 4.0), "marks": (2.0, 4.0),
    },
}  # fmt: skip
PLANNED = [
    (survey, cause, amount, seed)
    for survey, causes in AMOUNTS.items()
    for cause, amounts in {NOTHING: (0.0,), **causes}.items()
    for amount in amounts
    for seed in range(24 if (survey, cause) == ("d2", NOTHING) else SEEDS)
]
# Where a motion of each image is estimated as well, with which cameras: beside nothing, and beside
# what is left over. Not for dataset 3: motions of 648 images take six minutes of a processor.
PER_IMAGE = {(survey, NOTHING, 0.0): CAMERAS for survey in ("d1", "d2", "d4")} | dict.fromkeys(
    [
        ("d2", "rotation", 1.0), ("d2", "pitch", 1.0), ("d2", "roll", 1.0), ("d2", "yaw", 2.0),
        ("d2", "velocity", 2.0), ("d2", "control", 2.0), ("d2", "marks", 2.0),
    ],
    {"8p": CAMERAS["8p"]},
)  # fmt: skip

TABLE = Table(
    "viabon", COLUMNS, [(s, TIES_OF.get(s, TIES), *rest) for s, *rest in PLANNED],
    lambda survey, _, *rest: draw(survey, *rest), decimals=2,
)  # fmt: skip


def _with_priors(times, seed):
    """The corridor with a motion of each image that has priors: gain of the 3D RMS, %.

    times: how many times 5 m/s and 0.3 deg/s an axis the priors are wide.
    """
    block = flown("d4", seed)
    at = corridor.effects.find("motion_per_image").parameters(block)
    found = processed(
        block, per_image="motion_per_image", cameras={"8p": "fraser8"}, corrected={},
        priors={f"motion_per_image.{p.name}": (0.0, times * p.scale) for p in at},
    ).table  # fmt: skip
    return {f"gain {k}": found.loc[f"m-8p-GCP{k}", "gain"] for k in (1, 2)}


def _surveyed(control_cm, seed):
    """90 m with a motion of each image, ground points known to so much an axis: RMS, cm."""
    block = flown("d2", seed, control_m=control_cm / 100)
    found = processed(
        block, per_image="motion_per_image", cameras={"8p": "fraser8"}, corrected={}
    ).table
    return {f"GCP{k} {p}": found.loc[f"m-8p-GCP{k}", f"rms_{p}"] for k in (1, 2) for p in PARTS}


def surveyed(control_cm: float) -> dict[str, Draws]:
    """Numbers of the draws of `SURVEYED` for Pix4D's rows at 90 m, by their id in the register."""
    rows = SURVEYED.some([(control_cm, seed) for seed in range(SEEDS)])
    return {
        f"shutter.pix4d_rms.d2.c_8p_{k}": Draws(rows[[f"GCP{k} {p}" for p in PARTS]].to_numpy())
        for k in (1, 2)
    }


# How the oblique flight of dataset 3 may have been flown.
OBLIQUE_WAYS = {
    "30 deg, 7.8 m/s": {"tilt_deg": 30.0},
    "30 deg, 3.9 m/s": {"tilt_deg": 30.0, "interval_s": 4.0},
    "30 deg, 1.9 m/s": {"tilt_deg": 30.0, "interval_s": 8.2},
    "30 deg, ahead and back in turns": {"tilt_deg": 30.0, "look": "alternating"},
    "30 deg, sideways": {"tilt_deg": 30.0, "look": "sideways"},
    "30 deg, all strips one way": {"tilt_deg": 30.0, "direction": "same"},
    "30 deg, heading kept": {"tilt_deg": 30.0, "heading": "kept"},
    "15 deg, 7.8 m/s": {"tilt_deg": 15.0},
}


def _oblique(way, seed):
    """Dataset 3 as read out, control set 1: RMS of the check points, cm."""
    three = read_plan(SURVEYS["d3"][0])
    flights = (
        replace(f, **OBLIQUE_WAYS[way]) if f.tilt_deg else f for f in three.flights
    )  # fmt: skip
    thin = replace(three.tie_points, per_image=40)
    block = joined(
        corridor.simulate(replace(three, flights=tuple(flights), tie_points=thin), seed=seed)
    )
    control, check = in_pairs(block.ground["point"].tolist())
    numbers = {}
    for name, camera in CAMERAS.items():
        rms = corridor.adjust(
            block, camera=camera, control=control, check=check, strict=True
        ).check_rms
        numbers |= {f"{name}, horizontal (cm)": 100 * rms.xy, f"{name}, height (cm)": 100 * rms.z}
    return numbers


PRIORS = Table(
    "viabon_priors", ("times", "seed"), [(times, seed) for times in (1, 10) for seed in range(8)],
    _with_priors,
)  # fmt: skip
CONTROL_CM = (0.5, 0.7)
SURVEYED = Table(
    "viabon_surveyed", ("control_cm", "seed"),
    [(control, seed) for control in CONTROL_CM for seed in range(SEEDS)], _surveyed, decimals=2,
)  # fmt: skip
OBLIQUE = Table("viabon_oblique", ("way", "seed"), [(way, 0) for way in OBLIQUE_WAYS], _oblique)
