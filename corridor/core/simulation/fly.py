"""Where the camera is at each exposure of a plan."""

import zlib
from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.block import QUATERNION
from corridor.core.brief import brief
from corridor.core.camera import Camera, undistort
from corridor.core.errors import InputError
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.core.simulation.axis import Axis
from corridor.core.simulation.ground_points import check_every
from corridor.core.simulation.plan import Flight, Plan

MOST_IMAGES = 1_000_000
# A ray flatter than this meets the ground too far away to be of use.
_FLATTEST_DEG = 84.5
# Overlap of a flight that states none.
_FORWARD = 0.8


@brief
@dataclass
class Strips:
    """The strips of one flight: how many images, how far apart, from where to where.

    count (k,), base (k,) m, offset (k,) m to the right of the axis, first (k,) and length (k,) m
    along the axis; speed_m_s in calm air.
    """

    count: np.ndarray
    base: np.ndarray
    offset: np.ndarray
    first: np.ndarray
    length: np.ndarray
    speed_m_s: float


@brief
@dataclass
class Flown:
    """Images in the order of exposure: the table of the block and what the geometry needs.

    centre (m, 3), rotation (m, 3, 3) world to camera; flight, camera (m,) indices; station,
    offset (m,) along and to the right of the axis; antenna (m, 3); leads (m,): whether it is no
    member of a rig but its base, or alone.
    """

    table: pd.DataFrame
    cameras: list[Camera]
    camera: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    station: np.ndarray
    antenna: np.ndarray
    leads: np.ndarray


def border_rays(camera: Camera, count: int = 9) -> np.ndarray:
    """Rays (n, 2) to pixels around the border of the picture. Raises InputError where it folds."""
    x, y = np.linspace(0, camera.width - 1, count), np.linspace(0, camera.height - 1, count)
    sides = [(x, x * 0), (x, x * 0 + y[-1]), (y * 0, y), (y * 0 + x[-1], y)]
    rays = undistort(np.concatenate([np.column_stack(s) for s in sides]), camera.interior)
    if not np.isfinite(rays).all():
        raise InputError(
            f"camera {camera.name}: its distortion folds inside the picture, nothing can be "
            "projected there: check its coefficients, and that it ends before 90 degrees"
        )
    return rays


def ground_width(camera: Camera, long_side: str) -> np.ndarray:
    """Width of a picture along and across the flight, metres on the ground per metre of height."""
    rays = border_rays(camera)
    # From the middle of each side: in a fisheye's corners the ground may have no end.
    rays = rays[4::9] if camera.fisheye else rays
    return np.ptp(rays, axis=0)[:: -1 if long_side == "across" else 1]


