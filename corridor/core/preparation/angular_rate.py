"""How fast each camera turned: from its neighbours' attitudes."""

import numpy as np
from scipy.spatial.transform import Rotation

from corridor.core.block import RATES, Block
from corridor.core.geometry import rotation_from_quaternion
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
        for n, row in enumerate(rows):
            before, after = rows[max(n - 1, 0)], rows[min(n + 1, len(rows) - 1)]
            if time[after] > time[before]:
                # Turned by m, a camera sees exp(-m) X.
                turned = rotation[after] @ rotation[before].T
                rate[row] = -Rotation.from_matrix(turned).as_rotvec() / (time[after] - time[before])
    block = block.copy()
    block.put("images", RATES, rate)
    return block
