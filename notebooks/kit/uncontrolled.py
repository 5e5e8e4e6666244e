"""A corridor flown without ground control: strips, attitudes and heads, planned and drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

import corridor
from corridor.core.camera import Camera
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.core.simulation import Flight, Ground, Noise, Plan, TiePoints, cameras
from corridor.planning import Planner
from kit.draws import Table

# What is free, and what the drone's drawing says: the antenna.
KNOWN = {"camera": "fraser8", "lever_arm": "fixed"}
NOISE = Noise(tie_px=0.5, mark_px=0.5, gnss_m=(0.02, 0.02, 0.04), control_m=0.005)
# A drone's camera of 20 megapixels with a lens of 24 mm (full-frame).
SMALL = Camera.from_table("small", {"width": 5472, "height": 3648, "f": 3660.0})
# Which way the cameras of a head look beside the one that looks down: axis, sense.
AHEAD, BACK, LEFT, RIGHT = ("x", -1.0), ("x", 1.0), ("y", -1.0), ("y", 1.0)


def strips(name: str, count: int = 2, height: float = 50.0, **more) -> Flight:
    """Strips along the corridor, 20 m apart; one of them lies on the axis."""
    offsets = tuple(20.0 * (np.arange(count) - (count - 1) / 2))
    plan = {"offsets_m": offsets, "forward": 0.8, "lever_arm_m": (0.0, 0.0, 0.1)} | more
    return Flight(name, height, strips=count, **plan)


def flown(*flights: Flight, attitude: float | None = None, length: float = 300.0, **more) -> Plan:
    """A plan without control. attitude: sigma of roll and pitch, degrees; of yaw twice that."""
    noise = more.pop("noise", NOISE)
    if attitude is not None:
        noise = replace(noise, attitude_deg=(attitude, attitude, 2 * attitude))
    plan = {
        "tie_points": TiePoints(per_image=100),
        "ground": Ground(control=0, check=20, layout="spread"),
        "cameras": {"small": SMALL},
    }
    return Plan(
        "uncontrolled", flights, axis_m=((0.0, 0.0), (0.0, length)), noise=noise,
        attitudes=attitude is not None, **(plan | more),
    )  # fmt: skip


def with_head(plan: Plan, tilt_deg: float, *looks: tuple[str, float], **sigmas: float) -> Plan:
    """The plan flown by a head: its camera looks down, copies of it look to sides, tilted.

    sigmas: sigma_m and sigma_deg of the mountings; without, nobody knows how they hang.
    """
    camera = cameras()["camlight"]
    members = {}
    for axis, sense in looks:
        turn = sense * np.radians(tilt_deg) * (np.array(list("xyz")) == axis)
        name = {AHEAD: "ahead", BACK: "back", LEFT: "left", RIGHT: "right"}[axis, sense]
        members[name] = {
            "xyz": [0.1 * sense * (axis == "y"), 0.1 * sense * (axis == "x"), 0.0],
            "quaternion": quaternion_from_rotation(rotation_from_vector(turn)).tolist(),
        } | sigmas
    return replace(
        plan,
        flights=tuple(replace(flight, camera="below") for flight in plan.flights),
        cameras={name: replace(camera, name=name) for name in ("below", *members)},
        rig={"head": {"base": "below", "member": members}},
    )


def expected(plan: Plan) -> pd.Series:
    """Expected RMS of the check points, cm, and what of a constant GNSS error reaches them."""
    found = Planner(plan, **KNOWN).expect(0)
    if found.open:
        return pd.Series({"x": np.nan, "y": np.nan, "z": np.nan, "bias": np.nan})
    each = found.check_points[["rms_x", "rms_y", "rms_z"]].to_numpy()
    rms = 100 * np.sqrt(np.mean(each**2, axis=0))
    return pd.Series([*rms, found.transfer[2]], index=["x", "y", "z", "bias"])


def two_strips() -> dict[str, Plan]:
    """Two strips of 300 m at 50 m, and what may be added to them."""
    two, stated = flown(strips("two")), {"sigma_m": 0.001, "sigma_deg": 0.02}
    return {
        "two nadir strips": two,
        "+ a strip at 70 m": flown(strips("two"), strips("high", 1, 70.0)),
        "+ a strip looking ahead": flown(strips("two"), strips("oblique", 1, tilt_deg=25.0)),
        "+ attitudes to 0.05°": flown(strips("two"), attitude=0.05),
        "+ attitudes to 0.003°": flown(strips("two"), attitude=0.003),
        "head, mounting known": with_head(two, 30.0, AHEAD, **stated),
        "head, mounting unknown": with_head(two, 30.0, AHEAD),
    }


def five_strips() -> dict[str, Plan]:
    """Five strips at 100 m with the RTK of Štroner et al., and five more that look ahead."""
    rtk = replace(NOISE, gnss_m=(0.015, 0.015, 0.03))
    more = {"camera": "small", "forward": 0.75, "offsets_m": tuple(40.0 * np.arange(-2.0, 3.0))}
    nadir, ahead = (strips(f"tilt {t:g}", 5, 100.0, tilt_deg=t, **more) for t in (0.0, 30.0))
    return {
        "nadir": flown(nadir, noise=rtk),
        "nadir and 30° ahead": flown(nadir, ahead, noise=rtk),
    }


EVEN, UNEVEN, SAME = "noise alone", "and an uneven lens", "and the same uneven lens"


def _draw(way, lens, seed):
    """Simulated and adjusted: RMS of check points (cm), errors of f and height.

    lens: `EVEN`; `UNEVEN`, with a deformation of its own in every draw; `SAME`, with one for all.
    """
    plan = (two_strips() | five_strips())[way]
    of = {UNEVEN: seed, SAME: 0}.get(lens)
    hidden = None if of is None else uneven(plan)(np.random.default_rng(of))
    block = corridor.simulate(plan, hidden, seed=seed)
    block.lever_arm = {flight.name: flight.lever_arm_m for flight in plan.flights}
    found = corridor.adjust(block, control=[], **KNOWN)
    off = found.check_points[["dx", "dy", "dz"]].to_numpy()
    true = plan.camera(plan.flights[0])["f"]
    return dict(zip("xyz", 100 * np.sqrt(np.mean(off**2, axis=0)), strict=True)) | {
        "f off (px)": found.camera["value"].iloc[0] - true,
        "height off (cm)": 100 * off[:, 2].mean(),
    }


def uneven(plan: Plan) -> Callable[[np.random.Generator], Mapping]:
    """Lenses with a deformation of half a pixel that eight parameters do not have."""
    block = corridor.simulation.perfect_block(plan)
    shape = corridor.effects.find("sensor_unflatness").parameters(block)

    def drawn(rng):
        return {"sensor_unflatness": {p.name: p.scale * rng.standard_normal() for p in shape}}

    return drawn


def height_with_focal(plan: Plan) -> float:
    """Correlation of a check point's height with the focal length; the mean of their amounts."""
    found = corridor.adjust(_known(plan), control=[], **KNOWN)
    rows = [list(found.problem.point_names).index(p) for p in found.check_points["point"]]
    labels = [unknown.label for unknown in found.system.columns.shared]
    f = labels.index(f"camera.{plan.flights[0].camera}.f")
    of_points = np.array(rows)
    both = found.covariance.between(of_points, [f])[:, 2, 0]
    sigma = np.sqrt(found.covariance.each_point[of_points][:, 5] * found.covariance.shared[f, f])
    return float(np.mean(np.abs(both / sigma)))


def _known(plan):
    block = corridor.simulation.perfect_block(plan)
    block = corridor.simulation.add_noise(block, noise=plan.noise, seed=0)
    block.lever_arm = {flight.name: flight.lever_arm_m for flight in plan.flights}
    return block


TABLE = Table(
    "uncontrolled", ("way", "lens", "seed"),
    [(way, EVEN, seed) for way in two_strips() for seed in range(20)]
    + [(way, lens, seed) for way in five_strips() for lens in (EVEN, UNEVEN) for seed in range(30)]
    + [("nadir", SAME, seed) for seed in range(12)],
    _draw,
)  # fmt: skip