def strips_of(flight: Flight, camera: Camera, axis: Axis) -> Strips:
    """The strips of a flight. Raises InputError where it would see nothing twice."""
    heights = flight.heights
    width = ground_width(camera, flight.long_side)
    begin, end = flight.stations_m or (0.0, axis.length)
    if not end > begin:
        raise InputError(f"flight {flight.name}: stations_m = [{begin:g}, {end:g}] has no length")
    forward, speed, interval = flight.forward, flight.speed_m_s, flight.interval_s
    if forward is not None or (speed is None and flight.images is None):
        base = (1 - (_FORWARD if forward is None else forward)) * width[0] * heights
        if speed is not None:
            interval = float(base.mean() / speed)
    elif speed is not None:
        interval = 2.5 if interval is None else interval
        base = np.full(flight.strips, speed * interval)
    else:
        base = None
    interval = 2.5 if interval is None else interval

    if (flight.images or 0) > MOST_IMAGES:
        raise InputError(_too_many(flight.name, flight.images or 0))
    if base is None:
        count = share_out(flight.images or 0, np.ones(flight.strips))
        length = np.full(flight.strips, end - begin)
        base = length / (count - 1)
    elif flight.images is not None:
        count = share_out(flight.images, 1 / base)
        length = (count - 1) * base
        if forward is not None:
            # All strips are as long as the longest, so that their ends lie side by side.
            length = np.full(flight.strips, float(np.max(length)))
            base = length / np.maximum(count - 1, 1)
    else:
        if np.sum((end - begin) / base) > MOST_IMAGES:
            raise InputError(_too_many(flight.name, np.sum((end - begin) / base)))
        count = np.ceil((end - begin) / base - 1e-9).astype(int) + 1
        length = np.full(flight.strips, end - begin)
        base = length / (count - 1)
    if np.any(count < 2):
        raise InputError(
            f"flight {flight.name}: of {flight.images} images only {count.min()} fall to strip "
            f"{count.argmin() + 1}: give more images"
        )
    seen = width[0] * heights
    if flight.strips == 1 and base[0] > 0.5 * seen[0]:
        raise InputError(
            f"flight {flight.name}: one strip with {base[0]:.1f} m between exposures and pictures "
            f"{seen[0]:.1f} m long sees points only once: give forward = 0.5 or more"
        )
    spacing = (1 - flight.side) * width[1] * heights.mean()
    offset = (np.arange(flight.strips) - (flight.strips - 1) / 2) * spacing
    if flight.offsets_m is not None:
        offset = np.array(flight.offsets_m, dtype=float)
    # Whole numbers of images stretch the bases a little; a speed that is given is kept.
    speed = float(base.mean()) / interval if speed is None else speed
    return Strips(count, base, offset, (begin + end - length) / 2, length, speed)


def bank_of(plan: Plan) -> float:
    """Distance (m) of the surveyed banks from the axis."""
    if plan.ground.offset_m is not None:
        return plan.ground.offset_m
    lowest = min(f.heights.min() for f in plan.flights)
    return 0.3 * lowest * min(ground_width(plan.camera(f), f.long_side)[1] for f in plan.flights)


def check_plan(plan: Plan, highest: float) -> int:
    """Number of images of a plan; InputError for one that cannot be flown, before it is.

    highest: of the ground, metres.
    """
    total = 0
    shown = min(
        ground_width(plan.camera(f), f.long_side)[0] * f.heights.min() for f in plan.flights
    )
    for flight in plan.flights:
        camera, axis = plan.camera(flight), plan.axis_of(flight)
        if axis.length < (1 - _FORWARD) * shown:
            raise InputError(
                f"flight {flight.name}: the axis is {axis.length:.3g} m long, and pictures show "
                f"{shown:.3g} m: axis_m is in metres, not in degrees or kilometres"
            )
        if 2 * plan.tie_points.border_px >= min(camera.width, camera.height) - 1:
            raise InputError(
                f"tie_points: border_px = {plan.tie_points.border_px:g} leaves nothing of "
                f"{camera.width} x {camera.height} px: lower it"
            )
        strips = strips_of(flight, camera, axis)
        total += int(strips.count.sum())
        check_every(plan.ground, float(strips.length.max()))
        low = flight.heights.min() - 4 * flight.position_jitter_m
        if low <= highest - plan.terrain.level_m:
            raise InputError(
                f"flight {flight.name} sees nothing: its lowest strip, down to {low:g} m above the "
                f"plain with its jitter, is not clear of ground that reaches "
                f"{highest - plan.terrain.level_m:.1f} m: raise height_m or lower relief_m"
            )
        ahead = flight.look != "sideways"
        vertical = ahead == (flight.long_side == "across")
        angle = np.degrees(np.arctan(np.abs(border_rays(camera)).max(axis=0)))[int(vertical)]
        shake = 3 * float(np.max(flight.attitude_jitter_deg))
        if flight.tilt_deg + angle + shake > _FLATTEST_DEG:
            raise InputError(
                f"flight {flight.name} looks past the horizon: tilt_deg = {flight.tilt_deg:g}, "
                f"half a picture of {angle:.0f} and a jitter of {shake:g} degrees are more than "
                f"{_FLATTEST_DEG:g}: lower tilt_deg"
            )
        if abs(flight.wind_m_s) >= strips.speed_m_s:
            raise InputError(
                f"flight {flight.name}: a wind of {flight.wind_m_s:g} m/s stops a drone that flies "
                f"{strips.speed_m_s:.2f} m/s: lower wind_m_s or interval_s"
            )
    if total > MOST_IMAGES:
        raise InputError(_too_many(None, total))
    return total


