"""Images whose measurements are turned in their picture against their start poses.

Viewers turn photographs and write them back; a flight direction is taken for that of the way back.
Of an image turned by an angle a, the measured points z = x + i y lie as rays w = u + i v of the
start poses do, turned: a is the argument of the sum of z conj(w) about their means.

Source: the least-squares rotation in a plane (Helmert; Umeyama 1991, in two dimensions).
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from corridor.core.block import POSE, Block
from corridor.core.errors import some
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.output import counted

# Start poses are rough, and no attitude of a gimbal or of a course is off by so much.
_TURNED_DEG = 45.0
# Measured points lie as the start poses say, but for that turn, relief and rough start values.
_ALIKE = 0.9
# Points of an image that are looked at, at least and about as many at most.
LEAST, _ENOUGH = 6, 20
# More images than this share, and nobody knows which ones are right.
_MOST = 0.4
_NAMED = 5


class AsPosed(NamedTuple):
    """Image points whose pose and point have start values, the point ahead of the camera.

    image (n,); pixel (n, 2), measured; ray (n, 2): where the start values put it, at unit focal
    length. row (n,): in the table.
    """

    image: np.ndarray
    pixel: np.ndarray
    ray: np.ndarray
    row: np.ndarray


def as_posed(
    block: Block, table: str, step: int = 1, meant: Callable[[np.ndarray], np.ndarray] = np.copy
) -> AsPosed:
    """Of the image points of a table every so-many-th; meant: of quaternions (n, 4) those that
    count in their place."""
    rows = getattr(block, table)
    image = block.image_rows(table)[::step]
    pose, point = block.poses[image], block.positions(table)[rows["point"].array.codes[::step]]
    known = np.flatnonzero(np.isfinite(pose).all(axis=1) & np.isfinite(point).all(axis=1))
    pose, away = pose[known], point[known] - pose[known, :3]
    seen = np.einsum("nij,nj->ni", rotation_from_quaternion(meant(pose[:, 3:])), away)
    ahead = seen[:, 2] > 0
    known, seen = known[ahead], seen[ahead]
    pixel = np.stack([rows[axis].to_numpy(float)[::step][known] for axis in "xy"], axis=1)
    return AsPosed(image[known], pixel, seen[:, :2] / seen[:, 2:], known * step)


def sampled(block: Block) -> int:
    """Every how manieth tie point is looked at."""
    return max(len(block.tie_points) // max(_ENOUGH * len(block.images), 1), 1)


def turned_by(block: Block) -> np.ndarray:
    """Angle (images,), degrees, by which the measurements of each image are turned in its picture
    against its start pose, clockwise as seen; 0 where by less than that of any rough start, or
    where start values do not tell."""
    count = len(block.images)
    out = np.zeros(count)
    image, *both, _ = as_posed(block, "tie_points", sampled(block))
    z, w = (xy[:, 0] + 1j * xy[:, 1] for xy in both)
    number = np.bincount(image, minlength=count)
    z, w = (one - (_sums(image, one, count) / np.maximum(number, 1))[image] for one in (z, w))
    across = _sums(image, z * w.conj(), count)
    length = np.sqrt(_sums(image, np.abs(z) ** 2, count) * _sums(image, np.abs(w) ** 2, count))
    clear = (number >= LEAST) & (np.abs(across) > _ALIKE * length.real)
    angle = np.degrees(np.angle(across))
    far = clear & (np.abs(angle) > _TURNED_DEG)
    if far.sum() <= _MOST * clear.sum():
        out[far] = angle[far]
    return out


def _sums(image: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    real, imaginary = (np.bincount(image, part, count) for part in (values.real, values.imag))
    return real + 1j * imaginary


def turned_images(block: Block) -> Iterator[str]:
    """Sentences on images that are turned, those of about one angle together."""
    angle = turned_by(block)
    names = block.images["image"].to_numpy(dtype=object)
    quarter = quarters_of(angle)
    for turn in (2, 1, 3):
        mine = np.flatnonzero((angle != 0.0) & (quarter == turn))
        if not len(mine):
            continue
        degrees = {1: "90 degrees clockwise", 2: "180 degrees", 3: "90 degrees anticlockwise"}[turn]
        shown = some([str(names[k]) for k in mine], _NAMED)
        yield (
            f"Measurements of {counted(len(mine), 'image')} ({shown}) lie turned by about "
            f"{degrees} in the picture against the start pose: pictures turned by a viewer, or a "
            "wrong yaw in images.csv?"
        )


def without_starts(block: Block, images: np.ndarray) -> Block:
    """The block without the start poses of some images (images,)."""
    block, pose = block.copy(), block.poses.copy()
    pose[images] = np.nan
    block.put("images", POSE, pose)
    return block


def turned_back(block: Block, turned: np.ndarray) -> Block:
    """The block with measurements turned back by quarters of a turn (images,), 1 to 3 clockwise, as
    a viewer has turned the pictures."""
    block = block.copy()
    size = np.array([[camera.width, camera.height] for camera in block.cameras.values()], float)
    size = size[block.image_camera]
    for table in ("tie_points", "marks"):
        image = block.image_rows(table)
        quarters = np.where(image >= 0, turned[image], 0)
        xy = block.numbers(table, "x", "y")
        for turn in (1, 2, 3):
            mine = quarters == turn
            middle = (size[image[mine]] - 1.0) / 2.0
            away = xy[mine] - (middle if turn == 2 else middle[:, ::-1])
            # A point at x + i y has come to i^turn times that, y being downwards.
            back = (away[:, 0] + 1j * away[:, 1]) * 1j ** (-turn)
            xy[mine] = middle + np.stack([back.real, back.imag], axis=1)
        block.put(table, ("x", "y"), xy)
    return block


def quarters_of(angle: np.ndarray) -> np.ndarray:
    """Quarters of a turn (images,), 0 to 3, of angles, degrees."""
    return np.round(angle / 90.0).astype(int) % 4
