"""How fast each camera turned: from its neighbours' attitudes."""

import numpy as np

from corridor.core.block import RATES, Block
from corridor.core.geometry import rotation_from_quaternion, vector_from_rotation
from corridor.core.preparation.strips import track_runs
from corridor.core.preparation.velocity import times


def rates_from_neighbours(block: Block) -> Block:
    """The block with wx, wy, wz of images.csv from the attitudes of the images before and after.

    True of turns that last longer than the time between two images, such as a curve; of shaking
    these rates know nothing. Never across the end of a strip. Raises InputError without times or
    poses.
    """
    pose = block.poses
    fault = "has no pose, from which angular rates follow"
    block.demand("images", np.isfinite(pose), fault, "run `corridor adjust` first")
    time = times(block)
    rotation = rotation_from_quaternion(pose[:, 3:])
    rate = np.full((len(pose), 3), np.nan)
    for rows in track_runs(block, time, pose[:, :3], []):
        before, after = np.r_[rows[:1], rows[:-1]], np.r_[rows[1:], rows[-1:]]
        rows, before, after = (each[time[after] > time[before]] for each in (rows, before, after))
        # Turned by m, a camera sees exp(-m) X.
        turned = rotation[after] @ rotation[before].transpose(0, 2, 1)
        rate[rows] = -vector_from_rotation(turned) / (time[after] - time[before])[:, None]
    block = block.copy()
    block.put("images", RATES, rate)
    return block
