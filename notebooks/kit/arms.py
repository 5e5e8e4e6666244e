"""The dike's flights (Zhou 2019, table 5.3) flown again: lever arms, heights of check points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import stats

import corridor
from corridor.core.simulation import Plan, read_plan
from kit.draws import Table
from kit.published import Draws

NADIR, OBLIQUE, HEIGHTS, SINGLE = (
    f"thesis_{name}" for name in ("s2_n50", "s2_o50", "s2_n3070", "s1_n50")
)
SETS = {"no": f"{NADIR}+{OBLIQUE}", "all": f"{NADIR}+{OBLIQUE}+{HEIGHTS}", "s1": SINGLE}
BIAS_M = (0.03, 0.01, 0.07)  # constant error of the GNSS that chapter 2 supposes
TIES = 100  # tie points an image
TILT_DEG, NOISE = 1.5, 1.0  # as the plans have them: scatter of the camera's tilt, GNSS as stated
CONTROL = {"no": (0, 1), "all": (0, 1, 15), "s1": (0, 1)}
# Set, tilt and noise of the antenna in what its receiver states, and how often each is flown.
PLANNED = [
    (name, tilt, noise, seed)
    for name, tilt, noise, count in (
        ("no", TILT_DEG, NOISE, 8), ("all", TILT_DEG, NOISE, 8), ("s1", TILT_DEG, NOISE, 16),
        ("s1", 0.3, 1.0, 16), ("s1", TILT_DEG, 3.0, 16), ("s1", 0.3, 3.0, 16),
    )
    for seed in range(count)
]  # fmt: skip
COLUMNS = ["flights", "tilt_deg", "noise", "seed"]


def some(draws: pd.DataFrame, flights: str, tilt_deg=TILT_DEG, noise=NOISE) -> pd.DataFrame:
    """The draws of one set of flights."""
    mine = draws[draws["flights"] == flights]
    return mine[np.isclose(mine["tilt_deg"], tilt_deg) & np.isclose(mine["noise"], noise)]


def plan_of(flights: str, tilt_deg: float = TILT_DEG, noise: float = NOISE) -> Plan:
    """The plan of one set of flights, with so much tilt of the camera and noise of the GNSS."""
    plan = read_plan(SETS[flights]).with_flights(attitude_jitter_deg=tilt_deg)
    stated = tuple(noise * np.atleast_1d(plan.noise.gnss_m))
    return replace(
        plan,
        tie_points=replace(plan.tie_points, per_image=TIES),
        noise=replace(plan.noise, gnss_m=stated),
    )


def draw(flights: str, tilt_deg: float, noise: float, seed: int) -> dict[str, float]:
    """One draw. By the number of control points, cm: lever arm z of the nadir flight and of the
    oblique one (`arm_1`, `oblique_1`), in the sense of the thesis (theta = -a), RMS and mean of
    heights.
    """
    plan = plan_of(flights, tilt_deg, noise)
    bias = {"gnss_bias": dict(zip("xyz", BIAS_M, strict=True))}
    block = corridor.simulate(plan, bias, seed=seed, noise={"gnss_slow": 0.5})
    order, row = block.ground["point"].tolist(), {}
    for n in CONTROL[flights]:
        control = {0: [], 1: [order[7]], 15: order[:15]}[n]
        # As MicMac does: weights as stated, whatever the residuals say.
        found = corridor.adjust(
            block, camera="fraser8", weights="stated", control=control,
            check=[name for name in order if name not in control],
        )  # fmt: skip
        arm = -100 * found.lever_arm.set_index("flight")["z"]
        for what, ending in (("arm", "n50"), ("oblique", "o50")):
            row |= {f"{what}_{n}": z for flight, z in arm.items() if flight.endswith(ending)}
        row |= {f"height_{n}": 100 * found.check_rms.z, f"mean_{n}": 100 * found.check_mean.z}
    return row


def chance(draws: pd.DataFrame, published: dict[str, float]) -> float:
    """How rarely a new draw lies as far from the mean of these as what is published (Hotelling)."""
    values = draws[list(published)].to_numpy(float)
    count, size = values.shape
    off = np.array(list(published.values())) - values.mean(axis=0)
    square = off @ np.linalg.solve(np.cov(values.T), off) / (1 + 1 / count)
    return float(stats.f.sf(square * (count - size) / (size * (count - 1)), size, count - size))


def of_both(draws: pd.DataFrame, control: int) -> Draws:
    """Lever arm z of the nadir flight, and of the oblique one where there is one, cm."""
    names = [f"arm_{control}", f"oblique_{control}"]
    return Draws(draws[names].dropna(axis=1).to_numpy(float))


TABLE = Table("arms", COLUMNS, PLANNED, draw, decimals=2)
