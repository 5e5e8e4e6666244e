"""A set as a Mavic Mini makes it: the gimbal's yaw from the nose, the flight's from north, 19 ms.

Of an independent generator: air that shakes the drone, brakes and turns, a lens that is not
Fraser's, positions of a single receiver.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis.generator import NOISES, Air, Case
from benchmarks.diagnosis.generator.generate import draw, make_scene, streams, write_down
from benchmarks.diagnosis.generator.trajectory import ACCELERATION
from benchmarks.diagnosis.generator.world import World
from corridor import adjust
from corridor.core.errors import InputError
from corridor.core.geometry import Similarity, rotation_from_quaternion, rotation_from_vector
from corridor.core.gnss import Local
from corridor.core.photographs import Metadata
from corridor.core.preparation import derived
from corridor.tools.formats import Project
from corridor.tools.formats.control import moved_by
from corridor.tools.formats.placing import _with_positions, in_own_frame, with_motion
from corridor.tools.formats.turned import with_turned, yaw_of
from corridor.tools.readout import readout_from_flight

READOUT = 0.019
TURN = rotation_from_vector(np.array([[0.3, -1.2, 0.7]]))[0]
FREE = Similarity(0.07, TURN, np.array([1.0, 2.0, 3.0]))


def mini(seed, gps=True, count=36):
    """The project of its photographs, and what each says."""
    speed = 6.0
    case = Case(
        geometry="nadir",
        images=count,
        height=60.0,
        strips=3,
        speed=speed,
        forward=0.72,
        beyond_s=1.5 * speed / ACCELERATION + 4.0,
        gnss="exposures",
        gyro="none",
        control=2,
        check=0,
        row_direction="down",
        observations=80,
        air=Air(),
        noise=replace(NOISES["everyday"], gnss_white_m=(0.3, 0.3, 0.5)),
    )
    draws = streams(seed)
    scene = make_scene(case, draws)
    world = World()
    world.readout = READOUT
    block, _ = write_down(scene, world, case, draw(scene, case, draws), "mini")
    block.marks, block.ground = block.marks.iloc[:0], block.ground.iloc[:0]
    seen = np.round(scene.trajectory.velocity(scene.trajectory.exposure), 1)
    rng = np.random.default_rng(seed)
    yaw = yaw_of(rotation_from_quaternion(block.poses[:, 3:]))
    place = Local(47.0, 8.0, 0.0).to_geographic(block.numbers("gnss", *"xyz"))
    at = block.image_rows("gnss")
    photos = {}
    for k, name in enumerate(block.images["image"]):
        g = np.flatnonzero(at == k)[0]
        where = dict(zip(("lon_deg", "lat_deg", "height"), place[g].tolist(), strict=True))
        c = block.cameras[block.images["camera"].iloc[k]]
        photos[k] = Metadata(
            Path(str(name)),
            c.width,
            c.height,
            make="DJI",
            model="FC7203",
            yaw=float(rng.normal(0, 2)),
            pitch=-90.0,
            roll=0.0,
            flight_yaw=float(yaw[k] + rng.normal(0, 2)),
            velocity=tuple(seen[k]),
            velocity_of="DJI's maker note",
            **(where if gps else {}),
        )
    images = block.images.drop(
        columns=[c for c in ("vx", "vy", "vz", "wx", "wy", "wz") if c in block.images]
    )
    bare = replace(
        block,
        images=images,
        gnss=block.gnss.iloc[:0],
        lever_arm={},
        crs=None,
        offset=np.zeros(3),
        extra={},
    )
    project = moved_by(Project("photos", Path("mini"), bare, placed=False), FREE)
    project = _with_positions(project, photos, None)
    project = in_own_frame(with_motion(project, photos))
    return with_turned(project, photos), photos


@pytest.fixture(scope="module")
def placed():
    return mini(1)[0]


def test_no_photograph_is_called_turned_and_the_yaws_are_told_apart(placed):
    assert placed.warnings == [] and not any("turned" in note for note in placed.notes)
    said = {one.column: one for one in derived(placed.block)}
    assert said["heading"].source == "the yaw of the flight and the gimbal's against it"
    assert [w.says for w in said["heading"].witnesses].count("contradicts") == 0
    assert said["stated velocity"].witnesses[0].says == "agrees"


def test_the_adjustment_finds_its_readout_within_two_sigmas(placed):
    found = adjust(placed.block, effects=["rolling_shutter"]).effects.iloc[0]
    assert found["value"] == pytest.approx(READOUT, abs=2 * found["sigma"])
    assert found["sigma"] < 0.003


@pytest.mark.slow
def test_the_flight_tells_its_readout_within_two_sigmas(placed):
    found = readout_from_flight(placed.block, advise=False)
    assert found.told
    assert found.readout == pytest.approx(READOUT, abs=2 * found.sigma)


def test_without_positions_the_readout_is_refused():
    stripped, _ = mini(1, gps=False)
    assert not stripped.block.has("images.vx")
    assert any("nothing says where north is" in warning for warning in stripped.warnings)
    with pytest.raises(InputError, match="no vx"):
        adjust(stripped.block, effects=["rolling_shutter"])
    with pytest.raises(InputError, match="have no velocity, and none can be derived"):
        readout_from_flight(stripped.block, advise=False)
