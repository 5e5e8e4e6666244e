"""The dike of Zhou's chapter 4, flown and processed in the ways that its text leaves open."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

import corridor
from corridor.core.adjustment import AbsoluteOrientation, Adjustment, lay_on_control
from corridor.core.block import Block
from corridor.core.camera import undistort
from corridor.core.geometry import rotation_from_quaternion, similarity
from corridor.core.simulation import Plan, read_plan

NADIR, OBLIQUE, HEIGHTS = "thesis_50vt", "thesis_50ob", "thesis_3070vt"
# Tie points an image. The thesis's 800 take three times as long; what is asked for here is in all
# of them alike.
TIES = 300
# An image every 2.5 s, also from strip to strip and flight to flight, as the source counts.
DRIFT_PX, INTERVAL_S = 0.0275, 2.5
ALL_BUT_F = "cx,cy,k1,k2,k3,p1,p2,b1,b2"


def plan(flights: Iterable[str], tilt_deg: float | None = None, **changes) -> Plan:
    """The flights in that order; tilt_deg: of those that look aside; changes: of every flight."""
    joined = read_plan("+".join(flights)).with_flights(**changes)
    joined = replace(joined, tie_points=replace(joined.tie_points, per_image=TIES))
    if tilt_deg is None:
        return joined
    flown = (replace(f, tilt_deg=tilt_deg) if f.tilt_deg else f for f in joined.flights)
    return replace(joined, flights=tuple(flown))


def adjusted(block: Block, camera: str = "fraser10") -> AbsoluteOrientation:
    """Tie points alone, then laid on ten control points by a similarity (section 4.2.2).

    Strictly: nothing that contradicts the rest is left out, for here it is what is asked for.
    """
    return lay_on_control(corridor.adjust(block, camera=camera, control=[], strict=True))


def believed(block: Block, error: float) -> Block:
    """The block with a focal length that is wrong by so many pixels."""
    block = block.copy()
    for name, camera in block.cameras.items():
        block.cameras[name] = camera.with_values(f=camera["f"] + error)
    return block


def read_out(
    flown: Plan, seed: int, readout_s: float, motion: str, velocity: str = "true"
) -> AbsoluteOrientation:
    """A perfect block with a rolling shutter on top, adjusted without it.

    motion: `translation`, the camera only moves, or `rotation`, it only turns. velocity: the
    `true` one; or as the source has it (section 4.3.3), from the next image of the list over the
    interval, `next image`, also where that belongs to another strip or flight, or `next image of
    the strip`, the last one of a strip like the one before it.
    """
    if motion == "translation":
        flown = flown.with_flights(angular_rate_deg_s=0.0)
    block = corridor.simulation.perfect_block(flown, seed)
    if motion == "rotation":
        block.images = block.images.assign(vx=0.0, vy=0.0, vz=0.0)
    if velocity != "true":
        step = block.images[["x", "y", "z"]].diff().shift(-1).ffill()
        if velocity == "next image of the strip":
            strip = block.images[["flight", "strip"]].astype(str).agg(" ".join, axis=1)
            step = step.where(strip == strip.shift(-1)).ffill()
        block.images[["vx", "vy", "vz"]] = step.to_numpy() / INTERVAL_S
    return adjusted(corridor.effects.add(block, {"rolling_shutter": {"readout": readout_s}}))


def middle(results: list[AbsoluteOrientation]) -> AbsoluteOrientation:
    """The draw nearest to the medians of horizontal and height RMS, which the tables show."""
    logs = np.log([[r.check_rms.xy, r.check_rms.z] for r in results])
    return results[int(np.argmin(np.abs(logs - np.median(logs, axis=0)).max(axis=1)))]


def processings(flights: list[str], seed: int, tilt_deg: float) -> pd.DataFrame:
    """Eight ways to process a flight whose focal length drifts: errors of the check points, cm.

    One row a way; z mean, z STD, horizontal RMS.
    """
    flown = plan(flights, tilt_deg)
    drift = {"focal_drift": {"rate": DRIFT_PX / INTERVAL_S}}
    block = corridor.simulate(flown, drift, seed=seed)
    # The effect drifts from the middle of the block, the source from its first image.
    first = -DRIFT_PX * (len(block.images) - 1) / 2
    free = corridor.adjust(block, camera="fraser10", control=[])
    centres = np.array([block.truth["centre"][name] for name in free.poses["image"]])
    on_centres = similarity(free.poses[["x", "y", "z"]].to_numpy(), centres).apply
    at_first = believed(block, first)
    stopped = corridor.adjust(at_first, camera="fraser10", control=[], max_iterations=1)
    on_lens = replace(flown, gnss=True).with_flights(lever_arm_m=(0.0, 0.0, 0.0))
    held = believed(corridor.simulate(on_lens, drift, seed=seed), first)
    held.sigma["gnss_m"] = np.full(3, 1e-6)
    held = corridor.adjust(held, camera="fixed", control=[], lever_arm="fixed")
    still = block.copy()
    still.marks = corridor.simulate(flown, seed=seed).marks
    rows = {
        "all free, laid on control points": _of(lay_on_control(free)),
        "... laid on the camera centres": _errors(free, on_centres),
        "... not laid on anything": _errors(free, lambda points: points),
        "... stopped after one step": _of(lay_on_control(stopped)),
        "f held as at the start, laid on control": _of(adjusted(at_first, ALL_BUT_F)),
        "camera centres and f held, attitudes free": _of(held),
        "poses and f held": _frozen(flown, drift, seed, first),
        "marks of the undrifted camera": _of(adjusted(still)),
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=["z mean", "z STD", "horizontal"])


def _frozen(flown: Plan, drift: dict, seed: int, first: float) -> np.ndarray:
    """Check points intersected from true poses with the first image's f (MicMac's PoseFigee)."""
    still = dict.fromkeys(("centre_m", "rotation_deg"), 0.0)
    flight = corridor.simulate(flown, seed=seed, start=still)
    block = corridor.effects.add(flight, drift)
    ((name, camera),) = block.cameras.items()
    true = flight.truth["camera"][name]
    known = {key: true.get(key, 0.0) for key in ALL_BUT_F.split(",")}
    camera = camera.with_values(**known, f=true["f"] + first)
    marks, image = block.marks, block.image_rows("marks")
    ray = np.column_stack([undistort(marks[["x", "y"]].to_numpy(float), camera.interior),
                           np.ones(len(marks))])  # fmt: skip
    rotation = rotation_from_quaternion(block.poses[:, 3:])[image]
    ray = np.einsum("nji,nj->ni", rotation, ray)
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    centre = block.poses[image, :3]
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    off = []
    ground = block.ground.set_index("point")[["x", "y", "z"]]
    for point, rows in marks.groupby("point", observed=True).indices.items():
        if point in ground.index and len(rows) > 1:
            place = ground.loc[point].to_numpy(float)
            # Of an angle, so nearer cameras count for more.
            weighed = across[rows] / np.sum((place - centre[rows]) ** 2, axis=1)[:, None, None]
            right = np.einsum("nij,nj->i", weighed, centre[rows])
            off.append(np.linalg.solve(weighed.sum(axis=0), right) - place)
    off = 100 * np.array(off)
    horizontal = np.sqrt(np.mean((off[:, :2] ** 2).sum(axis=1)))
    return np.array([off[:, 2].mean(), off[:, 2].std(ddof=1), horizontal])


def _of(result):
    return 100 * np.array([result.check_mean.z, result.check_std.z, result.check_rms.xy])


def _errors(adjustment: Adjustment, laid) -> np.ndarray:
    ground = adjustment.start.ground.set_index("point")[["x", "y", "z"]]
    found = adjustment.points[adjustment.points["kind"] == "mark"].set_index("point")
    found = found.loc[[name for name in ground.index if name in found.index], ["x", "y", "z"]]
    off = 100 * (laid(found.to_numpy()) - ground.loc[found.index].to_numpy())
    horizontal = np.sqrt(np.mean((off[:, :2] ** 2).sum(axis=1)))
    return np.array([off[:, 2].mean(), off[:, 2].std(ddof=1), horizontal])
