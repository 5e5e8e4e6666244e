"""attitudes.csv from photographs: what the gimbal, or the body, says of each picture's direction.

How good they are nobody writes: the poses of the project say it, once the mean turn of each flight,
its boresight, is taken away.
"""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from corridor.core.block import level_axes
from corridor.core.errors import InputError
from corridor.core.geometry import (
    quaternion_from_rotation,
    robust_scale,
    rotation_from_quaternion,
    vector_from_rotation,
)
from corridor.core.photographs import Metadata
from corridor.core.preparation import AGREES, CONTRADICTS, UNCHECKED, Witness
from corridor.tools.formats.heading import headings
from corridor.tools.formats.placing import has_north
from corridor.tools.formats.project import Project
from corridor.tools.formats.starting import rotations_of

# Attitudes that miss the poses by more say nothing; none is better than metadata print it. degrees.
_WORST, _BEST, _FEWEST = 10.0, 0.02, 4


def with_attitudes(project: Project, photos: dict[int, Metadata]) -> Project:
    """The project with the attitudes of its photographs, by row of images.csv.

    Raises InputError where they state none that can be used, or the project has no north.
    """
    block = project.block
    rows = np.array(sorted(photos), dtype=int)
    said = [photos[row] for row in rows]
    turned = rotations_of(said)
    known = np.isfinite(turned).all(axis=(1, 2))
    if known.sum() < _FEWEST or not (has_north(project) or project.placed):
        raise InputError(
            "--attitudes: the photographs state no yaw, pitch and roll that can be used, or the "
            "project has no place on Earth; leave --attitudes out"
        )
    rows, turned = rows[known], turned[known]
    table = pd.DataFrame({"image": block.images["image"].to_numpy()[rows]})
    table[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(turned)
    left = _left(turned, block.poses[rows, 3:], block.image_flight[rows])
    witnesses, sigma, source = [*headings(said).witnesses], None, "the poses"
    if len(left) < _FEWEST:
        witnesses.append(Witness(source, UNCHECKED, "there are none"))
    else:
        sigma = np.maximum([robust_scale(axis) for axis in left.T], _BEST).round(2)
        text = "off by {:g}, {:g}, {:g} degrees (roll, pitch, yaw; 1 sigma)".format(*sigma)
        if sigma.max() > _WORST:
            return project.warned(f"attitudes of the photographs were left out: {text}")
        table[["sroll", "spitch", "syaw"]] = sigma
        witnesses.append(Witness(source, AGREES, text))
    doubt = any(one.says == CONTRADICTS for one in witnesses)
    told = f"attitudes of {len(table)} of {len(block.images)} images are those of the photographs"
    project = project.having(notes=[told], attitudes=table)
    project = project.deriving("attitudes", "the photographs", sigma, told, "degrees", witnesses)
    return project.warned(f"{told}, which others contradict: see import.html") if doubt else project


def _left(turned: np.ndarray, pose: np.ndarray, flight: np.ndarray) -> np.ndarray:
    """Degrees (n, 3) about level axes between attitudes and poses that are known, less the
    boresight of each flight."""
    posed = np.isfinite(pose).all(axis=1)
    turned, flight = turned[posed], flight[posed]
    stood = rotation_from_quaternion(pose[posed])
    out = np.zeros((len(turned), 3))
    for one in np.unique(flight):
        mine = flight == one
        off = turned[mine] @ stood[mine].transpose(0, 2, 1)
        mean = Rotation.from_matrix(off).mean().as_matrix()
        out[mine] = np.degrees(vector_from_rotation(off @ mean.T))
    level = level_axes(turned) @ turned.transpose(0, 2, 1)
    return np.einsum("nij,nj->ni", level, out)
