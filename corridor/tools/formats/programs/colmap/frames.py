"""Rigs and frames that are written into a COLMAP model: those of the block, or each camera alone.

Source: COLMAP documentation, format.rst (since 3.12): a rig has its reference sensor and the poses
of the others in it, a frame the pose of the rig at one exposure.
"""

from pathlib import Path

import numpy as np

from corridor.core.block import Block, as_mounted, base_poses, exposures_of, mountings_of, rigs_of
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion


def write_rigs(block: Block, folder: Path, file, records, numbers: dict[str, int]) -> None:
    """Write the files rigs and frames. numbers: of the cameras; file, records: of the form."""
    mounted = mountings_of(block) if as_mounted(block) else {}
    first = {key: rigs_of(block)[one.rig]["base"] for key, one in mounted.items()}
    base = base_poses(block, mounted)
    rotation = rotation_from_quaternion(base[:, 3:])
    shift = -np.einsum("nij,nj->ni", rotation, base[:, :3])
    together = np.arange(len(base))
    if mounted:
        both = exposures_of(block)
        together[both.member] = both.base
    rigs = {key: [] for key in numbers if first.get(key, key) == key}
    for key in (key for key in mounted if first[key] != key):
        rigs[first[key]].append(key)
    with file(folder, "rigs", len(rigs)) as out:
        for key, others in rigs.items():
            out.put(records.RIG, numbers[key], 1 + len(others))
            out.put(records.SENSOR, 0, numbers[key])
            for other in others:
                turn = mounted[other].rotation
                quaternion = quaternion_from_rotation(turn[None])[0]
                out.put(records.OTHER_SENSOR, 0, numbers[other], 1)
                out.put(records.POSE, *quaternion, *(-turn @ mounted[other].place))
            out.end()
    cameras = block.images["camera"].tolist()
    order = np.argsort(together, kind="stable")
    frames = np.split(order, np.flatnonzero(np.diff(together[order])) + 1)
    with file(folder, "frames", len(frames)) as out:
        for k, rows in enumerate(frames):
            rig = numbers[first.get(cameras[rows[0]], cameras[rows[0]])]
            pose = *base[rows[0], 3:], *shift[rows[0]]
            out.put(records.FRAME, k + 1, rig, *pose, len(rows))
            for row in rows:
                out.put(records.DATA, 0, numbers[cameras[row]], row + 1)
            out.end()
