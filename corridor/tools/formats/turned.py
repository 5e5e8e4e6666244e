"""Photographs whose pixels a viewer has turned: their yaw contradicts the poses by 180 degrees.

A viewer that turns a picture rewrites its pixels and leaves XMP as it was. In the adjustment such
pictures lie the wrong way round in the camera, and focal length and distortion go wrong with them.
The yaw alone proves nothing: makers count it in two ways. What decides is the adjustment, as the
pictures are and turned back: the camera's principal point and distortion turn with the pictures,
and fit the strips of both directions one way only. What was mapped here from the photographs alone
is turned back. The measurements of another program's project stay as they are: it will meet the
same pictures again.
"""

from dataclasses import replace

import numpy as np

from corridor.core.adjustment import adjust
from corridor.core.block import POSE, Block
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.photographs import Metadata
from corridor.core.preparation import AGREES, CONTRADICTS, UNCHECKED, Witness, turned_back
from corridor.tools.formats.heading import (
    AGREEING_SHARE,
    LEAST_PHOTOS,
    NEAR_DEG,
    Headings,
    headings,
    turn_of,
    wrapped,
)
from corridor.tools.formats.joining import listed
from corridor.tools.formats.project import Project

# A picture's top points up into the sky from here on, and has no direction on the ground.
_FLAT = 0.2
_HALF_TURN = np.diag([-1.0, -1.0, 1.0])
# Log likelihood by which the residuals decide: a Bayes factor of e^30 of measurements thought
# independent is still one of e^6 where five of them count as one.
_DECIDES = 30.0
_MOST_OBSERVATIONS = 20_000


def with_turned(project: Project, photos: dict[int, Metadata]) -> Project:
    """The project with a sentence that names the photographs turned by 180 degrees, if any.

    Of a project from the photographs alone they are turned back, where the residuals of an
    adjustment say so as the yaw does. photos: by row of images.csv. Says nothing where most are
    turned: a camera may be mounted so.
    """
    pose = project.block.poses
    rows = np.array([row for row in photos if np.isfinite(pose[row]).all()], dtype=int)
    if not len(rows):
        return project
    seen = yaw_of(rotation_from_quaternion(pose[rows, 3:]))
    found = headings([photos[row] for row in rows], seen)
    turned = upside_down(seen, found.yaw)
    project = _recorded(project, found, seen, turned)
    if not turned.any():
        return project
    gain = _gain(project.block, rows[turned])
    names = [photo.name for photo in photos.values()]
    which = listed([photos[row].name for row in rows[turned]], names)
    many = f"{turned.sum()} of {len(rows)} photographs"
    against = f"the yaw in the metadata of {many} is 180 degrees from their poses: {which}"
    if gain is None or abs(gain) < _DECIDES:
        return project.warned(
            f"{against}; the residuals of an adjustment neither prove nor disprove that a "
            "viewer has turned their pixels, so nothing was turned: look whether these "
            "pictures stand on their heads beside the others"
        )
    if gain < 0:
        return project.noted(
            f"{against}; the residuals fit the pictures as they are: nothing was turned"
        )
    said = f"{many} are turned by 180 degrees against their own yaw in the metadata: {which}"
    tools = {photos[row].tags.get("CreatorTool", "") for row in rows[turned]} - {""}
    others = {photos[row].tags.get("CreatorTool", "") for row in rows[~turned]}
    # It speaks only where the others were not saved by it.
    by = f" ({', '.join(sorted(tools))} saved them)" if tools and not tools & others else ""
    said += (
        f", and the residuals fit decisively better so (log likelihood {gain:.0f} higher): a "
        f"viewer has turned their pixels{by}"
    )
    if project.form != "photos":
        return project.warned(
            f"{said}: take the originals, or turn them back by 180 degrees, and import again; "
            "as they are, focal length and distortion are wrong"
        )
    return _turned_back(project, rows[turned]).noted(
        f"{said}: their measurements were turned back; the files stay as they are"
    )


def _recorded(project: Project, found: Headings, seen: np.ndarray, turned: np.ndarray) -> Project:
    """The project whose block.toml says what the attitudes of its photographs are worth."""
    if not found.source and not found.witnesses:
        return project
    known = np.isfinite(found.yaw) & np.isfinite(seen)
    mapped = Witness("the mapped poses", UNCHECKED, "the yaw in the metadata is not used")
    sigma = None
    if found.source and known.sum() >= LEAST_PHOTOS:
        off = wrapped(seen[known] - found.yaw[known])
        off = wrapped(off - turn_of(off))
        off = np.minimum(np.abs(off), 180 - np.abs(off))
        says = (
            AGREES
            if not turned.any() and np.mean(off < NEAR_DEG) >= AGREEING_SHARE
            else CONTRADICTS
        )
        told = f"{turned.sum()} the other way round" if turned.any() else ""
        mapped = Witness("the mapped poses", says, told or f"to {np.median(off):.0f} degrees")
        sigma = np.radians(off)
    source = found.source or "yaws that contradict each other"
    told = f"The photographs' headings are {source}"
    frame = "degrees from north over east; sigma in rad"
    return project.deriving("heading", source, sigma, told, frame, (*found.witnesses, mapped))


def _gain(block: Block, rows: np.ndarray) -> float | None:
    """Log likelihood by which the tie points fit better with these images turned; None: unknown."""
    every = max(len(block.tie_points) // _MOST_OBSERVATIONS, 1)
    keep = block.tie_points["point"].array.codes % every == 0
    thin = replace(block, tie_points=block.tie_points[keep].reset_index(drop=True))
    project = Project("photos", None, thin)
    sizes, count = [], 0
    for one in (thin, _turned_back(project, rows).block):
        try:
            found = adjust(one, camera="fraser8")
        except (InputError, AdjustmentFailed):
            return None
        tie = found.statistics["tie"]
        if not found.converged or not tie["rms"]:
            return None
        sizes.append(float(tie["rms"]))
        count = 2 * int(tie["count"])
    return count * float(np.log(sizes[0] / sizes[1]))


def _turned_back(project: Project, rows: np.ndarray) -> Project:
    """The project with these images the other way round in the camera: poses and measurements.

    The mapping's camera is the same after half a turn about its axis (its principal point is the
    middle of the picture), so that all residuals stay; what an adjustment adds to it is not.
    """
    block = project.block
    quarters = np.zeros(len(block.images), dtype=int)
    quarters[rows] = 2
    block, pose = turned_back(block, quarters), block.poses
    turned = _HALF_TURN @ rotation_from_quaternion(pose[rows, 3:])
    pose[rows, 3:] = quaternion_from_rotation(turned)
    block.put("images", POSE[3:], pose[:, 3:])
    return replace(project, block=block)


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
    if known.sum() < LEAST_PHOTOS:
        return none
    off = wrapped(off - turn_of(off[known]))
    upright, turned = np.abs(off) < NEAR_DEG, np.abs(off) > 180 - NEAR_DEG
    if turned.sum() > upright.sum():
        upright, turned = turned, upright
    if upright.sum() + turned.sum() < AGREEING_SHARE * known.sum() or turned.sum() == upright.sum():
        return none
    return turned