def _too_many(flight: str | None, images: float) -> str:
    who = "the plan" if flight is None else f"flight {flight}"
    return (
        f"{who} has {images:.3g} images, more than {MOST_IMAGES:.0e}: fly a shorter corridor, "
        "fewer strips or less overlap"
    )


def fly(plan: Plan, seed: int) -> Flown:
    """The images of a plan with their true poses, times, velocities and temperatures.

    A flight's draws follow from the seed and its name alone: it is the same in any company.
    """
    clock, strip_count, parts = None, 0, []
    names = list(dict.fromkeys(flight.camera for flight in plan.flights))
    for flight in plan.flights:
        begin = flight.start_s
        if begin is None:
            begin = 0.0 if clock is None else clock + flight.pause_s
        part = _one(flight, plan, seed, begin, strip_count)
        clock = part["time_s"][-1]
        strip_count += flight.strips
        parts.append(part)
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    joined = _with_members(joined, plan)
    quaternion = quaternion_from_rotation(joined["rotation"])
    # Through the quaternion, so that the projection sees the very rotation that is stored.
    rotation = rotation_from_quaternion(quaternion)
    arm = joined["arm"]
    hung = [name for base in names for name in plan.members(base)]
    table = {
        "image": pd.Index(joined["image"], dtype="str"),
        "camera": joined["camera"].tolist(),
        "flight": joined["flight"].tolist(),
        **({"exposure": joined["exposure"].tolist()} if plan.rig else {}),
        "strip": joined["strip"].tolist(),
        "time_s": joined["time_s"],
        "temperature_c": joined["temperature_c"],
        **dict(zip("xyz", joined["centre"].T, strict=True)),
        **dict(zip(QUATERNION, quaternion.T, strict=True)),
        **dict(zip(("vx", "vy", "vz"), joined["velocity"].T, strict=True)),
        **dict(zip(("wx", "wy", "wz"), joined["rate"].T, strict=True)),
    }
    return Flown(
        table=pd.DataFrame(table),
        cameras=[plan.camera(next(f for f in plan.flights if f.camera == n)) for n in names]
        + [plan.cameras[n] for n in hung],
        camera=np.array([(names + hung).index(n) for n in joined["camera"]], dtype=np.int64),
        centre=joined["centre"],
        rotation=rotation,
        station=joined["station"],
        antenna=joined["centre"] + np.einsum("nij,ni->nj", rotation, arm),
        leads=joined["leads"],
    )


def _with_members(joined: dict, plan: Plan) -> dict:
    """The images of members after that of their base, exposure by exposure."""
    count = len(joined["image"])
    joined = {**joined, "exposure": joined["image"], "leads": np.ones(count, dtype=bool)}
    parts, order = [joined], [np.arange(count) * 1.0]
    for base in dict.fromkeys(joined["camera"].tolist()):
        mine = np.flatnonzero(joined["camera"] == base)
        for k, (camera, hangs) in enumerate(plan.members(base).items()):
            part = {key: values[mine] for key, values in joined.items()}
            names = [f"{camera}_{image}" for image in part["image"]]
            to_world = part["rotation"].transpose(0, 2, 1)
            part |= {
                "image": np.array(names),
                "camera": np.full(len(mine), camera),
                "centre": part["centre"] + to_world @ hangs.place,
                "rotation": hangs.rotation @ part["rotation"],
                "rate": part["rate"] @ hangs.rotation.T,
                "leads": np.zeros(len(mine), dtype=bool),
            }
            parts.append(part)
            order.append(mine + (k + 1) / 1000)
    sort = np.argsort(np.concatenate(order), kind="stable")
    return {key: np.concatenate([part[key] for part in parts])[sort] for key in joined}


