"""Photographs whose pixels a viewer has turned: their yaw contradicts the poses by 180 degrees.

A viewer that turns a picture rewrites its pixels and leaves XMP as it was. In the adjustment such
pictures lie the wrong way round in the camera, and focal length and distortion go wrong with them.
What was mapped here from the photographs alone is turned back. The measurements of another
program's project stay as they are: it will meet the same pictures again.
"""

from __future__ import annotations

import numpy as np

from corridor.core.block import POSE
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.photographs import Metadata
from corridor.tools.formats.project import Project

# This near to 0 or 180 degrees counts; so many must be, or the yaws tell nothing.
_NEAR_DEG, _ENOUGH, _LEAST = 30.0, 0.8, 4
# A picture's top points up into the sky from here on, and has no direction on the ground.
_FLAT = 0.2
_TRIED = 300
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])


def with_turned(project: Project, photos: dict[int, Metadata]) -> Project:
    """The project with a sentence that names the photographs turned by 180 degrees, if any.

    Of a project from the photographs alone they are turned back. photos: by row of images.csv.
    Says nothing where most are turned: a camera may be mounted so.
    """
    pose = project.block.poses
    rows = [row for row, photo in photos.items() if said_yaw(photo) is not None]
    rows = np.array([row for row in rows if np.isfinite(pose[row]).all()], dtype=int)
    if not len(rows):
        return project
    seen = yaw_of(rotation_from_quaternion(pose[rows, 3:]))
    said = np.array([said_yaw(photos[row]) for row in rows])
    turned = upside_down(seen, said)
    if not turned.any():
        return project
    mine = [photos[row] for row in rows[turned]]
    tools = {photo.tags.get("CreatorTool", "") for photo in mine} - {""}
    others = {photos[row].tags.get("CreatorTool", "") for row in rows[~turned]}
    # It speaks only where the others were not saved by it.
    by = f" ({', '.join(sorted(tools))} saved them)" if tools and not tools & others else ""
    names = [photo.name for photo in photos.values()]
    said = (
        f"{len(mine)} of {len(rows)} photographs are turned by 180 degrees against their own "
        f"yaw in the metadata: {_listed([photo.name for photo in mine], names)}; a viewer has "
        f"turned their pixels{by}"
    )
    if project.form != "photos":
        return project.having(
            warnings=[
                f"{said}: take the originals, or turn them back by 180 degrees, and import again; "
                "as they are, focal length and distortion are wrong"
            ]
        )
    return _turned_back(project, rows[turned]).having(
        notes=[f"{said}: their measurements were turned back; the files stay as they are"]
    )


def _turned_back(project: Project, rows: np.ndarray) -> Project:
    """The project with these images the other way round in the camera: poses and measurements.

    The mapping's camera is the same after half a turn about its axis (its principal point is the
    middle of the picture), so that all residuals stay; what an adjustment adds to it is not.
    """
    block, images = project.block, project.block.images.copy()
    pose = _HALF_TURN @ rotation_from_quaternion(block.poses[rows, 3:])
    images.loc[images.index[rows], list(POSE[3:])] = quaternion_from_rotation(pose)
    names = images["image"].iloc[rows]
    last = {
        name: (block.cameras[camera].width - 1, block.cameras[camera].height - 1)
        for name, camera in zip(names, images["camera"].iloc[rows], strict=True)
    }
    measured = {name: getattr(block, name) for name in ("tie_points", "marks")}
    for name, table in measured.items():
        mine = table["image"].isin(last).to_numpy()
        far = np.array([last[image] for image in table["image"][mine]]).reshape(-1, 2)
        pixels = table[["x", "y"]].to_numpy(float, copy=True)
        pixels[mine] = far - pixels[mine]
        measured[name] = table.assign(x=pixels[:, 0], y=pixels[:, 1])
    return project.having(images=images, **measured)


def said_yaw(photo: Metadata) -> float | None:
    """Degrees from north over east to where the top of the picture points; None if not stated."""
    yaw = photo.yaw if photo.yaw is not None else photo.number("FlightYawDegree")
    if yaw is None:
        return None
    # Looking straight down, a gimbal may state the half turn as roll.
    return yaw + 180 if photo.roll is not None and abs(photo.roll) > 90 else yaw


def yaw_of(rotation: np.ndarray) -> np.ndarray:
    """Degrees (n,) from y over x to where the top of each picture points; NaN where upwards.

    rotation: (n, 3, 3), world to camera.
    """
    east, north = -rotation[:, 1, 0], -rotation[:, 1, 1]
    return np.where(np.hypot(east, north) > _FLAT, np.degrees(np.arctan2(east, north)), np.nan)


def upside_down(seen: np.ndarray, said: np.ndarray) -> np.ndarray:
    """Which images (n,) stand the other way round than the others, by their yaws in degrees.

    seen: by the poses, said: by the metadata. The block may be turned as a whole. None where fewer
    than four yaws are known, or they do not agree with the poses to 30 degrees in four of five.
    """
    off = seen - said
    known = np.isfinite(off)
    none = np.zeros(len(off), dtype=bool)
    if known.sum() < _LEAST:
        return none
    # The turn of the block, modulo 180 degrees: the median on the circle of the doubled angle.
    tried = off[known][:: max(known.sum() // _TRIED, 1)]
    away = np.abs(_wrapped(2 * (off[known][:, None] - tried)))
    off = _wrapped(off - tried[np.argmin(away.sum(axis=0))])
    upright, turned = np.abs(off) < _NEAR_DEG, np.abs(off) > 180 - _NEAR_DEG
    if turned.sum() > upright.sum():
        upright, turned = turned, upright
    if upright.sum() + turned.sum() < _ENOUGH * known.sum() or turned.sum() == upright.sum():
        return none
    return turned


def _wrapped(angle):
    """Into -180 to 180."""
    return (angle + 180) % 360 - 180


def _listed(names: list[str], order: list[str]) -> str:
    """Names with runs in the order of the photographs drawn together: A to C, F."""
    at = {name: k for k, name in enumerate(sorted(order))}
    runs: list[list[str]] = []
    for name in sorted(names):
        if runs and at[name] == at[runs[-1][-1]] + 1:
            runs[-1].append(name)
        else:
            runs.append([name])
    told = [run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    return ", ".join(told[:10]) + (", ..." if len(told) > 10 else "")
