"""How fast each camera turned while it was read: from a gyroscope's record."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from corridor.core.block import RATES, Block
from corridor.core.errors import InputError
from corridor.core.preparation import times

# Gyroscope x forward, y right, z down; camera x right, y down (back in the picture), z forward,
# with the top of the picture towards the front: how data/sequoia has it.
FORWARD_RIGHT_DOWN = ((0, 1, 0), (-1, 0, 0), (0, 0, 1))


def rates_from_gyro(
    block: Block,
    gyro: pd.DataFrame,
    axes: Sequence[Sequence[float]] = FORWARD_RIGHT_DOWN,
    readout_s: float | None = None,
) -> Block:
    """The block with rates.csv made from a gyroscope's record of each image.

    gyro: image (name, a folder before it is left aside), after_first_row_s (s since the first row
    began, as the record's own clock has it), gyro_x, gyro_y, gyro_z (rad/s, the gyroscope's axes).
    axes: (3, 3) from the gyroscope's axes to the camera's (x right, y down, z forward).
    readout_s: first to last row; default: readout_s of each image's camera in block.toml. The
    middle row is at the image's time_s, so the record starts half a readout before it.

    How much later the record is than its time stamps say is not known here: it is the delay of the
    effect that rates.csv serves. Raises InputError for missing columns, images and readouts, and
    for axes that are no rotation.
    """
    turn = np.asarray(axes, dtype=float)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3):
        raise InputError("the axes of a gyroscope are a 3 x 3 rotation to the camera's axes")
    if np.linalg.det(turn) < 0:
        raise InputError(
            "the axes of a gyroscope are right-handed: a mirror image is not a rotation"
        )
    needed = ("image", "after_first_row_s", "gyro_x", "gyro_y", "gyro_z")
    lacking = [name for name in needed if name not in gyro]
    if lacking:
        raise InputError(f"the gyroscope's table has no column {lacking[0]}: it needs {needed}")
    name = gyro["image"].astype(str).str.replace(r"^.*[/\\]", "", regex=True)
    at = pd.Index(block.images["image"]).get_indexer(name)
    if not (at >= 0).any():
        raise InputError(
            f"the gyroscope's table names {name.iloc[0]}, images.csv "
            f"{block.images['image'].iloc[0]}: no image has a record, correct the names"
        )
    gyro, name, at = gyro[at >= 0], name[at >= 0], at[at >= 0]
    stated = [block.cameras[camera].readout_s for camera in block.images["camera"]]
    readout = np.array([np.nan if s is None else s for s in stated], dtype=float)
    if readout_s is not None:
        readout[:] = readout_s
    if np.isnan(readout[at]).any():
        raise InputError("block.toml states no readout_s: give readout_s, or add it to the camera")
    rate = gyro[["gyro_x", "gyro_y", "gyro_z"]].to_numpy(float) @ turn.T
    time = times(block)[at] - readout[at] / 2 + gyro["after_first_row_s"].to_numpy(float)
    rates = dict(zip(RATES, rate.T, strict=True))
    table = pd.DataFrame({"time_s": time, **rates, "image": name.to_numpy()})
    made = block.with_(rates=table)
    made.check()
    return made