def _one(flight: Flight, plan: Plan, seed: int, begin: float, before: int) -> dict:
    """The images of one flight."""
    axis = plan.axis_of(flight)
    strips = strips_of(flight, plan.camera(flight), axis)
    children = np.random.SeedSequence([seed, zlib.crc32(flight.name.encode())]).spawn(3)
    draw = [np.random.default_rng(child) for child in children]
    strip = np.repeat(np.arange(flight.strips), strips.count)
    number = np.concatenate([np.arange(n) for n in strips.count])
    images = len(strip)
    back = (strip % 2 == 1) & (flight.direction == "alternating")
    done = number * strips.base[strip]
    station = strips.first[strip] + np.where(back, strips.length[strip] - done, done)
    ahead = np.where(back, -1.0, 1.0)
    speed = strips.speed_m_s + flight.wind_m_s * ahead
    # Between strips of other heights the speed is kept and the interval follows.
    gap = np.where(number == 0, flight.turn_s, strips.base[strip] / speed)
    gap[0] = 0.0
    time = np.round(begin + np.cumsum(gap), 6)

    position, tangent = axis.at(station)
    right = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    offset = strips.offset[strip]
    centre = np.empty((images, 3))
    centre[:, :2] = position + offset[:, None] * right
    centre[:, 2] = plan.terrain.level_m + flight.heights[strip]
    centre += flight.position_jitter_m * draw[0].standard_normal((images, 3))

    up = np.array([0.0, 0.0, 1.0])
    facing = np.where(back & (flight.heading == "turned"), -1.0, 1.0)
    nose = np.column_stack([facing[:, None] * tangent, np.zeros(images)])
    wing = np.cross(nose, up)
    down = np.broadcast_to(-up, nose.shape)
    axes = (wing, -nose, down) if flight.long_side == "across" else (nose, wing, down)
    rotation = np.stack(axes, axis=1)
    towards = {
        "forward": nose,
        "sideways": np.where(
            (np.abs(offset) > 1e-9)[:, None],
            -np.sign(offset)[:, None] * np.column_stack([right, np.zeros(images)]),
            wing,
        ),
        "alternating": np.where(number[:, None] % 2 == 0, nose, -nose),
    }[flight.look]
    tilt = np.radians(flight.tilt_deg) * np.cross(down, towards)
    sigma = np.radians(np.broadcast_to(flight.attitude_jitter_deg, 3))
    shake = sigma * draw[1].standard_normal((images, 3))
    shake = shake[:, :1] * nose + shake[:, 1:2] * wing + shake[:, 2:] * down
    turn = rotation_from_vector(shake) @ rotation_from_vector(tilt)
    rotation = rotation @ turn.transpose(0, 2, 1)

    velocity = np.column_stack([(ahead * speed)[:, None] * tangent, np.zeros(images)])
    velocity += flight.velocity_jitter_m_s * draw[2].standard_normal((images, 3))
    rate = np.radians(flight.angular_rate_deg_s) * draw[2].standard_normal((images, 3))
    warm = flight.warming_c * (1 - np.exp(-(time - begin) / 600.0))
    if flight.axis_m is not None:
        station = plan.axis.nearest(position + offset[:, None] * right)
    digits = max(4, len(str(images)))
    return {
        "image": np.array([f"{flight.name}_{k + 1:0{digits}d}.tif" for k in range(images)]),
        "camera": np.full(images, flight.camera),
        "flight": np.full(images, flight.name),
        "strip": (before + strip + 1).astype(str),
        "time_s": time,
        "temperature_c": np.round(flight.temperature_c + warm, 3),
        "centre": centre,
        "rotation": rotation,
        "velocity": velocity,
        "rate": rate,
        "station": station,
        "arm": np.tile(flight.lever_arm_m, (images, 1)),
    }


def share_out(count: int, share: np.ndarray) -> np.ndarray:
    """Whole numbers (n,) that add up to count, as near to the shares as can be."""
    ideal = np.cumsum(share / share.sum() * count)
    return np.diff(np.concatenate([[0], np.round(ideal + 1e-9)])).astype(int)
