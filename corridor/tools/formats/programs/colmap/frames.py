"""Rigs and frames that are written into a COLMAP model: those of the block, or each camera alone.

Source: COLMAP documentation, format.rst (since 3.12): a rig has its reference sensor and the poses
of the others in it, a frame the pose of the rig at one exposure.
"""

from pathlib import Path

import numpy as np

from corridor.core.block import Block
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.tools.formats.hanging import Hanging


def write_rigs(block: Block, folder: Path, file, records, numbers: dict[str, int]) -> None:
    """Write the files rigs and frames. numbers: of the cameras; file, records: of the form."""
    hanging = Hanging.of(block)
    rotation = rotation_from_quaternion(hanging.pose[:, 3:])
    shift = -np.einsum("nij,nj->ni", rotation, hanging.pose[:, :3])
    rigs = {key: [] for key in numbers if hanging.base[key] == key}
    for key in hanging.members():
        rigs[hanging.base[key]].append(key)
    with file(folder, "rigs", len(rigs)) as out:
        for key, others in rigs.items():
            out.put(records.RIG, numbers[key], 1 + len(others))
            out.put(records.SENSOR, 0, numbers[key])
            for other in others:
                turn = hanging.mounted[other].rotation
                quaternion = quaternion_from_rotation(turn[None])[0]
                out.put(records.OTHER_SENSOR, 0, numbers[other], 1)
                out.put(records.POSE, *quaternion, *(-turn @ hanging.mounted[other].place))
            out.end()
    cameras = block.images["camera"].tolist()
    frames = hanging.frames()
    with file(folder, "frames", len(frames)) as out:
        for k, rows in enumerate(frames):
            pose = *hanging.pose[rows[0], 3:], *shift[rows[0]]
            out.put(records.FRAME, k + 1, numbers[hanging.base[cameras[rows[0]]]], *pose, len(rows))
            for row in rows:
                out.put(records.DATA, 0, numbers[cameras[row]], row + 1)
            out.end()
