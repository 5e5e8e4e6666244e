"""What is probably a mistake in [rig.NAME]: mountings that the start poses contradict."""

from collections.abc import Iterator

import numpy as np

from corridor.core.block import Block, mountings_of, rigs_of, seen_together
from corridor.core.geometry import (
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
    vector_from_rotation,
)

# By so many times their scatter and the stated sigma start poses and a mounting differ for good.
_MANY = 10.0
_FEWEST = 3


def rig_warnings(block: Block) -> Iterator[str]:
    """Members that no exposure shows, and mountings that the start poses contradict."""
    for name, rig in rigs_of(block).items():
        for camera, table in rig["member"].items():
            where = f"block.toml: [rig.{name}.member.{camera}]"
            if not block.has("rig.member"):
                yield (
                    f"{where} binds nothing: images that were taken together have the same text in "
                    "the column exposure of images.csv, and none has."
                )
                return
            if "xyz" in table:
                place, turned = seen_together(block, rig["base"], camera)
                yield from _contradicted(block, camera, where, place, turned)


def _contradicted(block, camera, where, place, turned) -> Iterator[str]:
    if len(place) < _FEWEST:
        return
    stated = mountings_of(block)[camera]
    mean, middle = nearest_rotation(turned.sum(axis=0)), np.median(place, axis=0)
    spread = np.median(np.linalg.norm(place - middle, axis=1)), np.median(_angle(turned, mean))
    known = np.where(np.isfinite(stated.sigma), stated.sigma, 0.0)
    limits = [
        _MANY * (a + np.linalg.norm(b)) + 1e-3
        for a, b in zip(spread, (known[:3], known[3:]), strict=True)
    ]
    off = float(np.linalg.norm(stated.place - middle))
    angle = float(_angle(stated.rotation[None], mean)[0])
    if np.isfinite(stated.sigma[3:]).all() and angle > limits[1]:
        w, x, y, z = quaternion_from_rotation(stated.rotation)
        others = {
            "does it go from the member to the base? It has to go the other way": (w, -x, -y, -z),
            "is qw the last of its four numbers? It has to be the first": (z, w, x, y),
        }
        left = _angle(rotation_from_quaternion(np.array(list(others.values()))), mean)
        told = "are the column exposure and the names of the cameras right?"
        if left.min() < angle / _MANY:
            told = list(others)[int(left.argmin())]
        yield (
            f"{where}: the start poses see it turned by {np.degrees(angle):.3g} degrees against "
            f"its quaternion: {told}"
        )
    elif np.isfinite(stated.sigma[:3]).all() and off > limits[0]:
        yield (
            f"{where}: the start poses put it {off:.3g} m from its xyz: is the column exposure "
            "right, and are these metres, right, down and forward of the base camera?"
        )


def _angle(turned: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Angles (n,), rad, from one rotation."""
    return np.linalg.norm(vector_from_rotation(turned @ mean.T), axis=1)
