"""The modelled row, against a generator that shares no line with the package.

It finds the time at which the shutter passes each point by bisection, with its own projection and
scipy's rotations.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from strips import CAMLIGHT, corridor_block

import corridor
from corridor.core.effects import predict

READOUT = 0.030


def picture_of(block, camera, table, source, readout):
    """Pixels (n, 2) of a table's rows: where the row being read and the point's row meet."""
    images = block.images.set_index("image").loc[table["image"].astype(str)]
    points = source.set_index("point").loc[table["point"].astype(str), ["x", "y", "z"]].to_numpy()
    pose = Rotation.from_quat(images[["qx", "qy", "qz", "qw"]].to_numpy())  # world to camera
    centre, velocity, rate = (
        images[list(names)].to_numpy() for names in (("x", "y", "z"), ("vx", "vy", "vz"),
                                                     ("wx", "wy", "wz"))
    )  # fmt: skip
    axis, last, sense = {
        "down": (1, camera.height - 1, 1),
        "up": (1, camera.height - 1, -1),
        "right": (0, camera.width - 1, 1),
        "left": (0, camera.width - 1, -1),
    }[camera.row_direction]

    def at(seconds):
        """Where a global shutter would see the points that much after the middle row."""
        # The camera turns with the rate in its own frame: to world = R' Exp(w t).
        to_world = pose.inv() * Rotation.from_rotvec(rate * seconds[:, None])
        x, y, z = to_world.inv().apply(points - centre - velocity * seconds[:, None]).T
        u, v = x / z, y / z
        r2 = u**2 + v**2
        radial = 1 + camera["k1"] * r2 + camera["k2"] * r2**2 + camera["k3"] * r2**3
        p1, p2 = camera["p1"], camera["p2"]
        return np.column_stack(
            [
                camera["cx"] + camera["f"] * (u * radial + p1 * (3 * u**2 + v**2) + 2 * p2 * u * v),
                camera["cy"] + camera["f"] * (v * radial + p2 * (3 * v**2 + u**2) + 2 * p1 * u * v),
            ]
        )

    early, late = np.full(len(table), -readout), np.full(len(table), readout)
    for _ in range(70):
        seconds = (early + late) / 2
        reads = last * (0.5 + sense * seconds / readout)  # the row being read then
        passed = sense * (reads - at(seconds)[:, axis]) > 0
        late, early = np.where(passed, seconds, late), np.where(passed, early, seconds)
    return at((early + late) / 2)


def taken(direction, **options):
    """A block whose pictures were read row by row, and the camera."""
    camera = replace(CAMLIGHT, row_direction=direction, calibrated=True)
    block = corridor_block(
        images=16, strips=2, camera=camera, interval_s=0.7, angular_rate_deg_s=3.0, seed=5,
        observations_per_image=100, relief=6.0, **options,
    )  # fmt: skip
    for table, source in (("tie_points", block.points), ("marks", block.ground)):
        rows = getattr(block, table)
        rows[["x", "y"]] = picture_of(block, camera, rows, source, READOUT)
    return block


@pytest.mark.parametrize("direction", ["down", "up", "right", "left"])
def test_the_forward_model_sees_what_the_independent_shutter_saw(direction):
    """To 1e-8 px; the shutter moves points by up to 20 px."""
    block = taken(direction)
    model = predict(block, {"rolling_shutter": {"readout": READOUT}})
    rigid = predict(block)
    for table, kind in (("tie_points", "tie"), ("marks", "mark")):
        measured = getattr(block, table)[["x", "y"]].to_numpy()
        assert np.abs(getattr(model, kind) - measured).max() < 1e-8
        assert np.abs(getattr(rigid, kind) - measured).max() > 10


@pytest.mark.parametrize("direction", ["down", "left"])
def test_a_perfect_block_gives_back_its_readout_and_its_points_to_nanometres(direction):
    """Start: poses off by 5 cm and 1 mrad, points by 5 cm, no readout."""
    true = taken(direction)
    start = taken(direction, start_error=(0.05, 0.001, 0.05))
    for table in ("tie_points", "marks"):
        setattr(start, table, getattr(true, table))
    found = corridor.adjust(start, camera="fixed", effects=["rolling_shutter"], lever_arm="fixed")
    assert found.converged
    readout = found.effects["value"].iloc[0]
    assert abs(readout - READOUT) < 1e-9
    points = found.block.points.set_index("point").loc[true.points["point"], ["x", "y", "z"]]
    assert np.abs(points.to_numpy() - true.points[["x", "y", "z"]]).to_numpy().max() < 5e-9
    for axis in "xyz":
        off = found.poses[axis].to_numpy() - true.images[axis].to_numpy()
        assert np.abs(off).max() < 5e-9


def test_blind_to_its_shutter_the_same_block_misses_its_check_points():
    """What the effect is worth: without it nothing of the above holds."""
    block = taken("down")
    blind = corridor.adjust(block, camera="fixed", lever_arm="fixed")
    aware = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"], lever_arm="fixed")
    assert blind.statistics["tie"]["rms"] > 0.1
    assert blind.check_rms.d3 > 1e-3
    assert aware.check_rms.d3 < 1e-8
